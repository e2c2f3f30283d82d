"""How fast the harness is with nothing under test: what every reported latency contains.

    python tests/bench/harness_floor.py [--seconds 5] [--repeats 3] [--rates] [--ablate]

Player to monitor, for each workload, transport and placement, beside a plain rclpy publisher and
subscriber in the same run. Repetitions are interleaved, and each figure is the median of them, so
that a disturbance of the machine touches all rows alike. Prints Markdown; asserts nothing.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass

from floor_child import TECHNIQUES
from floor_figures import Figures, medians
from floor_harness import floor
from floor_peer import measure_peer
from floor_workloads import LARGE, MEDIUM, SMALL, WORKLOADS, Workload

TRANSPORTS = ("shared_memory", "udp", "inherit")
PLACEMENTS = ("two processes", "one process")
MOST_HZ = {SMALL: 20_000.0, MEDIUM: 2_000.0, LARGE: 1_000.0}


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
    changes = dict(each.partition("=")[::2] for each in options.env)
    made = _ablations(changes) if options.ablate else _cases(changes, options.without)
    cases = [each for each in made if options.only in each.title]
    found: dict[Case, list[Figures]] = {case: [] for case in cases}
    loads = [os.getloadavg()[0]]
    for repeat in range(1, options.repeats + 1):
        for case in cases:
            loads.append(os.getloadavg()[0])
            found[case].append(case.measure(options.seconds))
            _tell(f"{repeat}/{options.repeats} {case.title}")
    _print(
        f"{len(os.sched_getaffinity(0))} cores, {platform.machine()}, Linux {platform.release()}, "
        f"Python {platform.python_version()}; load average while measuring "
        f"{statistics.median(loads):.1f} (median), {max(loads):.1f} (most); medians of "
        f"{options.repeats} runs of {options.seconds:g} s.\n"
    )
    if cases:
        _print_floors({case: medians(several) for case, several in found.items()})
    if options.rates:
        _print("")
        _print_rates(options)
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=5.0, help="how long each run plays")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each case")
    parser.add_argument("--rates", action="store_true", help="search the highest rates, too")
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
    return parser.parse_args()


def _cases(changes: dict[str, str], without: list[str]) -> list[Case]:
    cases = []
    for workload in WORKLOADS:
        for transport in TRANSPORTS:
            for placement in PLACEMENTS:

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


def _ablations(changes: dict[str, str]) -> list[Case]:
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


def _print_floors(rows: dict[Case, Figures]) -> None:
    _print(
        "| workload | transport, placement | to the middleware p50, p99 | to Python p50, p99 "
        "| published late p50, p99 | CPU per message | sent | lost |"
    )
    _print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for case, row in rows.items():
        _print(
            f"| {case.workload.name} | {case.name} | {_ms(row.received_p50, row.received_p99)} "
            f"| {_ms(row.taken_p50, row.taken_p99)} | {_ms(row.late_p50, row.late_p99)} "
            f"| {row.cpu_ms:.3f} ms | {row.sent:.0f} | {row.lost:.0f} |"
        )


def _print_rates(options: argparse.Namespace) -> None:
    _print("| size | " + " | ".join(TRANSPORTS) + " |")
    _print("| --- |" + " --- |" * len(TRANSPORTS))
    for workload in (WORKLOADS[0], *WORKLOADS[2:]):
        cells = []
        for transport in TRANSPORTS:
            rates = []
            for _ in range(options.repeats):
                with floor(workload, transport, "two processes") as ready:
                    rates.append(ready.highest_rate(MOST_HZ[workload.size], 2.0, 0.05) or 0.0)
            cells.append(f"{statistics.median(rates):,.0f} Hz")
            _tell(f"highest rate: {workload.name}, {transport}: {rates}")
        _print(f"| {workload.name.partition(' at')[0]} | " + " | ".join(cells) + " |")


def _ms(p50: float, p99: float) -> str:
    return f"{p50:.3f}, {p99:.3f} ms"


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)  # noqa: T201 - a program


def _print(text: str) -> None:
    print(text, flush=True)  # noqa: T201 - a program


if __name__ == "__main__":
    sys.exit(main())
