"""What a start of all processes costs, and where the time goes.

    python benchmarks/start_cost.py [--starts 5] [SPEC ...]

Each spec, by default the relay and the demo of specs/, is run without its search and its
objectives, and with short iterations. A complete start is the first one of the run: player and
monitor, harness overhead, graph, warm-up. What later starts take is the median.

Prints a Markdown table, times in seconds, and the ratio of a later start to a complete one, which
is what each start would cost if nothing were done once and nothing at the same time. Asserts
nothing.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from r2bspec.language.load_spec import load_spec
from r2bspec.record.run_folder import open_run
from r2bspec.record.run_record import RunRecord

_SPECS = ("specs/relay.r2b.yaml", "specs/apriltag_node.r2b.yaml")
_PARTS = ("start", "floor", "graph", "warm_up")
_TITLES = ("player, monitor, imports", "harness overhead", "graph", "warm-up", "together")


def main() -> None:
    """Run every spec, and print what its starts took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--starts", type=int, default=5)
    parser.add_argument("specs", nargs="*", default=_SPECS)
    options = parser.parse_args()
    sys.stdout.write(f"| spec | start | {' | '.join(_TITLES)} | ratio |" + "\n")
    sys.stdout.write(f"| --- {'| --- ' * (len(_TITLES) + 2)}|" + "\n")
    for spec in options.specs:
        first, *later = _starts(_run(Path(spec), options.starts))
        middle = [statistics.median(each) for each in zip(*later, strict=True)]
        _print_row(Path(spec).name, "complete", first, 1.0)
        _print_row(Path(spec).name, "later", middle, middle[-1] / first[-1])


def _print_row(spec: str, start: str, values: list[float], ratio: float) -> None:
    shown = " | ".join(f"{each:.2f}" for each in values)
    sys.stdout.write(f"| {spec} | {start} | {shown} | {ratio:.2f} |" + "\n")


def _run(spec: Path, starts: int) -> RunRecord:
    """The record of a run that is made of hardly more than starts."""
    text = spec.read_text().split("\nbenchmark:")[0]
    rate = "10 Hz"
    text += f"\nbenchmark:\n  duration: 300 ms\n  iterations: {2 * starts}\n  starts: {starts}\n"
    text += f"  rates: [{rate}]\n"
    with tempfile.TemporaryDirectory() as folder:
        path = spec.parent / f".{spec.stem}-{Path(folder).name}.r2b.yaml"
        path.write_text(text)
        try:
            assert load_spec(text, file=path.name).spec is not None, f"{spec} has another layout"
            subprocess.run(
                [sys.executable, "-m", "r2bspec", "run", path, "--output", f"{folder}/run"],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                check=False,
            )
            return open_run(Path(folder) / "run").record
        finally:
            path.unlink()


def _starts(record: RunRecord) -> Iterator[list[float]]:
    """What each part of each start took, and all of them together."""
    for each in record.starts:
        began = [
            (text.removeprefix("phase "), time_ns)
            for time_ns, text in record.events
            if text.removeprefix("phase ") in _PARTS and each.began_ns <= time_ns <= each.ready_ns
        ]
        ends = [time_ns for _, time_ns in began[1:]] + [each.ready_ns]
        took = {
            name: (end - time_ns) / 1e9 for (name, time_ns), end in zip(began, ends, strict=True)
        }
        yield [*(took.get(part, 0.0) for part in _PARTS), (each.ready_ns - each.began_ns) / 1e9]


if __name__ == "__main__":
    main()
