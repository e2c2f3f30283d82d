"""What a start of all processes costs, where the time goes, and what a smoke run takes.

    python benchmarks/start_cost.py [--starts 5] [SPEC ...]
    python benchmarks/start_cost.py --smoke [SPEC ...]

Each spec, by default the relay and the demo of specs/, is run without its search and its
objectives, and with short iterations. A complete start is the first one of the run: player and
monitor, harness overhead, graph, warm-up. What later starts take is the median. The ratio of a
later start to a complete one is what is saved by doing some of it once, and some at the same time.

With ``--smoke`` each spec is run once with ``--smoke``. Its start-up is the time from the beginning
of the command to the end of the warm-up: Python, reading the data, preprocessors, player, monitor
and graph.

Prints a Markdown table, times in seconds. Asserts nothing.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from measuring import options, run, show, table

from r2bspec.record.run_record import RunRecord

_SPECS = ("specs/relay.r2b.yaml", "specs/apriltag_node.r2b.yaml")
_PARTS = {
    "start": "player, monitor, imports",
    "harness_overhead": "harness overhead",
    "graph": "graph",
    "warm_up": "warm-up",
}


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--starts", type=int, default=5)
    parser.add_argument("--smoke", action="store_true")
    parser.add_argument("specs", nargs="*", type=Path, default=[Path(each) for each in _SPECS])
    given = parser.parse_args()
    if given.smoke:
        head = ("spec", "start-up", "beyond it", "whole command")
        show(*table(head, map(_smoke_row, given.specs)))
        return
    columns = ("spec", "start", *_PARTS.values(), "together", "ratio")
    rows = (row for spec in given.specs for row in _start_rows(spec, given.starts))
    show(*table(columns, rows))


def _smoke_row(spec: Path) -> list[str]:
    with tempfile.TemporaryDirectory() as folder:
        began_ns = time.monotonic_ns()
        [start] = run(spec, Path(folder) / "run", "--smoke").record.starts
        whole_s = (time.monotonic_ns() - began_ns) / 1e9
    start_s = (start.ready_ns - began_ns) / 1e9
    return [spec.name, *(f"{each:.1f}" for each in (start_s, whole_s - start_s, whole_s))]


def _start_rows(spec: Path, starts: int) -> Iterator[list[str]]:
    first, *later = _starts(_record(spec, starts))
    middle = [statistics.median(each) for each in zip(*later, strict=True)]
    for start, values in (("complete", first), ("later", middle)):
        seconds = [f"{each:.2f}" for each in values]
        yield [spec.name, start, *seconds, f"{values[-1] / first[-1]:.2f}"]


def _record(spec: Path, starts: int) -> RunRecord:
    """The record of a run that is made of hardly more than starts."""
    text = spec.read_text().split("\nbenchmark:")[0]
    text += f"\nbenchmark:\n  duration: 300 ms\n  iterations: {2 * starts}\n  starts: {starts}\n"
    text += "  rates: [10 Hz]\n"
    with tempfile.TemporaryDirectory() as folder:
        path = spec.parent / f".{spec.stem}-{Path(folder).name}.r2b.yaml"
        path.write_text(text)
        try:
            return run(path, Path(folder) / "run").record
        finally:
            path.unlink()


def _starts(record: RunRecord) -> Iterator[list[float]]:
    """What each part of each start took, and all of them together."""
    for start in record.starts:
        took = dict.fromkeys(_PARTS, 0.0)
        for phase in record.phases:
            if phase.name in took and start.began_ns <= phase.began_ns <= start.ready_ns:
                took[phase.name] += (min(phase.ended_ns, start.ready_ns) - phase.began_ns) / 1e9
        yield [*took.values(), (start.ready_ns - start.began_ns) / 1e9]


if __name__ == "__main__":
    main()
