"""Whether an offered rate is sustained, by the one sequential probe that was made of it.

A probe is stopped as soon as its answer is clear (`r2bspec.execute`), or at its end. What it shows
then is judged like everything else, each way by the test that suits what is to be shown:

    PASS    The probe held, and the latency does not grow by the precision. While a graph keeps up,
            latencies scatter about a line. By how much the line climbs, seconds per second, is
            the share of the load that piles up; its upper bound (`r2bspec.slo.statistics.trend`)
            must be at most precision / 2.
    FAIL    The probe did not hold, and clearly so. While a graph does not keep up, what it has
            done with is a random walk of service times. With its rate and the standard error by
            batch means over b batches (`r2bspec.measure.delivery`), and the rate played,
                settled + t_c(b - 1) x error < (1 - precision / 2) x played.
            A probe that did not hold for another reason (messages dropped, a condition of the
            spec) fails as well.

Everything between is INCONCLUSIVE: a graph whose service times vary by as much as they last needs
ten seconds and more to show at 100 Hz that it keeps up with 90 % of its capacity.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from r2bspec.measure.delivery import delivery_of_steps
from r2bspec.measure.samples import MonitorSamples, SegmentSamples
from r2bspec.measure.units import show
from r2bspec.record.model import Probe
from r2bspec.slo.question import Answer, Question
from r2bspec.slo.statistics.trend import trend

_LEAST_BATCHES = 3


def judge_sustained(
    question: Question,
    probes: Iterable[Probe],
    samples: SegmentSamples | None,
    precision: float,
) -> Answer:
    """Decide ``sustained``: the rate is kept up if its probe held, and clearly so.

    Args:
        question: what is asked.
        probes: the sequential probes of the run; the last one at the rate decides.
        samples: what was played and seen in it, where the run has that.
        precision: of the probe, as a fraction.
    """
    found = [
        probe
        for probe in probes
        if question.at_hz is not None and math.isclose(probe.rate_hz, question.at_hz)
    ]
    if not found:
        where = f" at {show(question.at_hz, 'Hz')}" if question.at_hz is not None else ""
        return Answer(
            outcome="inconclusive",
            method="none",
            reason=f"This run has no probe{where}.",
            settle="Run the spec that states this objective.",
        )
    probe = found[-1]
    said = f": {probe.reason}" if probe.reason else ""
    kept = "held" if probe.holds else "did not hold"
    reason = f"{show(probe.rate_hz, 'Hz')} {kept}{said} ({show(probe.delivered_hz, 'Hz')} came out)"
    if samples is not None and not _is_clear(question, probe, samples, precision):
        return Answer(
            outcome="inconclusive",
            method="sequential probe",
            reason=f"{reason}, but not clearly at {question.confidence_text}.",
            settle="Probe for longer (benchmark.search.probe), or offer a rate further from the "
            "graph's capacity.",
            estimate=probe.delivered_hz,
            n=1,
        )
    return Answer(
        outcome="pass" if probe.holds else "fail",
        method="sequential probe",
        reason=f"{reason}.",
        estimate=probe.delivered_hz,
        n=1,
    )


def _is_clear(question: Question, probe: Probe, samples: SegmentSamples, precision: float) -> bool:
    """Whether what a probe found is shown for each monitor; one that fails, fails for any."""
    clear = _keeps_up if probe.holds else _falls_behind
    found = [
        clear(probe.rate_hz, seen, precision / 2, question.confidence)
        for seen in samples.monitors.values()
    ]
    return all(found) if probe.holds else any(found)


def _keeps_up(_: float, seen: MonitorSamples, growth: float, confidence: float) -> bool:
    steps = seen.steps
    answered = steps.answered
    times = (steps.published_ns - steps.published_ns[:1])[answered] / 1e9
    return trend(times, seen.times["latency"], confidence).upper <= growth


def _falls_behind(rate_hz: float, seen: MonitorSamples, growth: float, confidence: float) -> bool:
    from scipy.special import stdtrit

    found = delivery_of_steps(rate_hz, seen.steps, seen.per_step)
    limit_hz = (1 - growth) * min(found.offered_hz, found.player_hz)
    if found.settled_hz >= limit_hz or found.batches < _LEAST_BATCHES:
        # It did not hold for another reason, or fell silent at once.
        return True
    quantile = float(stdtrit(found.batches - 1, confidence))
    return found.settled_hz + quantile * found.settled_error_hz < limit_hz
