"""How fast the harness is with nothing under test: what every reported latency contains.

    python benchmarks/harness_floor.py [--quick] [--write docs/performance.md]
    python benchmarks/harness_floor.py --ablate [--write docs/performance.md]

Player to monitor, for each workload, transport and placement, beside a plain rclpy publisher and
subscriber in the same run; then the highest rate that each holds. Repetitions are interleaved, and
each figure is the median of them, so that a disturbance of the machine touches all rows alike.
Prints Markdown, and with ``--write`` puts it in its places on a page; asserts nothing. All of it
takes about ten minutes, ``--quick`` one, in which little is played.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from floor_figures import Figures, medians
from floor_harness import TECHNIQUES, floor
from floor_page import put
from floor_peer import measure_peer
from floor_workloads import LARGE, MEDIUM, SMALL, WORKLOADS, Workload

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

    @property
    def title(self) -> str:
        return f"{self.workload.name}, {self.name}"


def main() -> int:
    options = _options()
    if options.ablate:
        found, conditions = _measure(_ablations(options), options)
        _show(options, "techniques", [*_ablation_table(found), "", conditions])
        return 0
    found, conditions = _measure(_cases(options), options)
    if found:
        _show(options, "floors", [conditions, "", *_floor_table(found)])
    if options.rates and not options.quick:
        _show(options, "rates", list(_rate_table(options)))
    return 0


def _measure(made: list[Case], options: argparse.Namespace) -> tuple[dict[Case, Figures], str]:
    """Measure all cases in turn; returns the medians, and under which conditions they were made."""
    cases = [each for each in made if options.only in each.title]
    found: dict[Case, list[Figures]] = {case: [] for case in cases}
    loads = [os.getloadavg()[0]]
    for repeat in range(1, options.repeats + 1):
        for case in cases:
            loads.append(os.getloadavg()[0])
            found[case].append(case.measure(options.seconds))
            _tell(f"{repeat}/{options.repeats} {case.title}")
    conditions = (
        f"{len(os.sched_getaffinity(0))} cores, {platform.machine()}, Linux {platform.release()}, "
        f"Python {platform.python_version()}; load average while measuring "
        f"{statistics.median(loads):.1f} (median), {max(loads):.1f} (most); medians of "
        f"{options.repeats} runs of {options.seconds:g} s."
    )
    return {case: medians(several) for case, several in found.items()}, conditions


def _show(options: argparse.Namespace, section: str, lines: list[str]) -> None:
    """Print a section, and put it in its place on the page if there is one."""
    text = "\n".join(lines)
    print(f"{text}\n", flush=True)  # noqa: T201 - a program
    if options.write:
        put(options.write, section, text)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="one second of each, and no rates")
    parser.add_argument("--write", type=Path, help="the page to put the tables into")
    parser.add_argument("--seconds", type=float, default=2.0, help="how long each run plays")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each case")
    parser.add_argument(
        "--no-rates", dest="rates", action="store_false", help="leave out the highest rates"
    )
    parser.add_argument("--only", default="", help="only cases whose name contains this")
    parser.add_argument(
        "--ablate",
        action="store_true",
        help="shared memory between two processes only, with each technique left out in turn",
    )
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        choices=TECHNIQUES,
        help="leave a technique of the harness out; may be repeated",
    )
    parser.add_argument(
        "--env",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a variable of player and monitor; NAME= removes it",
    )
    options = parser.parse_args()
    if options.quick:
        options.seconds, options.repeats = 1.0, 1
    return options


def _cases(options: argparse.Namespace) -> list[Case]:
    changes, without = _changes(options), options.without
    cases = []
    for workload in WORKLOADS:
        for transport, placement in ROUTES:

            def measure(
                seconds: float,
                workload: Workload = workload,
                transport: str = transport,
                placement: str = placement,
            ) -> Figures:
                with floor(workload, transport, placement, changes, without) as ready:
                    return ready.measure(workload.rate_hz, seconds)

            cases.append(Case(workload, f"{transport}, {placement}", measure))

        def peer(seconds: float, workload: Workload = workload) -> Figures:
            return measure_peer(workload, seconds)

        cases.append(Case(workload, "plain rclpy, two processes", peer))
    return cases


def _changes(options: argparse.Namespace) -> dict[str, str]:
    return dict(each.partition("=")[::2] for each in options.env)


def _ablations(options: argparse.Namespace) -> list[Case]:
    changes = _changes(options)
    cases = []
    for workload in WORKLOADS:
        for left_out in ("", *TECHNIQUES):

            def measure(
                seconds: float, workload: Workload = workload, left_out: str = left_out
            ) -> Figures:
                without = [left_out] if left_out else []
                transport, placement = TRANSPORTS[0], PLACEMENTS[0]
                with floor(workload, transport, placement, changes, without) as ready:
                    return ready.measure(workload.rate_hz, seconds)

            cases.append(Case(workload, f"without {left_out}" if left_out else "all", measure))
    return cases


def _floor_table(rows: dict[Case, Figures]) -> Iterator[str]:
    yield (
        "| workload | transport, placement | to the middleware p50, p99 | to the monitor p50, p99 "
        "| published late p50, p99 | CPU per message | sent | lost |"
    )
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    for case, row in rows.items():
        yield (
            f"| {case.workload.name} | {case.name} | {_ms(row.received_p50, row.received_p99)} "
            f"| {_ms(row.taken_p50, row.taken_p99)} | {_ms(row.late_p50, row.late_p99)} "
            f"| {row.cpu_ms:.3f} ms | {row.sent:.0f} | {row.lost:.0f} |"
        )


def _ablation_table(rows: dict[Case, Figures]) -> Iterator[str]:
    """A row for each technique that is left out: late, to the middleware, CPU per message."""
    workloads = list(dict.fromkeys(case.workload for case in rows))
    yield "| | " + " | ".join(each.name for each in workloads) + " |"
    yield "| --- |" + " --- |" * len(workloads)
    for name in dict.fromkeys(case.name for case in rows):
        cells = {
            case.workload: f"{row.late_p50:.3f} / {row.received_p50:.3f} / {row.cpu_ms:.3f}"
            for case, row in rows.items()
            if case.name == name
        }
        yield f"| {name} | " + " | ".join(cells.get(each, "") for each in workloads) + " |"


def _rate_table(options: argparse.Namespace) -> Iterator[str]:
    # In one process the middleware hands messages over by itself, whatever the transport.
    yield "| size | " + " | ".join([*TRANSPORTS, PLACEMENTS[1]]) + " |"
    yield "| --- |" + " --- |" * len(ROUTES)
    for workload in (WORKLOADS[0], *WORKLOADS[2:]):
        cells = []
        for transport, placement in ROUTES:
            with floor(workload, transport, placement, _changes(options)) as ready:
                rate = ready.highest_rate(MOST_HZ[workload.size], 1.0, 0.05)
            cells.append(f"{rate:,.0f} Hz" if rate else "10 Hz or less")
            _tell(f"highest rate: {workload.name}, {transport}, {placement}: {cells[-1]}")
        yield f"| {workload.name.partition(' at')[0]} | " + " | ".join(cells) + " |"


def _ms(p50: float, p99: float) -> str:
    return f"{p50:.3f}, {p99:.3f} ms"


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)  # noqa: T201 - a program


if __name__ == "__main__":
    sys.exit(main())
