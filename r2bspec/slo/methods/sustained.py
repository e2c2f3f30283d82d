"""Whether an offered rate is sustained, by the one sequential probe that was made of it."""

from __future__ import annotations

import math
from collections.abc import Iterable

from r2bspec.measure.units import show
from r2bspec.record.model import Probe
from r2bspec.slo.question import Answer, Question


def judge_sustained(question: Question, probes: Iterable[Probe]) -> Answer:
    """Decide ``sustained``: the rate is kept up if its probe held."""
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
    return Answer(
        outcome="pass" if probe.holds else "fail",
        method="sequential probe",
        reason=f"{show(probe.rate_hz, 'Hz')} {kept}{said} ({show(probe.delivered_hz, 'Hz')} "
        "came out).",
        estimate=probe.delivered_hz,
        n=1,
    )
