"""A bound on the peak rate, by the bracket that the search ended with.

The peak lies in [holds, fails): the highest rate that held and the lowest that did not. A bracket
decides a bound that lies outside it, and only that. Where nothing failed, because the range of the
search ended or the player could offer no more, the peak is at least `holds` and not bounded above.
Probes that stayed open leave the bracket wide, and decide nothing within it.
"""

from __future__ import annotations

from r2bspec.judge.decision import Answer, Decider, Question, decide
from r2bspec.measure.units import show
from r2bspec.record.run_record import SearchRecord


def judge_peak(question: Question, search: SearchRecord | None) -> Answer:
    """Decide a requirement on ``peak.rate``."""
    if search is None or not search.probes:
        return Answer(
            outcome="inconclusive",
            method="none",
            reason="This run has not searched for a peak.",
            settle="Add benchmark.search to the spec and run again.",
        )
    lower = search.holds_hz
    upper = search.upper_hz
    at_least = _at_least(question, lower)
    below = upper is not None and _below(question, upper)
    passes, fails = (below, at_least) if question.is_upper_bound else (at_least, below)
    outcome = decide(passes=passes, fails=fails)
    return Answer(
        outcome=outcome,
        method="search bracket",
        reason=_reason(search, lower, upper),
        settle=_settle(search) if outcome == "inconclusive" else "",
        estimate=lower,
        lower=lower,
        upper=upper,
        n=len(search.probes),
    )


def _at_least(question: Question, lower: float | None) -> bool:
    """Whether every rate of the bracket lies on the high side of the limit."""
    if lower is None:
        return False
    # '<' and '>=' share one boundary, '<=' and '>' the other.
    return (
        lower >= question.limit
        if question.requirement.op in {"<", ">="}
        else (lower > question.limit)
    )


def _below(question: Question, upper: float) -> bool:
    """Whether every rate of the bracket, which ends before `upper`, is below the limit."""
    return upper <= question.limit


def _reason(search: SearchRecord, lower: float | None, upper: float | None) -> str:
    probes = f"{len(search.probes)} probe{'s' if len(search.probes) > 1 else ''}"
    if lower is None:
        lowest = min(probe.rate_hz for probe in search.probes)
        return f"In {probes}, not even {show(lowest, 'Hz')} held{_undecided_text(search)}."
    if upper is not None:
        between = _undecided_text(search)
        return f"In {probes}, {show(lower, 'Hz')} held and {show(upper, 'Hz')} did not{between}."
    why = {
        "range": "which is the end of the search's range",
        "player": "and the player could offer no more",
    }.get(search.limited_by, "and then the search was interrupted")
    return f"In {probes}, {show(lower, 'Hz')} held, {why}."


def _undecided_text(search: SearchRecord) -> str:
    """What stayed open between the ends of the bracket."""
    rates = search.open_hz
    if not rates:
        return ""
    if len(rates) == 1:
        return f"; {show(rates[0], 'Hz')} stayed open"
    return f"; from {show(rates[0], 'Hz')} to {show(rates[-1], 'Hz')} it stayed open"


def _settle(search: SearchRecord) -> str:
    if search.open_hz:
        return "Probe for longer (benchmark.search.probe), or move the limit."
    match search.limited_by:
        case "range":
            return "Raise benchmark.search.max beyond the limit."
        case "player":
            return "Use a faster machine for the player, or smaller messages."
        case "interrupted":
            return "Let the search end."
        case _:
            return "Make benchmark.search.precision finer, or move the limit."


DECIDER = Decider(
    takes=lambda question: question.info.statistic == "search",
    decide=lambda question, record: judge_peak(question, record.search),
    needs_iterations=False,
)
