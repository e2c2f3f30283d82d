"""A bound on the peak rate, by the bracket in which the search ended.

The peak lies between the highest sustained rate and the lowest rate that was not sustained. A
bracket decides a bound that lies outside it, and only that. A lower end that was not proven by a
whole play, or that the iterations at the peak refute, decides nothing. If the graph is not steady,
both ends are moved apart by the ratio of its speeds: what lies further away is decided all the
same. If no rate failed, because the range of
the search ended or the player could offer no more, the peak has no upper bound. Undecided probes
leave the bracket wide, and decide nothing within it.
"""

from __future__ import annotations

from r2bspec.judge.decision import Answer, Decider, Question, decide
from r2bspec.judge.interference_policy import REMEDY
from r2bspec.measure.units import show
from r2bspec.record.run_record import SearchRecord


def judge_peak(question: Question, search: SearchRecord | None) -> Answer:
    """Decide a requirement on ``peak.rate``."""
    if search is None or not search.probes:
        return Answer(
            outcome="inconclusive",
            method="none",
            reason="This run did not search for a peak.",
            remedy="Add benchmark.search to the spec and run again.",
        )
    lower = search.holds_hz
    upper = search.upper_hz
    proven = lower if search.proof != "open" and not search.refuted else None
    at_least = _at_least(question, proven and proven / search.unsteady_ratio)
    below = upper is not None and _below(question, upper * search.unsteady_ratio)
    passes, fails = (below, at_least) if question.is_upper_bound else (at_least, below)
    outcome = decide(passes=passes, fails=fails)
    return Answer(
        outcome=outcome,
        method="search bracket",
        reason=_reason(search, lower, upper),
        remedy=_remedy(search) if outcome == "inconclusive" else "",
        estimate=lower,
        lower=proven,
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
    doubts = peak_doubts(search)
    return " ".join([_bracket_text(search, lower, upper), *(f"{each}." for each in doubts)])


def _bracket_text(search: SearchRecord, lower: float | None, upper: float | None) -> str:
    probes = f"{len(search.probes)} probe{'s' if len(search.probes) > 1 else ''}"
    if lower is None:
        lowest = min(probe.rate_hz for probe in search.probes)
        return (
            f"{probes}: even the lowest rate, {show(lowest, 'Hz')}, was not sustained"
            f"{_undecided_text(search)}."
        )
    if upper is not None:
        others = _interference_text(search)
        between = f"{_undecided_text(search)}{f'; {others}' if others else ''}"
        above = "is above the capacity" if _by_capacity(search) else "was not"
        return (
            f"{probes}: {show(lower, 'Hz')} {_kept(search)}, {show(upper, 'Hz')} {above}{between}."
        )
    why = {
        "range": "the upper end of the search range",
        "player": "the highest rate that the player reached",
        "interference": _interference_text(search),
    }.get(search.limited_by, "then the search was interrupted")
    return f"{probes}: {show(lower, 'Hz')} {_kept(search)}, {why}."


def _kept(search: SearchRecord) -> str:
    return "was not shown to be sustained" if search.proof == "open" else "was sustained"


def _by_capacity(search: SearchRecord) -> bool:
    """Whether the upper end is a bound of the capacity, and not a rate that was played."""
    return all(probe.rate_hz != search.fails_hz for probe in search.probes)


def peak_doubts(search: SearchRecord) -> tuple[str, ...]:
    """Why a bracket has no confidence, without full stops; empty if it has."""
    found: list[str] = []
    if search.proof == "open":
        found.append("No rate was confirmed when it was played whole")
    elif search.proof == "probes":
        lost = ""
        if search.lost_at_most is not None:
            lost = f", at most {show(search.lost_at_most, 'share', 2)} lost"
        found.append(f"Only in probes of {show(search.proof_s, 's')}{lost}")
    found += [f"Not steady: {each}" for each in search.unsteady]
    if search.refuted:
        found.append(search.refuted[:1].upper() + search.refuted[1:])
    return tuple(found)


def _undecided_text(search: SearchRecord) -> str:
    """The undecided rates between the ends of the bracket."""
    rates = search.open_hz
    if not rates:
        return ""
    if len(rates) == 1:
        return f"; {show(rates[0], 'Hz')} was undecided"
    return f"; {show(rates[0], 'Hz')} to {show(rates[-1], 'Hz')} was undecided"


def _interference_text(search: SearchRecord) -> str:
    """What others did while rates in the bracket, or above it, were probed."""
    if search.limited_by != "interference":
        return ""
    return f"during the probes above it {', '.join(search.disturbed)}"


def _remedy(search: SearchRecord) -> str:
    if search.limited_by == "interference":
        return REMEDY
    if search.refuted or search.proof == "open":
        return "Require a lower rate to be sustained, or search again with longer probes."
    if search.unsteady:
        return "Find out why the graph is not steady, or require a rate to be sustained."
    if search.open_hz:
        return "Probe for longer (benchmark.search.probe), or change the limit."
    match search.limited_by:
        case "range":
            return "Raise benchmark.search.max beyond the limit."
        case "player":
            return "Use a faster machine for the player, or smaller messages."
        case "interrupted":
            return "Run again and let the search finish."
        case _:
            return "Make benchmark.search.precision finer, or change the limit."


DECIDER = Decider(
    takes=lambda question: question.info.statistic == "search",
    decide=lambda question, record: judge_peak(question, record.search),
    needs_iterations=False,
)
