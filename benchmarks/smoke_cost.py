"""What a smoke run takes, and how much of it is the start of its processes.

    python benchmarks/smoke_cost.py [SPEC ...]

Each spec, by default the relay and the demo of specs/, is run with --smoke. The start-up is the
time from the beginning of the command to the end of the warm-up: Python, reading the data,
preprocessors, player and monitor, graph. What is beyond it is the iteration and
the end of the processes.

Prints a Markdown table, times in seconds. Asserts nothing.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from r2bspec.record.run_folder import open_run

_SPECS = ("specs/relay.r2b.yaml", "specs/apriltag_node.r2b.yaml")


def main() -> None:
    """Run every spec once, and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("specs", nargs="*", default=_SPECS)
    sys.stdout.write("| spec | start-up | beyond it | whole command |\n| --- | --- | --- | --- |\n")
    for spec in parser.parse_args().specs:
        start_s, whole_s = _measure(Path(spec))
        shown = " | ".join(f"{each:.1f}" for each in (start_s, whole_s - start_s, whole_s))
        sys.stdout.write(f"| {Path(spec).name} | {shown} |\n")


def _measure(spec: Path) -> tuple[float, float]:
    """The seconds to the end of the warm-up, and to the end of the command."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        command = [sys.executable, "-m", "r2bspec", "run", str(spec), "--smoke", "-q"]
        began_ns = time.monotonic_ns()
        subprocess.run([*command, "-o", str(folder)], check=True, stdout=subprocess.DEVNULL)
        ended_ns = time.monotonic_ns()
        [start] = open_run(folder).record.starts
    return (start.ready_ns - began_ns) / 1e9, (ended_ns - began_ns) / 1e9


if __name__ == "__main__":
    main()
