"""How fast the harness is without a graph: what every reported latency contains.

    python benchmarks/harness_floor.py [--quick] [--write docs/performance.md]

Player to monitor, for each workload, transport and placement, beside a plain rclpy publisher and
subscriber in the same run; then the highest rate that each holds. Repetitions are interleaved, and
each figure is the median of them, so that a disturbance of the machine touches all rows alike.
Prints Markdown, and with ``--write`` puts it in its places on a page; asserts nothing. All of it
takes about ten minutes, ``--quick`` one, in which little is played.
"""

from __future__ import annotations

import os
import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from floor_harness import floor
from floor_peer import measure_peer
from floor_workloads import LARGE, MEDIUM, SMALL, WORKLOADS, Figures, Workload, medians
from measuring import machine, options, show_section, table, tell

TRANSPORTS = ("shared_memory", "udp", "inherit")
PLACEMENTS = ("two processes", "one process")
# Inside one process the middleware hands messages over, whatever the transport is.
ROUTES = (
    *((transport, PLACEMENTS[0]) for transport in TRANSPORTS),
    (TRANSPORTS[0], PLACEMENTS[1]),
)
MOST_HZ = {SMALL: 100_000.0, MEDIUM: 2_000.0, LARGE: 1_000.0}


@dataclass(frozen=True)
class Case:
    """A row of the table."""

    workload: Workload
    name: str
    measure: Callable[[float], Figures]


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--quick", action="store_true", help="one second of each, and no rates")
    parser.add_argument("--write", type=Path, help="the page to put the tables into")
    given = parser.parse_args()
    seconds, repeats = (1.0, 1) if given.quick else (2.0, 3)
    show_section(given.write, "floors", list(_floors(seconds, repeats)))
    if not given.quick:
        rows = map(_rate_row, (WORKLOADS[0], *WORKLOADS[2:]))
        show_section(given.write, "rates", list(table(("size", *TRANSPORTS, PLACEMENTS[1]), rows)))


def _floors(seconds: float, repeats: int) -> Iterator[str]:
    """Measure all cases in turn: the conditions, and the table of the medians."""
    found: dict[Case, list[Figures]] = {case: [] for case in _cases()}
    loads = [os.getloadavg()[0]]
    for repeat in range(1, repeats + 1):
        for case, several in found.items():
            loads.append(os.getloadavg()[0])
            several.append(case.measure(seconds))
            tell(f"{repeat}/{repeats} {case.workload.name}, {case.name}")
    yield (
        f"{machine()}; load average while measuring {statistics.median(loads):.1f} (median), "
        f"{max(loads):.1f} (most); medians of {repeats} runs of {seconds:g} s."
    )
    yield ""
    head = (
        *("workload", "transport, placement", "to the middleware p50, p99"),
        *("to the monitor p50, p99", "CPU per message", "lost"),
    )
    yield from table(head, (_floor_row(case, medians(each)) for case, each in found.items()))


def _cases() -> Iterator[Case]:
    for workload in (WORKLOADS[0], WORKLOADS[2]):
        for transport, placement in ROUTES:
            measure = partial(_measure_floor, workload, transport, placement)
            yield Case(workload, f"{transport}, {placement}", measure)
        yield Case(workload, "plain rclpy, two processes", partial(measure_peer, workload))


def _measure_floor(workload: Workload, transport: str, placement: str, seconds: float) -> Figures:
    with floor(workload, transport, placement) as ready:
        return ready.measure(workload.rate_hz, seconds)


def _floor_row(case: Case, row: Figures) -> list[str]:
    return [
        case.workload.name,
        case.name,
        f"{row.received_p50:.3f}, {row.received_p99:.3f} ms",
        f"{row.taken_p50:.3f}, {row.taken_p99:.3f} ms",
        f"{row.cpu_ms:.3f} ms",
        f"{row.lost:.0f}",
    ]


def _rate_row(workload: Workload) -> list[str]:
    cells = [workload.name.partition(" at")[0]]
    for transport, placement in ROUTES:
        with floor(workload, transport, placement) as ready:
            rate = ready.highest_rate(MOST_HZ[workload.size], 1.0, 0.05)
        cells.append(f"{rate:,.0f} Hz" if rate else "10 Hz or less")
        tell(f"highest rate: {workload.name}, {transport}, {placement}: {cells[-1]}")
    return cells


if __name__ == "__main__":
    main()
