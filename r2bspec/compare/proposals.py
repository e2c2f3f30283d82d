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

_MOST_LOST = 0.05
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


@dataclass(frozen=True, slots=True)
class _Candidate:
    """Requirements of which the first that the run passes is proposed; the only one, if certain."""

    objective: str
    at: str
    what: str
    texts: tuple[str, ...]
    why: str = ""
    certain: bool = False


def propose_objectives(
    loaded: LoadedSpec,
    text: str,
    result: Result,
    judge: Judge,
) -> Proposal:
    """Return a spec with objectives from the values that a run measured.

    Metrics for which the spec already has a requirement at the same rate are left alone.

    Args:
        loaded: the spec.
        text: its text.
        result: of the run.
        judge: judges the run by other objectives.
    """
    proposal = Proposal(text)
    if loaded.spec is None:
        return proposal
    candidates = [
        entry
        for entry in _candidates(
            loaded.spec, result, proposal.notes, gated=_has_gate(loaded.spec, loaded.tree)
        )
        if entry.texts
    ]
    passed = _passed(candidates, judge)
    for proposed in candidates:
        chosen = next(
            (
                requirement_text
                for requirement_text in proposed.texts
                if proposed.certain or (proposed.objective, requirement_text) in passed
            ),
            None,
        )
        if chosen is not None and proposed.why:
            proposal.notes.append(f"{chosen}: {proposed.why}")
        if chosen is None:
            proposal.notes.append(f"{proposed.what}: the run is too short to show a limit")
        else:
            proposal.added.setdefault(proposed.objective, []).append(chosen)
    if disturbed := len(result.verdict.disturbed):
        played = sum(len(rate.iterations) for rate in result.metrics.rates)
        proposal.notes.append(
            f"other programs disturbed {disturbed} of {played} iterations: these limits are those "
            "of a busy machine, and a quiet one may have tighter ones"
        )
    rates = {entry.objective: entry.at for entry in candidates}
    _insert(loaded, proposal, rates)
    return proposal


def _has_gate(spec: Spec, tree: TreeNode | None) -> bool:
    """Return True if the spec says how it is gated, or compares something with the base."""
    if tree is not None and lookup(tree, ("benchmark", "gate")) is not None:
        return True
    objectives = spec.slos.values()
    return any(limit.of_baseline for objective in objectives for limit in objective.require)


def _candidates(
    spec: Spec, result: Result, notes: list[str], *, gated: bool
) -> Iterator[_Candidate]:
    several = len(spec.outputs) > 1
    for rate in result.metrics.rates:
        at = f"{rate.offered_hz:g} Hz" if rate.pace == "rate" else ""
        measured = f"measured_at_{rate.offered_hz:g}_hz".replace(".", "_") if at else "measured"
        name = _free_name(spec, measured)
        has_work = rate.pooled.graph is not None and rate.pooled.graph.work is not None
        if gated and has_work and not _requires_part(spec, rate, "work.graph"):
            yield _Candidate(name, at, "work.graph", (_WORK_LIMIT,), certain=True)
        for monitor in rate.pooled.monitors:
            prefix = f"{monitor}." if several else ""
            at_rate = f" at {at}" if at else ""
            where = f"{prefix}latency{at_rate}"
            if not _has_requirement(spec, rate, monitor, "latency"):
                limits = [
                    (part, limit)
                    for part in _PARTS
                    if (limit := _latency_limit(rate, monitor, part)) is not None
                ]
                texts = tuple(
                    f"{prefix}latency.{part} < {_ceiling(1e3 * limit.value)} ms"
                    for part, limit in limits
                    if limit.margin <= _MOST_MARGIN
                )
                if spec.outputs[monitor].own_pace:
                    # What it has instead, its path, is proposed with the parts.
                    if not rate.pooled.anatomy:
                        notes.append(
                            f"{where}: outputs that no input triggers have none; with 'benchmark: "
                            f"{{anatomy: true}}', {monitor}.path is proposed"
                        )
                else:
                    if limits and not texts:
                        notes.append(f"{where}: {limits[0][1].why}, too much for a limit")
                    elif not texts:
                        notes.append(
                            f"{where}: it takes {MIN_ITERATIONS} iterations with a latency to "
                            "see their scatter"
                        )
                    yield _Candidate(name, at, where, texts, limits[0][1].why if texts else "")
                    if gated and texts and not has_work:
                        percent = 5 * math.ceil(20 * _DEVIATIONS * limits[-1][1].scatter)
                        ratio = f"{prefix}latency.p50 <= {100 + max(10, percent)} % of baseline"
                        yield _Candidate(name, at, where, (ratio,), certain=True)
            pooled = rate.pooled.monitors[monitor]
            lost = pooled.drop_rate
            if lost is None or _has_requirement(spec, rate, monitor, "drop_rate"):
                continue
            if lost > _MOST_LOST:
                notes.append(f"{prefix}drop_rate: {lost:.1%} were lost, which is no objective")
                continue
            shares = tuple(
                f"{prefix}drop_rate <= {100 * share:g} %" for share in _SHARES if share >= lost
            )
            yield _Candidate(name, at, f"{prefix}drop_rate{at_rate}", shares)
        yield from _part_candidates(spec, rate, name, at)
    search = result.metrics.search
    metrics = [
        requirement.metric for objective in spec.slos.values() for requirement in objective.require
    ]
    asked = any(metric.startswith("peak") for metric in metrics)
    if search is not None and search.holds_hz and not asked:
        limit_hz = search.holds_hz * (1 - _PEAK_STEPS * search.precision)
        if limit_hz > 0:
            name = _free_name(spec, "measured_peak")
            yield _Candidate(name, "", "peak.rate", (f"peak.rate >= {_floor(limit_hz)} Hz",))
        else:
            notes.append(f"peak.rate: it is known to {search.precision:.0%}, which is too coarse")


_PROPOSED_PARTS = 3
"""Callbacks for which a limit is proposed: those with the longest tails."""

_MOST_LOAD = 0.9
"""A limit of a load above this says nothing: such a node cannot keep up."""


def _part_candidates(spec: Spec, rate: RateMetrics, name: str, at: str) -> Iterator[_Candidate]:
    """Limits of what was observed from inside in every iteration.

    Callbacks and loads of nodes, and paths to monitors of which no other latency is known.
    """
    if not rate.pooled.anatomy or spec.benchmark.anatomy is False:
        return
    tails = {
        series: part_value(times, _PARTS[-1]) or 0.0
        for series, times in rate.pooled.anatomy.items()
        if series.endswith(".callback")
    }
    paths = [f"{monitor}.path" for monitor, settings in spec.monitors.items() if settings.own_pace]
    slowest = sorted(tails, key=tails.__getitem__, reverse=True)[:_PROPOSED_PARTS]
    for series in [*slowest, *(path for path in paths if path in rate.pooled.anatomy)]:
        seen = [each[series] for one in rate.iterations if (each := one.anatomy) and series in each]
        if not _requires_part(spec, rate, series):
            texts = []
            for part in _PARTS:
                values = [value for times in seen if (value := part_value(times, part))]
                limit = limit_of(values)
                if limit is not None and limit.margin <= _MOST_MARGIN:
                    texts.append(f"{series}.{part} < {_ceiling(1e3 * limit.value)} ms")
            yield _Candidate(name, at, series, tuple(texts))
        load = f"{series.removesuffix('.callback')}.load"
        values = [
            value
            for one in rate.iterations
            if (each := one.anatomy) and load in each and (value := each[load].mean)
        ]
        limit = limit_of(values)
        known = limit is not None and limit.value < _MOST_LOAD
        if known and limit is not None and not _requires_part(spec, rate, load):
            yield _Candidate(name, at, load, (f"{load} < {_ceiling(100 * limit.value)} %",))


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


def _has_requirement(spec: Spec, rate: RateMetrics, monitor: str, metric: str) -> bool:
    """Return whether the spec already states the metric at this rate."""
    return any(
        name.removeprefix(f"{monitor}.").split(".")[0] == metric for name in _required(spec, rate)
    )


def _requires_part(spec: Spec, rate: RateMetrics, series: str) -> bool:
    """Return the same for the values of a node, such as ``blur.callback``."""
    return any(f"{name}.".startswith(f"{series}.") for name in _required(spec, rate))


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
