"""Objectives that a run proposes for its spec.

A limit is the measured value with a margin: 1.3 times, or more if the starts scatter (in a run of
one start, the iterations): three standard deviations of their logarithms. If that doubles the
value, nothing is proposed. A limit is never below the largest value of a start. If the spec has a
gate, a limit `of baseline` is proposed beside it, which no run alone can show: of the work, which
other programs disturb least, or, if that was not measured, of the median latency.

Of the percentiles, the highest is proposed whose requirement the run itself passes: one that needs
more messages than were played would be inconclusive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean, stdev
from typing import NamedTuple

from r2bspec.judge.measure.distribution import PROPOSED_PERCENTILES, part_value
from r2bspec.judge.measure.metrics import RateMetrics
from r2bspec.judge.result import Result
from r2bspec.language.comparison_grammar import Requirement, parse_requirement
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, TreeNode, lookup
from r2bspec.language.quantities import Rate
from r2bspec.language.spec import Objective, Spec


def _objective_lines(name: str, at: str, requirements: Iterable[str]) -> list[str]:
    """Return an objective as it is written below ``slos``."""
    rate = [f"  at: {at}"] if at else []
    return [
        f"{name}:",
        *rate,
        "  require:",
        *(f"    - {requirement}" for requirement in requirements),
    ]


def insert_objective(loaded: LoadedSpec, text: str, lines: list[str]) -> str | None:
    """Return the text with an objective at the end of ``slos``.

    None if it has to be added by hand.
    """
    slos = lookup(loaded.tree, ("slos",)) if loaded.tree is not None else None
    if slos is None:
        end = "" if text.endswith("\n") or not text else "\n"
        body = "".join(f"  {line}\n" for line in lines)
        return f"{text}{end}\nslos:\n{body}"
    if not isinstance(slos, MapNode) or not slos.entries:
        return None
    keys = [entry.key_span for entry in slos.entries.values()]
    columns = {key.column for key in keys}
    first = next(iter(keys))
    written = text.splitlines(keepends=True)
    if any(key.file != loaded.file for key in keys) or len(columns) > 1:
        return None
    # In flow style the keys follow a brace.
    if written[first.line - 1][: first.column - 1].strip():
        return None
    last = max(_last_line(entry.value) for entry in slos.entries.values())
    indent = " " * (first.column - 1)
    if not written[last - 1].endswith("\n"):
        written[last - 1] += "\n"
    return "".join([*written[:last], *(f"{indent}{line}\n" for line in lines), *written[last:]])


def _last_line(node: TreeNode) -> int:
    """Return the last line of a value."""
    if isinstance(node, MapNode) and node.entries:
        return max(_last_line(entry.value) for entry in node.entries.values())
    if isinstance(node, ListNode) and node.items:
        return max(_last_line(item) for item in node.items)
    span = node.span
    return span.end_line if isinstance(node, ScalarNode) else max(span.line, span.end_line)


MIN_ITERATIONS = 3
"""With fewer, the scatter of the iterations says nothing about the next one."""

_PARTS = tuple(reversed(PROPOSED_PERCENTILES))
_SHARES = (0.001, 0.005, 0.01, 0.02, 0.05)
"""Shares of lost messages that are proposed, the smallest that the run passes."""

_WORK_LIMIT = "work.graph.p50 <= 105 % of baseline"
_PEAK_STEPS = 2
"""By how many times the precision of the search the limit is below the peak that it found."""

Judge = Callable[[Mapping[str, Objective]], Result]
"""Judges the run by other objectives."""


@dataclass(slots=True)
class Proposal:
    """A proposed change of a spec.

    Attributes:
        text: the spec with the proposed objectives; unchanged if there are none.
        added: the proposed requirements, by the name of their objective.
        notes: what was not proposed, and why, a sentence each.
    """

    text: str
    added: dict[str, list[str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


class _Candidate(NamedTuple):
    """Requirements of which the first that the run passes is proposed; the only one, if certain."""

    objective: str
    at: str
    what: str
    texts: Sequence[str]
    why: str = ""
    certain: bool = False


def propose_objectives(loaded: LoadedSpec, text: str, result: Result, judge: Judge) -> Proposal:
    """Return a spec with objectives from the values that a run measured.

    Metrics for which the spec already has a requirement at the same rate are left alone.

    Args:
        loaded: the spec.
        text: its text.
        result: the result of the run.
        judge: judges the run by other objectives.
    """
    proposal = Proposal(text)
    if loaded.spec is None:
        return proposal
    gated = _has_gate(loaded.spec, loaded.tree)
    candidates = [
        *(
            candidate
            for rate in result.metrics.rates
            for candidate in _candidates(loaded.spec, rate, proposal.notes, gated=gated)
        ),
        *_peak_candidates(loaded.spec, result, proposal.notes),
    ]
    passed = _passed(candidates, judge)
    for candidate in candidates:
        fitting = (
            each
            for each in candidate.texts
            if candidate.certain or (candidate.objective, each) in passed
        )
        chosen = next(fitting, None)
        if chosen is None:
            proposal.notes.append(f"{candidate.what}: the run is too short to show a limit")
            continue
        if candidate.why:
            proposal.notes.append(f"{chosen}: {candidate.why}")
        proposal.added.setdefault(candidate.objective, []).append(chosen)
    if disturbed := len(result.verdict.disturbed):
        played = sum(len(rate.iterations) for rate in result.metrics.rates)
        proposal.notes.append(
            f"other programs disturbed {disturbed} of {played} iterations: these limits are those "
            "of a busy machine, and a quiet one may have tighter ones"
        )
    _insert(loaded, proposal, {each.objective: each.at for each in candidates})
    return proposal


def _has_gate(spec: Spec, tree: TreeNode | None) -> bool:
    """Return True if the spec says how it is gated, or compares something with the base."""
    if tree is not None and lookup(tree, ("benchmark", "gate")) is not None:
        return True
    objectives = spec.slos.values()
    return any(limit.of_baseline for objective in objectives for limit in objective.require)


def _candidates(
    spec: Spec, rate: RateMetrics, notes: list[str], *, gated: bool
) -> Iterator[_Candidate]:
    """Yield what can be required at a rate: work, latencies and losses."""
    at = f"{rate.offered_hz:g} Hz" if rate.pace == "rate" else ""
    measured = f"measured_at_{rate.offered_hz:g}_hz".replace(".", "_") if at else "measured"
    name, at_rate = _free_name(spec, measured), f" at {at}" if at else ""
    required = [*_required(spec, rate)]
    has_work = "work.graph" in rate.pooled.values
    if gated and has_work and not any(each.startswith("work.graph.") for each in required):
        yield _Candidate(name, at, "work.graph", (_WORK_LIMIT,), certain=True)
    for monitor, pooled in rate.pooled.monitors.items():
        stated = {each.removeprefix(f"{monitor}.").split(".")[0] for each in required}
        prefix = f"{monitor}." if len(spec.outputs) > 1 else ""
        where = f"{prefix}latency{at_rate}"
        # Outputs that no input triggers have no latency.
        if "latency" not in stated and not spec.outputs[monitor].own_pace:
            limits = {part: _latency_limit(rate, monitor, part) for part in _PARTS}
            known = [(part, limit) for part, limit in limits.items() if limit is not None]
            texts = [
                f"{prefix}latency.{part} < {_ceiling(1e3 * limit.value)} ms"
                for part, limit in known
                if limit.margin <= _MOST_MARGIN
            ]
            if texts:
                yield _Candidate(name, at, where, texts, known[0][1].why)
                if gated and not has_work:
                    percent = max(10, 5 * math.ceil(20 * _DEVIATIONS * known[-1][1].scatter))
                    ratio = f"{prefix}latency.p50 <= {100 + percent} % of baseline"
                    yield _Candidate(name, at, where, (ratio,), certain=True)
            else:
                few = f"it takes {MIN_ITERATIONS} iterations with a latency to see their scatter"
                why = f"{known[0][1].why}, too much for a limit" if known else few
                notes.append(f"{where}: {why}")
        lost = pooled.drop_rate
        if lost is not None and "drop_rate" not in stated:
            shares = [share for share in _SHARES if share >= lost]
            texts = [f"{prefix}drop_rate <= {100 * share:g} %" for share in shares]
            if texts:
                yield _Candidate(name, at, f"{prefix}drop_rate{at_rate}", texts)
            else:
                notes.append(f"{prefix}drop_rate: {lost:.1%} were lost, which is no objective")


def _peak_candidates(spec: Spec, result: Result, notes: list[str]) -> Iterator[_Candidate]:
    search = result.metrics.search
    required = [each.metric for slo in spec.slos.values() for each in slo.require]
    if search is None or not search.holds_hz or any(each.startswith("peak") for each in required):
        return
    limit_hz = search.holds_hz * (1 - _PEAK_STEPS * search.precision)
    if limit_hz > 0:
        text = f"peak.rate >= {_floor(limit_hz)} Hz"
        yield _Candidate(_free_name(spec, "measured_peak"), "", "peak.rate", (text,))
    else:
        notes.append(f"peak.rate: it is known to {search.precision:.0%}, which is too coarse")


def _latency_limit(rate: RateMetrics, monitor: str, part: str) -> Limit | None:
    by_start: dict[int, list[float]] = {}
    for iteration in rate.iterations:
        seen = iteration.monitors.get(monitor)
        value = part_value(seen.latency, part) if seen is not None else None
        if value is not None and value > 0:
            by_start.setdefault(iteration.start, []).append(value)
    values = [value for each in by_start.values() for value in each]
    if len(values) < MIN_ITERATIONS:
        return None
    if len(by_start) < MIN_ITERATIONS:
        return limit_of(values)
    return limit_of([fmean(each) for each in by_start.values()], "starts")


class Limit(NamedTuple):
    """A limit for a measured value, with its margin, the scatter and the reason, as words."""

    value: float
    margin: float
    scatter: float
    why: str


_MARGIN = 1.3
_MOST_MARGIN = 2.0
_DEVIATIONS = 3.0


def limit_of(values: Sequence[float], of: str = "iterations") -> Limit | None:
    """Return a limit for positive values of starts or iterations; None if there are too few."""
    if len(values) < MIN_ITERATIONS:
        return None
    scatter = stdev(map(math.log, values))
    usual, margin = fmean(values), max(_MARGIN, math.exp(_DEVIATIONS * scatter))
    value = max(margin * usual, *values)
    why = (
        f"{value / usual:.2g} times the mean of {len(values)} {of}, which scatter by {scatter:.0%}"
    )
    return Limit(value, margin, scatter, why)


def _passed(candidates: Sequence[_Candidate], judge: Judge) -> set[tuple[str, str]]:
    """Return the requirements that the run passes, with their objectives."""
    requirements: dict[tuple[str, str], list[Requirement]] = {}
    for candidate in candidates:
        asked = requirements.setdefault((candidate.objective, candidate.at), [])
        asked += map(parse_requirement, candidate.texts)
    if not requirements:
        return set()
    objectives = {
        name: Objective(at=Rate.parse(at) if at else None, require=tuple(asked))
        for (name, at), asked in requirements.items()
    }
    verdict = judge(objectives).verdict
    return {
        (requirement.objective, requirement.text)
        for requirement in verdict.requirements
        if requirement.outcome == "pass"
    }


def _insert(loaded: LoadedSpec, proposal: Proposal, rates: Mapping[str, str]) -> None:
    # Without options such as --set, whose values are not in the file.
    text = proposal.text
    current = load_spec(text, file=loaded.file)
    was_valid = current.spec is not None
    for name, requirements in proposal.added.items():
        lines = _objective_lines(name, rates[name], requirements)
        changed = insert_objective(current, text, lines)
        again = load_spec(changed, file=loaded.file) if changed is not None else None
        if changed is None or again is None or (was_valid and again.spec is None):
            proposal.notes.append(f"add by hand: {name}: {'; '.join(requirements)}")
            continue
        current, text = again, changed
    proposal.text = text


def _required(spec: Spec, rate: RateMetrics) -> Iterator[str]:
    """Yield the metrics that the spec requires at a rate."""
    for objective in spec.slos.values():
        at_hz = objective.at.hz if objective.at is not None else 0.0
        if rate.pace != "rate" or at_hz == rate.offered_hz:
            yield from (requirement.metric for requirement in objective.require)


def _free_name(spec: Spec, name: str) -> str:
    """Return a name that no objective of the spec has: this one, or one with a number."""
    free, number = name, 2
    while free in spec.slos:
        free, number = f"{name}_{number}", number + 1
    return free


def _ceiling(value: float) -> str:
    """Return a number rounded up to two significant digits."""
    step = 10 ** (math.floor(math.log10(value)) - 1)
    return f"{float(f'{math.ceil(value / step - 1e-9) * step:.6g}'):g}"


def _floor(value: float) -> str:
    """Return a number rounded down to three significant digits."""
    step = 10 ** (math.floor(math.log10(value)) - 2)
    return f"{float(f'{math.floor(value / step + 1e-9) * step:.6g}'):g}"
