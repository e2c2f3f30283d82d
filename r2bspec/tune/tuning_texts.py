"""What is said of a space and of a search, the same in the terminal, in Markdown and on the page.

What the winner gives is claimed from the interleaved pairs alone: the cheapest of many trials is
cheap by luck, too, so that what the search saw of it is shown beside, and never as the result.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from r2bspec.diagnostics.quote import pluralize, time_text
from r2bspec.judge.measure.units import show
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.plan.tuning_space import Lever, Setting, TuningSpace
from r2bspec.tune.machine import Pairs
from r2bspec.tune.tuning_result import (
    MAX_EXCESS,
    Gain,
    RequirementMargin,
    Trial,
    TrialState,
    TuningResult,
)

STATE_WORDS: Final[Mapping[TrialState, str]] = {
    "meets": "✔ meets",
    "misses": "✘ misses",
    "open": "? open",
    "broken": "! broken",
    "refused": "– refused",
    "invalid": "– invalid",
}
"""Each state with its mark: never shown by colour alone."""

_ORDER: Final[Sequence[TrialState]] = ("meets", "open", "misses", "broken", "refused", "invalid")


def headline(result: TuningResult) -> str:
    """The outcome in one line."""
    return f"{result.name}: {result.reason}"


_DECIDES: Final = ("pass", "inconclusive", "fail")


def _worst(trial: Trial) -> RequirementMargin:
    """The requirement that says why a trial is where it is: one that fails, or is open, first."""
    return max(trial.margins, key=lambda each: (_DECIDES.index(each.outcome), each.excess))


def margin_text(margin: RequirementMargin) -> str:
    """A requirement, its metric, and how far that is from the limit."""
    is_lost = margin.estimate is None and margin.outcome == "fail"
    text = f"{margin.text}: {'lost' if is_lost else show(margin.estimate, margin.unit)}"
    if not margin.estimate or abs(margin.excess) >= MAX_EXCESS:
        return text
    off = _percent(abs(math.expm1(margin.excess))).lstrip("+")
    return f"{text}, {off} {'beyond' if margin.excess > 0 else 'inside'}"


def requirement_lines(result: TuningResult) -> list[str]:
    """The requirements of the winner, as the pairs judge them."""
    marks = {"pass": "✔", "fail": "✘", "inconclusive": "?"}
    return [f"{marks[each.outcome]} {margin_text(each)}" for each in result.requirements]


def unproven_text(seen: Pairs) -> str:
    """Which requirements the pairs do not show to be met, with what they measured."""
    if seen.reason:
        return f"The pairs say nothing: {seen.reason}"
    return f"The pairs do not show that it meets {open_text(seen)}."


def failed_text(seen: Pairs) -> str:
    """The requirements that are shown not to be met; empty if none is."""
    return ", ".join(each.text for each in seen.margins if each.outcome == "fail")


def open_text(seen: Pairs) -> str:
    """The requirements that are not shown to be met, with what was measured."""
    return ", ".join(
        f"{each.text} ({show(each.estimate, each.unit)})"
        for each in seen.margins
        if each.outcome != "pass"
    )


def plan_line(result: TuningResult, trials: int) -> str:
    """What a search is about to do."""
    return (
        f"{pluralize(result.space.size, 'deployment')} of "
        f"{pluralize(len(result.space.levers), 'lever')}; at most {pluralize(trials, 'trial')} in "
        f"{time_text(result.budget_s)}; the cost is {result.goal}"
    )


def claim_text(gain: Gain) -> str:
    """What the pairs say of a change: ``-28 % (-31 to -24 %), 8 pairs``."""
    pairs = pluralize(gain.pairs, "pair")
    if gain.ratio is None:
        return f"not measured, {pairs}"
    return f"{change_text(gain)} ({interval_text(gain)}), {pairs}"


def change_text(gain: Gain) -> str:
    """By how much a metric changes; empty where that is not known."""
    return "" if gain.ratio is None else _percent(gain.ratio - 1)


def interval_text(gain: Gain) -> str:
    """The interval of a change, with its unit once, and its confidence unless that is 95 %."""
    if gain.lower is None or gain.upper is None:
        return "no interval"
    lower, upper = _percent(gain.lower - 1), _percent(gain.upper - 1)
    sure = gain.confidence
    at = "" if math.isclose(sure, CONFIDENCE) else f" at {show(sure, 'share', 4)}"
    return f"{lower.removesuffix(' %')} to {upper}{at}"


def _percent(change: float) -> str:
    if math.isinf(change):
        return "∞ %"
    digits = 0 if abs(change) >= 0.0995 else 1
    return f"{100 * change:+,.{digits}f} %"


class TrialRow(NamedTuple):
    """A trial as texts."""

    number: str
    state: TrialState
    word: str
    cost: str
    margin: str
    deployment: str
    reason: str


TRIAL_HEADER: Final = ("", "outcome", "cost", "requirement", "deployment", "reason")


def trial_rows(result: TuningResult) -> list[TrialRow]:
    """All trials, the best first: by cost if they meet the requirements, else by what they miss."""
    return [_trial_row(trial, result) for trial in sorted(result.trials, key=_rank)]


def _trial_row(trial: Trial, result: TuningResult) -> TrialRow:
    is_winner = result.is_proved and trial.deployment == result.winner
    return TrialRow(
        number=str(trial.number),
        state=trial.state,
        word=STATE_WORDS[trial.state],
        cost=show(trial.cost, result.goal_unit),
        margin=_decisive_text(trial),
        deployment=f"{trial.deployment.text}{' (proposed)' if is_winner else ''}",
        reason="; ".join(_reasons(trial)),
    )


def _decisive_text(trial: Trial) -> str:
    if not trial.margins:
        return ""
    worst = _worst(trial)
    text = margin_text(worst)
    if worst.outcome != "inconclusive":
        return text
    return f"{text}, not decided by {pluralize(trial.starts, 'start')}"


def trial_line(trial: Trial, result: TuningResult) -> str:
    """One trial in a line, as it ends."""
    row = _trial_row(trial, result)
    why = "; ".join(filter(None, (row.margin, row.reason)))
    aside = f" ({why})" if why else ""
    return f"{row.number:>3} {row.word:<9} {row.cost:>7}  {row.deployment}{aside}"


def _reasons(trial: Trial) -> Iterator[str]:
    """What the margin does not say."""
    if trial.reason and not (trial.margins and trial.reason == _worst(trial).text):
        yield trial.reason
    if trial.anatomy:
        yield trial.anatomy


def _rank(trial: Trial) -> tuple[int, float, float, int]:
    cost = math.inf if trial.cost is None else trial.cost
    excess = 0.0 if trial.state == "meets" else trial.excess
    return _ORDER.index(trial.state), excess, cost, trial.number


def gain_header(result: TuningResult) -> tuple[str, ...]:
    """The columns of gains."""
    return ("lever", "before", "after", "change", interval_title(result), "pairs")


def interval_title(result: TuningResult) -> str:
    """What the intervals of gains are called: by their confidence, where it is one for all."""
    gains = [*([result.proof] if result.proof else []), *result.levers, *result.dropped]
    confidences = {gain.confidence for gain in gains if gain.lower is not None}
    if len(confidences) != 1:
        return "interval"
    return f"{show(confidences.pop(), 'share', 3)} interval"


class GainTable(NamedTuple):
    """Gains under a heading, what is compared beside it, and sentences below it."""

    title: str
    aside: str
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()


def gain_tables(result: TuningResult) -> Iterator[GainTable]:
    """The proof, with the requirements that it judged, and the levers; none that is empty."""
    if result.proof is not None:
        said = seen_and_proven(result)
        yield GainTable(
            "Proof",
            f"{result.goal}, of the whole against today's deployment",
            gain_rows([result.proof]),
            [*requirement_lines(result), *([said] if said else [])],
        )
    levers = [*gain_rows(result.levers), *gain_rows(result.dropped, " – dropped, it gives nothing")]
    if levers:
        yield GainTable("Levers", f"{result.goal}, each against the proposal without it", levers)


def gain_rows(gains: Iterable[Gain], verdict: str = "") -> list[tuple[str, ...]]:
    """Gains as texts, a column of `gain_header` each."""
    return [
        (
            f"{gain.change if gain.lever else 'all of it'}{verdict}",
            show(gain.before, gain.unit),
            show(gain.after, gain.unit),
            change_text(gain) or "-",
            interval_text(gain),
            str(gain.pairs),
        )
        for gain in gains
    ]


def seen_and_proven(result: TuningResult) -> str:
    """What the search saw of the winner, against what the pairs say; empty without either."""
    today = result.trials[0].cost if result.trials else None
    if result.unproven is None or not today or result.proof is None:
        return ""
    return (
        f"The search saw {show(result.unproven, result.goal_unit)} for it and "
        f"{show(today, result.goal_unit)} for today's ({_percent(result.unproven / today - 1)}), "
        f"once each and chosen for being low; the pairs say {claim_text(result.proof)}."
    )


def winner_title(result: TuningResult) -> str:
    """What `winner_lines` are."""
    return "Proposed" if result.is_proved else "Not proved, so not proposed"


def winner_lines(result: TuningResult) -> Iterator[str]:
    """What is to be changed, a line each."""
    for choice in result.winner.choices if result.winner is not None else ():
        yield f"{choice.lever}: {choice.setting.text}"


def facts(result: TuningResult) -> str:
    """How the search was made, in one line."""
    machine = [
        str(result.machine.get("cpu", "")),
        f"{result.machine['cores']} cores" if "cores" in result.machine else "",
    ]
    hosts = result.machine.get("hosts")
    if isinstance(hosts, list):
        machine.append(f"hosts {', '.join(map(str, hosts))}")
    budget = f" of {time_text(result.budget_s)}" if result.budget_s else ""
    tried = (
        f"{len(result.trials):,} of {result.space.size:,} deployments tried in "
        f"{_spent_text(result.duration_s)}{budget}"
    )
    return " · ".join(filter(None, (tried, f"seed {result.seed}", *machine, result.started_at)))


def _spent_text(seconds: float) -> str:
    """A time that has gone by: not rounded up, as what is expected is."""
    return f"{seconds / 60:.1f} min" if seconds >= 60 else f"{seconds:.0f} s"


def remarks(result: TuningResult) -> Iterator[tuple[str, Sequence[str]]]:
    """Further sentences by their headings; none that is empty."""
    alone = requirement_lines(result) if result.proof is None else ()
    for title, sentences in (
        ("Proof, by its own runs, as today's deployment does not work", alone),
        ("What it changes for others on this machine", result.for_others),
        ("Notes", result.notes),
        ("Not tried, because a model ruled it out", result.predicted),
        ("Not part of the search", result.space.left_out),
    ):
        if sentences:
            yield title, sentences


_WIDTH: Final = 100


def space_text(space: TuningSpace) -> str:
    """The levers, each with its settings, today's first; then what is left out and why."""
    return "".join(f"{line}\n" for line in _space_lines(space))


def _space_lines(space: TuningSpace) -> Iterator[str]:
    yield (
        f"{pluralize(space.size, 'deployment')}, today's among them, of "
        f"{pluralize(len(space.levers), 'lever')}; today's setting comes first"
    )
    yield ""
    deciding = {name for lever in space.levers for name in lever.only_with}
    for lever in space.levers:
        texts = [_setting_text(each) for each in lever.settings]
        if lever.name in deciding:
            yield lever.name
            yield from (f"  {place}: {text}" for place, text in enumerate(texts))
            continue
        line = f"{lever.name}: {' | '.join(texts)}{_condition_text(lever)}"
        yield from textwrap.wrap(line, _WIDTH, subsequent_indent="    ", break_on_hyphens=False)
    if space.left_out:
        yield ""
        yield "Left out:"
        for reason in space.left_out:
            yield from textwrap.wrap(reason, _WIDTH, initial_indent="  ", subsequent_indent="    ")


def _setting_text(setting: Setting) -> str:
    return f"{setting.text} ({setting.for_others})" if setting.for_others else setting.text


def _condition_text(lever: Lever) -> str:
    """The settings of other levers with which it has an effect, by their numbers."""
    conditions = (f"{name} {', '.join(map(str, at))}" for name, at in lever.only_with.items())
    return "".join(f"; with {condition} only" for condition in conditions)
