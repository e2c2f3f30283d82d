"""The peak search on real relays whose capacity is known: estimate against truth.

    python benchmarks/peak_calibration.py [--quick] [--only TEXT]

One relay, and three in a row, that take equal or exponential times, of about 20, 100 and 400 Hz.
The truth is measured apart from the search: a first run offers twice the rate to queues that hold
all of it, so that the first relay always has something to do, and the times between what leaves it
are what it needs for a message. Of those the drawn service times are subtracted, which the seed
tells; what is left is the overhead of the executor, nearly the same for each message, and its mean
and that of the distribution give

    capacity = 1 / (mean service time + mean overhead)

without the scatter of a few thousand random times. It is measured before and after each search,
because a machine is not always as fast. The relays of a chain are alike: its capacity
is that of the first. Relays sleep, so that three of them do not want three cores.

Prints a Markdown table. Takes about a quarter of an hour on a quiet machine of two cores; --quick
takes the middle capacity only. Asserts nothing.
"""

from __future__ import annotations

import itertools
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from measuring import machine, options, run, show, table, tell

from r2bspec.nodes.service_times import service_times_ns
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import SearchRecord
from r2bspec.report.report_wording import peak_text

_FORMAT = "sensor_msgs/msg/CameraInfo"
_DEPTH = 20_000
_HZ = (20.0, 100.0, 400.0)
_TRUTH_S, _QUICK_TRUTH_S = 5, 3


@dataclass(frozen=True)
class Case:
    """A chain of equal relays."""

    relays: int
    jitter: str
    about_hz: float

    @property
    def name(self) -> str:
        """As the table calls it."""
        times = "equal" if self.jitter == "none" else self.jitter
        many = "one relay" if self.relays == 1 else f"{self.relays} relays in a row"
        return f"{many}, {times} times, {self.about_hz:g} Hz"

    @property
    def mean_ms(self) -> float:
        """The mean service time."""
        return 1e3 / self.about_hz

    def spec(self, benchmark: dict[str, Any]) -> dict[str, Any]:
        """A spec that plays it."""
        nodes = {
            f"relay{number}": {
                "python": "r2bspec.nodes.RelayNode",
                "parameters": {
                    "format": _FORMAT,
                    "service_time_ms": self.mean_ms,
                    "jitter": self.jitter,
                    "seed": number,
                    "spin": False,
                    "queue_depth": _DEPTH,
                },
                "remappings": {"input": f"hop{number}", "output": f"hop{number + 1}"},
            }
            for number in range(self.relays)
        }
        hops = (0, self.relays - 1) if "rates" in benchmark else (self.relays - 1,)
        return {
            "r2bspec": 1,
            "name": "peak_calibration",
            "data_loader": {
                "bag": "r2b_storage",
                "window": {"start": "0 s", "end": "1 s"},
                "topics": {"/d455_1_rgb_camera_info": "recorded"},
            },
            "playback": {
                "inputs": {
                    "hop0": {"from": "recorded", "format": _FORMAT, "qos": {"depth": _DEPTH}}
                }
            },
            "graph": {"nodes": nodes},
            "monitors": {
                f"after{hop}": {
                    "topic": f"hop{hop + 1}",
                    "format": _FORMAT,
                    "qos": {"depth": _DEPTH},
                }
                for hop in dict.fromkeys(hops)
            },
            "benchmark": {"gate": {"confirm": False}, "warm_up": "500 ms"} | benchmark,
        }


def play(case: Case, benchmark: dict[str, Any], folder: Path) -> Run:
    """Run the tool, and open what it recorded."""
    folder.mkdir(parents=True)
    path = folder / "spec.r2b.yaml"
    path.write_text(yaml.safe_dump(case.spec(benchmark), sort_keys=False))
    return run(path, folder / "run")


def capacity(case: Case, saturated: Run) -> tuple[float, float]:
    """The capacity of the first relay in Hz, and the mean overhead of a message in ms."""
    warm = [each for each in saturated.record.segments if each.kind == "warm_up"]
    before = sum(saturated.monitor(each, "after0").size for each in warm)
    (segment,) = (each for each in saturated.record.segments if each.kind == "iteration")
    left = np.sort(saturated.monitor(segment, "after0")["received_ns"])
    if left.size != saturated.playback(segment).size:
        raise SystemExit(f"{case.name}: a saturated relay lost messages; its queue is too short")
    drawn = service_times_ns(case.mean_ms, case.jitter, 0)
    # The time before the first message is not one between messages.
    times = list(itertools.islice(drawn, before + 1, before + left.size))
    overhead_ms = (float(left[-1] - left[0]) - sum(times)) / len(times) / 1e6
    return 1e3 / (case.mean_ms + overhead_ms), overhead_ms


def rows(cases: list[Case], truth_s: int) -> Iterator[list[str]]:
    """The rows of the table."""
    with tempfile.TemporaryDirectory(prefix="peak-calibration-") as scratch:
        for number, case in enumerate(cases):
            folder = Path(scratch) / str(number)
            rate = {"rates": [f"{2 * case.about_hz:g} Hz"], "duration": f"{truth_s} s"}
            ends = {"min": f"{case.about_hz / 5:g} Hz", "max": f"{case.about_hz * 3:g} Hz"}
            before = capacity(case, play(case, rate | {"iterations": 1}, folder / "before"))
            found = play(case, {"search": ends}, folder / "search")
            after = capacity(case, play(case, rate | {"iterations": 1}, folder / "after"))
            yield _row(case, sorted((before, after)), found)


def _row(case: Case, truths: list[tuple[float, float]], found: Run) -> list[str]:
    search = found.record.search
    assert search is not None
    (low_hz, most_ms), (high_hz, least_ms) = truths
    truth_hz = (low_hz + high_hz) / 2
    held, upper = search.holds_hz, search.upper_hz
    tell(f"{case.name}: truth {low_hz:.4g} to {high_hz:.4g} Hz, peak {peak_text(search)}")
    return [
        case.name,
        f"{low_hz:.4g} and {high_hz:.4g} Hz",
        f"{least_ms:.2f} and {most_ms:.2f} ms",
        "nothing" if held is None else f"{held:.4g} Hz",
        "nothing" if upper is None else f"{upper:.4g} Hz",
        f"{(held or 0) / truth_hz:.3f} … {'' if upper is None else f'{upper / truth_hz:.3f}'}",
        _holds_it(search, low_hz, high_hz),
        f"{len(search.probes)}, of them open {sum(each.holds is None for each in search.probes)}",
        f"{_seconds(found):.0f} s",
    ]


def _holds_it(search: SearchRecord, low_hz: float, high_hz: float) -> str:
    """Whether the bracket holds the truth, or part of its range.

    A rate is proven up to a quarter of the precision.
    """
    low = (search.holds_hz or 0.0) <= high_hz * (1 + search.precision / 4)
    return "yes" if low and (search.upper_hz is None or search.upper_hz > low_hz) else "no"


def _seconds(found: Run) -> float:
    times = {text: at for at, text in found.record.events if text.startswith("phase")}
    return float(times["phase collect"] - times["phase search"]) / 1e9


def main() -> None:
    """Measure and print."""
    parser = options(__doc__)
    parser.add_argument("--quick", action="store_true", help="the middle capacity only")
    parser.add_argument("--only", default="", help="cases whose name has this text")
    given = parser.parse_args()
    cases = [
        Case(relays, jitter, about_hz)
        for relays in (1, 3)
        for jitter in ("none", "exponential")
        for about_hz in (_HZ[1:2] if given.quick else _HZ)
    ]
    cases = [each for each in cases if given.only in each.name]
    began = time.monotonic()
    load = os.getloadavg()[0]
    head = ("relays", "truth", "overhead", "held", "did not hold", "in shares of the truth")
    lines = table(
        (*head, "holds it", "probes", "search"),
        rows(cases, _QUICK_TRUTH_S if given.quick else _TRUTH_S),
    )
    for line in lines:
        show(line)
    loads = f"load average before {load:.1f}, after {os.getloadavg()[0]:.1f}"
    show("", f"{time.monotonic() - began:.0f} s; {loads}; {machine()}")


if __name__ == "__main__":
    main()
