"""What `r2bspec validate` costs beside check-jsonschema, cold and in bulk.

``python benchmarks/validate_speed.py`` prints the figures of docs/performance.md: processor time,
the least of several runs by turns, because other programs only add to it. check-jsonschema checks
the structure alone, by the published schema; `validate` also reads nodes and recordings, and
applies every rule.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
SCHEMA = ROOT / "schemas" / "r2bspec-v1.schema.json"
SPECS = sorted((ROOT / "specs").glob("*.r2b.yaml"))
BULK = 1000


def cpu_s(command: list[str], folder: Path) -> float:
    """Return the processor time of a command with all of its children."""
    environment = {name: v for name, v in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, env=environment)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{command[:3]} ended with {os.waitstatus_to_exitcode(status)}")
    return usage.ru_utime + usage.ru_stime


def least(commands: dict[str, list[str]], folder: Path, runs: int) -> dict[str, float]:
    """Return the least processor time of each command, run by turns."""
    times: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(runs):
        for name, command in commands.items():
            times[name].append(cpu_s(command, folder))
    return {name: min(values) for name, values in times.items()}


def main() -> None:
    """Measure and print the table."""
    with tempfile.TemporaryDirectory() as folder:
        files = []
        for number in range(BULK):
            spec = SPECS[number % len(SPECS)]
            file = Path(folder) / f"{number}.r2b.yaml"
            shutil.copyfile(spec, file)
            files.append(file.name)
        validate = [str(BIN / "r2bspec"), "validate"]
        peer = [str(BIN / "check-jsonschema"), "--schemafile", str(SCHEMA)]
        head = ("", "`r2bspec validate`", "check-jsonschema", "ratio")
        sys.stdout.write(f"| {' | '.join(head)} |\n| --- | --- | --- | --- |\n")
        for label, names, runs in (("one spec", files[:1], 15), (f"{BULK:,} specs", files, 2)):
            commands = {"own": [*validate, *names], "peer": [*peer, *names]}
            done = least(commands, Path(folder), runs)
            ratio = done["own"] / done["peer"]
            row = f"| {label} | {done['own']:.2f} s | {done['peer']:.2f} s | {ratio:.2f} |\n"
            sys.stdout.write(row)
            sys.stdout.flush()


if __name__ == "__main__":
    main()
