"""Probes of single servers close to their capacity: D/D/1, D/M/1, M/D/1 and M/M/1 queues.

The player offers steps at even intervals (D) or at random (M); the server takes equal (D) or
exponential (M) times. The queue is as deep as need be, so that nothing is dropped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from r2bspec.execute.holding import Criterion, judge_finished_probe, judge_probe
from r2bspec.measure.catalogue import METRICS
from r2bspec.measure.delivery import Delivery, delivery
from r2bspec.measure.matching import match
from r2bspec.measure.samples import SegmentSamples, monitor_samples, playback_samples
from r2bspec.record.arrays import MONITOR, PLAYBACK, Rows
from r2bspec.record.model import Probe, Segment
from r2bspec.slo.methods.sustained import judge_sustained
from r2bspec.slo.model import Outcome
from r2bspec.slo.question import Question
from r2bspec.spec.requirement import parse_requirement

Kind = Literal["D/D/1", "D/M/1", "M/D/1", "M/M/1"]

_BEGIN_NS = 7_000_000_000_000_000
_STAMP_NS = 1_800_000_000_000_000_000
_WATCH_S = 0.25
_PRECISION = 0.02


@dataclass(frozen=True)
class Probed:
    """How a probe ended: what was found, what is made of it, and whether before its time."""

    holds: bool
    outcome: Outcome | Literal["invalid"]
    stopped_early: bool


def probe(
    kind: Kind, load: float, *, seconds: float, capacity_hz: float = 100.0, seed: int = 0
) -> Probed:
    """Probe a server at a share `load` of its capacity, as the controller does."""
    random = np.random.default_rng(seed)
    rate_hz = load * capacity_hz
    steps = round(seconds * rate_hz)
    even = np.arange(steps) / rate_hz
    arrive_s = np.cumsum(random.exponential(1 / rate_hz, steps)) if kind[0] == "M" else even
    serve_s = np.full(steps, 1 / capacity_hz)
    if kind[2] == "M":
        serve_s = random.exponential(1 / capacity_hz, steps)
    leave_s = departures(arrive_s, serve_s)
    playback, monitor = _rows(arrive_s, leave_s)
    criterion = Criterion(precision=_PRECISION)
    now_s = _WATCH_S
    while now_s < arrive_s[-1]:
        seen = _delivery(rate_hz, playback, monitor, now_s)
        if judge_probe(seen, criterion, now_s).holds is not None:
            break
        now_s += _WATCH_S
    played = playback[playback["published_ns"] <= _BEGIN_NS + round(now_s * 1e9)]
    answers = monitor[: played.size]
    end_s = max(now_s, float(answers["received_ns"][-1] - _BEGIN_NS) / 1e9) + 0.5
    final = judge_finished_probe(_delivery(rate_hz, played, answers, end_s), criterion)
    return Probed(
        holds=bool(final.holds),
        # Random arrivals are at times too few for the rate that was asked for: no verdict then.
        outcome="invalid"
        if final.by_player
        else _judged(rate_hz, bool(final.holds), played, answers),
        stopped_early=now_s < arrive_s[-1],
    )


def _judged(rate_hz: float, holds: bool, played: Rows, answers: Rows) -> Outcome:
    """What the verdict makes of the probe."""
    segment = Segment(
        id="sustained-001",
        kind="sustained",
        rate_hz=rate_hz,
        index=1,
        steps=played.size,
        began_ns=_BEGIN_NS,
        ended_ns=int(played["due_ns"][-1]),
        complete=True,
    )
    samples = SegmentSamples(
        segment=segment,
        playback=playback_samples(played),
        monitors={"out": monitor_samples(segment, played, answers, "stamp")},
        processes={},
        machine=None,
    )
    found = Probe(segment=segment.id, rate_hz=rate_hz, delivered_hz=rate_hz, holds=holds, reason="")
    question = Question(
        "slo", parse_requirement("sustained"), rate_hz, METRICS["sustained"], None, math.nan
    )
    return judge_sustained(question, (found,), samples, _PRECISION).outcome


def departures(arrive_s: NDArray[np.float64], serve_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lindley: d_i = max(a_i, d_(i-1)) + s_i, in closed form with running sums and maxima."""
    served = np.cumsum(serve_s)
    return served + np.maximum.accumulate(arrive_s - (served - serve_s))


def _rows(arrive_s: NDArray[np.float64], leave_s: NDArray[np.float64]) -> tuple[Rows, Rows]:
    playback = np.zeros(arrive_s.size, PLAYBACK)
    playback["stamp_ns"] = _STAMP_NS + np.arange(arrive_s.size)
    playback["due_ns"] = _BEGIN_NS + np.round(arrive_s * 1e9).astype(np.int64)
    playback["published_ns"] = playback["due_ns"]
    monitor = np.zeros(leave_s.size, MONITOR)
    monitor["stamp_ns"] = playback["stamp_ns"]
    monitor["received_ns"] = _BEGIN_NS + np.round(leave_s * 1e9).astype(np.int64)
    return playback, monitor


def _delivery(rate_hz: float, playback: Rows, monitor: Rows, now_s: float) -> Delivery:
    now_ns = _BEGIN_NS + round(now_s * 1e9)
    played = playback[playback["published_ns"] <= now_ns]
    seen = monitor[monitor["received_ns"] <= now_ns]
    return delivery(rate_hz, played, seen, match(played, seen, "stamp"), now_ns)
