"""What it costs to record the events of processes from inside, and whether any are lost.

    PYTHONPATH=tests/support python benchmarks/anatomy_cost.py [--starts 10] [--minute 60]

The time of an event is that of a publication that does nothing, with the object preloaded, less
that without it, of the processor: the median of pairs of two million.

Two pairs of player and monitor stand ready at once, of which one has the object preloaded; in every
other start it is the first to be started, which alone makes a difference of some percent. They play
in turns of a second, by a coin, so that a disturbance of the machine touches both alike. A ratio is
the median over all turns, with the interval that has it with a confidence of 95 % (order
statistics). Nothing is between player and monitor: in a graph that computes something, events are a
smaller part.

Then 20,000 events a second and more are recorded for a minute: the publication of a message, its
take, and, where no other has arrived, the attempt to take one. Prints Markdown, asserts nothing.
"""

from __future__ import annotations

import os
import random
import statistics
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from floor_harness import floor
from floor_workloads import WORKLOADS, Figures, Workload
from measuring import machine, options, show, table, tell
from scipy.stats import binom

from r2bspec.middleware.middleware import SHARED_MEMORY
from r2bspec.native.build import anatomy_environment, anatomy_object
from r2bspec.record.anatomy_files import AnatomyReader, file_bytes
from r2bspec.record.run_record import AnatomyKind
from stubbed_ros import call_ros

_ROUTE = ("shared_memory", "two processes")
_TURNS = 6
"""Of each side in a start."""

_CALLS = 2_000_000
_EVENTS_HZ = 20_000
_EVENTS_OF_MESSAGE = 2
_FIGURES = {"received_p50": "to the middleware p50", "taken_p50": "to the monitor p50"}
_FIGURES |= {"cpu_ms": "CPU per message"}


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--starts", type=int, default=10)
    parser.add_argument("--minute", type=float, default=60.0, help="seconds, for a quick try")
    given = parser.parse_args()
    load = os.getloadavg()[0]
    rows = [row for workload in WORKLOADS[1:3] for row in _compare(workload, given.starts)]
    show(f"{machine()}; load average {load:.1f} before, {os.getloadavg()[0]:.1f} after.", "")
    head = ("workload", "figure", "without", "with", "ratio", "95 %")
    show(*table(head, rows), "", _event(), _record(given.minute))


def _compare(workload: Workload, starts: int) -> Iterator[list[str]]:
    found: dict[bool, list[Figures]] = {False: [], True: []}
    for start in range(starts):
        with tempfile.TemporaryDirectory(dir=SHARED_MEMORY) as folder:
            observing = _variables(Path(folder), 200_000)
            order = (False, True) if start % 2 else (True, False)
            with (
                floor(workload, *_ROUTE, observing if order[0] else {}) as first,
                floor(workload, *_ROUTE, observing if order[1] else {}) as second,
            ):
                sides = dict(zip(order, (first, second), strict=True))
                for _ in range(_TURNS):
                    for side in random.sample(order, 2):
                        found[side].append(sides[side].measure(workload.rate_hz, 1.0))
        tell(f"{start + 1}/{starts} {workload.name}")
    pairs = starts * _TURNS
    for name, title in _FIGURES.items():
        values = {side: [getattr(each, name) for each in found[side]] for side in found}
        ratios = sorted(b / a for a, b in zip(values[False], values[True], strict=True))
        # The median is as often below as above each of them.
        outer = int(binom.ppf(0.025, pairs, 0.5))
        yield [
            *(workload.name, title),
            *(f"{statistics.median(values[side]):.4f} ms" for side in (False, True)),
            f"{statistics.median(ratios):.3f}",
            f"{ratios[max(0, outer - 1)]:.3f} to {ratios[min(pairs - 1, pairs - outer)]:.3f}",
        ]


def _variables(folder: Path, events: int) -> dict[str, str]:
    return anatomy_environment(anatomy_object(), folder, "floor", file_bytes(events), "")


def _event() -> str:
    """Say what one event takes."""
    differences = []
    for _ in range(7):
        with tempfile.TemporaryDirectory(dir=SHARED_MEMORY) as folder:
            called = partial(call_ros, Path(folder), "measure", f"{_CALLS}")
            plain, observed = called(observed=False), called(max_bytes=file_bytes(2 * _CALLS))
        differences.append(float(observed.stdout) - float(plain.stdout))
    return f"An event takes {statistics.median(differences):.0f} ns."


def _record(seconds: float) -> str:
    """Record for a time, and say what was lost."""
    rate = _EVENTS_HZ / _EVENTS_OF_MESSAGE
    room = round(1.5 * _EVENTS_HZ * seconds)
    with tempfile.TemporaryDirectory(dir=SHARED_MEMORY) as folder:
        with floor(WORKLOADS[0], *_ROUTE, _variables(Path(folder), room)) as observed:
            sent = observed.measure(rate, seconds).sent
        rows, _, processes = AnatomyReader(Path(folder)).read()
    spent_s = (rows["ended_ns"].max() - rows["began_ns"].min()) / 1e9
    published = int((rows["kind"] == AnatomyKind.PUBLISH).sum())
    return (
        f"{len(rows):,} events in {spent_s:.0f} s of {len(processes)} processes, of them "
        f"{published:,} publications, while the player counted {sent:,.0f} and its warm-up; lost "
        f"{sum(each.lost for each in processes)}."
    )


if __name__ == "__main__":
    main()
