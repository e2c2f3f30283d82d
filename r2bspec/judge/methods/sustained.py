"""Whether an offered rate is sustained, by its sequential probe.

The probe is a sequential test with three outcomes and a stated error
(`r2bspec.judge.rate_decision`): it was stopped as soon as it was decided, and is undecided if it
was not in the longest time that a probe may take. Testing its samples again would test a sample
whose size the first test has chosen, so the recorded outcome counts:

    PASS            the rate was sustained
    FAIL            the backlog grew, messages were dropped, or a condition of the spec was not met
    INCONCLUSIVE    the probe was undecided
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from r2bspec.judge.decision import Answer, Decider, Question
from r2bspec.judge.verdict import Outcome
from r2bspec.measure.units import show
from r2bspec.record.run_record import Probe

_ANSWER_TEXTS: Final = {True: "was sustained", False: "was not sustained", None: "was undecided"}
_OUTCOMES: Final[dict[bool | None, Outcome]] = {True: "pass", False: "fail", None: "inconclusive"}

_REMEDY = (
    "Probe for longer (benchmark.search.probe), or offer a rate further from the graph's capacity."
)


def judge_sustained(question: Question, probes: Iterable[Probe]) -> Answer:
    """Decide ``sustained`` by the probe of the rate.

    Args:
        question: to be decided.
        probes: the sequential probes of the run; the last one at the rate decides.
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
            remedy="Run the spec of this objective.",
        )
    probe = found[-1]
    said = f": {probe.reason}" if probe.reason else ""
    throughput = f"throughput {show(probe.delivered_hz, 'Hz')}"
    return Answer(
        outcome=_OUTCOMES[probe.holds],
        method="sequential probe",
        reason=f"{show(probe.rate_hz, 'Hz')} {_ANSWER_TEXTS[probe.holds]}{said} ({throughput}).",
        remedy=_REMEDY if probe.holds is None else "",
        estimate=probe.delivered_hz,
        n=1,
    )


DECIDER = Decider(
    takes=lambda question: question.info.statistic == "sequential",
    decide=lambda question, record: judge_sustained(question, record.sustained),
    needs_iterations=False,
)
