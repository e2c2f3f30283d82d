"""How long `r2bspec validate` takes, beside a validator that applies only the JSON Schema.

::

    pip install check-jsonschema
    python tests/bench/bench_validate.py

Both read the same files; the other tool gets the published schema of this repository. Each case
is run several times, the two tools in turn, each run in a fresh process whose wall time, CPU time
and largest memory are taken from the kernel; the CPU time of processes that it starts counts, too.
Shown are medians, and in parentheses the fastest and the slowest run. One run of each comes first
and is not counted, so that files are in the cache. Byte code is kept in a folder made for the
purpose, so that both tools find theirs, as installed programs do.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "specs" / "apriltag_node.r2b.yaml"
SCHEMA = ROOT / "schemas" / "r2bspec-v1.schema.json"
TOOLS = {
    "r2bspec validate": [sys.executable, "-m", "r2bspec", "validate"],
    "check-jsonschema": [sys.executable, "-m", "check_jsonschema", "--schemafile", str(SCHEMA)],
}
OURS, THEIRS = TOOLS


@dataclass(frozen=True, slots=True)
class Run:
    """One run of one tool."""

    seconds: float
    cpu_seconds: float
    memory_bytes: int


def measure(command: list[str], byte_code: Path) -> Run:
    """Run a command to its end; its modules are kept compiled in the folder `byte_code`.

    Raises:
        SystemExit: it found something wrong, so that it did not do the work that is compared.
    """
    environ = {**os.environ, "PYTHONPYCACHEPREFIX": str(byte_code), "PYTHONPATH": str(ROOT)}
    environ.pop("PYTHONDONTWRITEBYTECODE", None)
    with tempfile.TemporaryFile() as output:
        start = time.perf_counter()
        process = subprocess.Popen(command, cwd=ROOT, env=environ, stdout=output, stderr=output)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            output.seek(0)
            raise SystemExit(f"{command[:5]} failed:\n{output.read(4000).decode()}")
    return Run(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024)


def compare(files: list[Path], repeat: int, byte_code: Path) -> dict[str, list[Run]]:
    """Runs of both tools over the same files, in turn."""
    runs: dict[str, list[Run]] = {tool: [] for tool in TOOLS}
    for round_number in range(repeat + 1):
        for tool, command in TOOLS.items():
            run = measure([*command, *map(str, files)], byte_code)
            if round_number:
                runs[tool].append(run)
    return runs


def chain(nodes: int) -> str:
    """A spec with that many nodes, each of which reads what the one before it writes."""
    lines = [
        "r2bspec: 1",
        "name: chain",
        "data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: recorded/image}}",
        "playback:",
        "  inputs: {link_0: {from: recorded/image, format: sensor_msgs/msg/Image}}",
        "graph:",
        "  nodes:",
    ]
    for number in range(nodes):
        lines += [
            f"    relay_{number}:",
            "      python: r2bspec.nodes.RelayNode",
            f"      remappings: {{input: link_{number}, output: link_{number + 1}}}",
        ]
    lines += [
        f"monitors: {{end: {{topic: link_{nodes}, format: sensor_msgs/msg/Image}}}}",
        "benchmark: {rates: [30 Hz]}",
    ]
    return "\n".join(lines) + "\n"


def copies(folder: Path, number: int) -> list[Path]:
    """That many specs, each with a name of its own."""
    text = SPEC.read_text(encoding="utf-8")
    files = [folder / f"spec_{index}.r2b.yaml" for index in range(number)]
    for index, file in enumerate(files):
        file.write_text(text.replace("name: apriltag_node", f"name: apriltag_node_{index}"))
    return files


def table(cases: dict[str, dict[str, list[Run]]]) -> Iterator[str]:
    """The measured times as a table in Markdown."""
    yield f"| case | {OURS} | {THEIRS} | theirs / ours | CPU, theirs / ours | memory |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for case, runs in cases.items():
        times = {tool: [run.seconds for run in runs[tool]] for tool in TOOLS}
        memory = {tool: max(run.memory_bytes for run in runs[tool]) / 1e6 for tool in TOOLS}
        ratio = statistics.median(times[THEIRS]) / statistics.median(times[OURS])
        cpu = {tool: statistics.median(run.cpu_seconds for run in runs[tool]) for tool in TOOLS}
        cells = [shown(times[tool]) for tool in TOOLS]
        yield (
            f"| {case} | {' | '.join(cells)} | {ratio:.1f} "
            f"| {cpu[THEIRS]:.2f} s / {cpu[OURS]:.2f} s = {cpu[THEIRS] / cpu[OURS]:.1f} "
            f"| {memory[OURS]:.0f} MB, theirs {memory[THEIRS]:.0f} MB |"
        )


def shown(seconds: list[float]) -> str:
    """The median, and the extremes."""
    return f"{statistics.median(seconds):.3f} s ({min(seconds):.3f} to {max(seconds):.3f})"


def growth(small: list[Run], large: list[Run], cold: list[Run]) -> float:
    """How many times as much CPU time the large spec takes as the small one, without start-up."""
    start, first, last = (min(run.cpu_seconds for run in runs) for runs in (cold, small, large))
    return (last - start) / max(first - start, 1e-9)


def main() -> None:
    """Measure, and print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--repeat", type=int, default=5, help="runs of each case and tool")
    parser.add_argument("--files", type=int, default=1000, help="files of the case with many")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = copies(folder, options.files)
        chains = {}
        for nodes in (500, 5000):
            chains[nodes] = folder / f"chain_{nodes}.r2b.yaml"
            chains[nodes].write_text(chain(nodes))
        measured = partial(compare, byte_code=folder / "byte_code")
        cases = {
            "one spec, cold": measured([SPEC], 2 * options.repeat),
            f"{options.files:,} specs": measured(files, options.repeat),
            "a spec of 500 nodes": measured([chains[500]], options.repeat),
            "a spec of 5,000 nodes": measured([chains[5000]], options.repeat),
        }
    cold, _, small, large = cases.values()
    machine = f"Python {platform.python_version()}, {os.cpu_count()} CPUs"
    lines = [
        f"{machine}, check-jsonschema {version('check-jsonschema')}, {options.repeat} runs each",
        "",
        *table(cases),
        "",
    ]
    for tool in TOOLS:
        times = growth(small[tool], large[tool], cold[tool])
        lines.append(
            f"{tool}: ten times the nodes take {times:.1f} times the CPU time, start-up apart"
        )
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
