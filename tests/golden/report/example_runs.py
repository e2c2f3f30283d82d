"""Two runs whose every number is given, as far apart as runs can be."""

from __future__ import annotations

import numpy as np

from r2bspec.record.run_record import SearchRecord
from report_runs import skewed
from run_simulation import Played, Simulation, objective, probe


def _thirty(number: int) -> Played:
    latency = skewed(300, 0.022 + number * 0.0002, number * 300)
    latency[number * 40 + 7] = np.nan
    late = 1e-4 * skewed(300, 1.0, number)
    return Played(30, latency, late=late, twice=(3,) if number == 2 else ())


USUAL = Simulation(
    segments=[
        *(Played(10, skewed(100, 0.02 + number * 0.0001, number * 100)) for number in range(5)),
        *(_thirty(number) for number in range(5)),
    ],
    objectives={
        "camera": objective(
            "latency.p99 < 60 ms",
            "latency.p90 < 24 ms",
            "drop_rate <= 0.5 %",
            "interval.max < 150 ms",
            "throughput.mean >= 97 % of offered",
            "missed == 0",
        ),
        "cheap": objective("cpu.apriltag.mean < 60 %", "memory.apriltag.max < 200 MiB", at="10 Hz"),
        "headroom": objective("sustained", at="35 Hz"),
        "peak": objective("peak.rate >= 100 Hz", at=""),
    },
    search=SearchRecord(
        probes=(
            probe(5, holds=True),
            probe(200, holds=False, reason="the backlog grows by 85 messages/s"),
            probe(117.2, holds=True),
            probe(119.5, holds=False, reason="the backlog grows by 2.1 messages/s"),
        ),
        holds_hz=117.2,
        fails_hz=119.5,
        limited_by="graph",
    ),
    sustained=(probe(35, holds=True),),
)

BROKEN = Simulation(
    segments=[
        *(Played(30, skewed(60, 0.02, number * 60), silent=("extra",)) for number in range(2)),
        Played(60, skewed(120, 0.02, 0), late=np.linspace(0, 0.3, 120)),
        Played(60, skewed(20, 0.02, 0), complete=False),
        Played(10, [np.nan] * 20, strangers=20),
    ],
    objectives={
        "all": objective("latency.p50 < 60 ms", "latncy.p50 < 60 ms", "throughput.mean > 25 Hz"),
        "few": objective("detections.latency.p99 < 60 ms"),
        "late": objective("detections.drop_rate < 1 %", at="60 Hz"),
        "stamps": objective("detections.missed == 0", at="10 Hz"),
        "unplayed": objective("detections.latency.p50 < 1 s", "sustained", at="99 Hz"),
        "unsearched": objective("peak.rate > 3 Hz", at=""),
    },
    monitors=("detections", "extra"),
    status="incomplete",
    reason="process apriltag ended with signal 9",
)
