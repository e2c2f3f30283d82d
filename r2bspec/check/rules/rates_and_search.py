"""Rates: which are played or searched, and at which a requirement applies."""

from __future__ import annotations

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, Pointer, rule, value_key
from r2bspec.diagnostics.quote import quote
from r2bspec.language.quantities import Rate
from r2bspec.language.spec import Objective
from r2bspec.measure.metric_catalogue import METRICS


@rule("R2B408")
def rate_without_effect(context: Context) -> Findings:
    """Rates and searches in playback modes without a selectable rate."""
    if not context.has_own_rate:
        return
    mode = context.spec.playback.mode
    source = "the recording" if mode == "timeline" else "the source in the graph"
    benchmark = context.spec.benchmark
    for key, value in (("rates", benchmark.rates), ("search", benchmark.search)):
        if value:
            yield Finding(
                message=f"{quote(key)} has no effect with 'mode: {mode}': {source} sets the rate",
                path=("benchmark", key),
                key=True,
                help="remove it, or use 'mode: looping'",
                suppresses={"rates"},
            )
    for name, objective in context.spec.slos.items():
        if objective.at is not None or objective.at_peak:
            yield Finding(
                message=f"'at' has no effect with 'mode: {mode}': {source} sets the rate",
                path=("slos", name, "at"),
                help="remove 'at'",
                suppressed_by={"rates"},
            )


@rule("R2B500")
def benchmark_without_rate(context: Context) -> Findings:
    """Benchmarks without a rate or a search."""
    benchmark = context.spec.benchmark
    sustained = any(located.requirement.metric == "sustained" for located in context.requirements)
    own = context.has_own_rate
    if not own and not benchmark.rates and benchmark.search is None and not sustained:
        at = {value_key(("slos", name, "at")) for name in context.spec.slos}
        yield Finding(
            message="no 'rates' and no 'search': nothing would be played",
            path=("benchmark",),
            key=True,
            help="add 'rates: [30 Hz]' or 'search: {min: 5 Hz, max: 200 Hz}' under 'benchmark'",
            suppresses=frozenset(at),
        )


@rule("R2B504")
def rate_not_played(context: Context) -> Findings:
    """Objectives at rates that are not played."""
    if context.has_own_rate:
        return
    played = context.spec.benchmark.rates
    for name, objective in context.spec.slos.items():
        if objective.at is not None and objective.at not in played and _needs_playing(objective):
            rates = ", ".join(str(rate) for rate in played)
            yield Finding(
                message=f"no iteration is played at {objective.at}",
                path=("slos", name, "at"),
                help=f"add it to 'benchmark.rates' (played: {rates})"
                if played
                else "add it to 'benchmark.rates', which is empty",
                suppresses={value_key(("slos", name, "at"))},
            )


def _needs_playing(objective: Objective) -> bool:
    """Whether any requirement is about iterations; a sustained rate has its own probe."""
    return any(
        (info := METRICS.get(requirement.metric)) is None
        or info.statistic not in {"sequential", "search"}
        for requirement in objective.require
    )


@rule("R2B505")
def requirement_without_rate(context: Context) -> Findings:
    """Requirements that need a rate but have none."""
    if context.has_own_rate:
        return
    rates = ", ".join(str(rate) for rate in context.spec.benchmark.rates)
    for metric in context.known_metrics:
        located = metric.located
        if located.needs_rate and metric.info.statistic not in {"search", "truth"}:
            yield Finding(
                message=f"requirement on {quote(metric.info.name)} has no rate",
                path=located.path,
                part=located.metric_part,
                help=f"add 'at:' to the objective {quote(located.objective)}"
                + (f"; played rates: {rates}" if rates else ""),
                suppresses={located.subject},
            )


@rule("R2B506")
def peak_without_search(context: Context) -> Findings:
    """Requirements on the peak in specs without a search."""
    if context.spec.benchmark.search is not None:
        return
    for name, objective in context.spec.slos.items():
        if objective.at_peak:
            yield Finding(
                message=f"objective {quote(name)} applies at the peak, but 'benchmark' has no "
                "search",
                path=("slos", name, "at"),
                help="add one under 'benchmark': 'search: {min: 5 Hz, max: 200 Hz}'",
            )
    for metric in context.known_metrics:
        if metric.info.statistic == "search":
            yield Finding(
                message=f"{quote(metric.info.name)} is required, but 'benchmark' has no search",
                path=metric.located.path,
                part=metric.located.metric_part,
                help="add one under 'benchmark': 'search: {min: 5 Hz, max: 200 Hz}'",
                suppresses={metric.located.subject},
            )


_SEARCH = ("benchmark", "search")


@rule("R2B507")
def peak_outside_search(context: Context) -> Findings:
    """Requirements on the peak outside the range of the search."""
    search = context.spec.benchmark.search
    if search is None or search.min.hz >= search.max.hz:
        return
    for metric in context.known_metrics:
        bound = metric.located.requirement.bound
        if metric.info.statistic != "search" or bound is None or bound.dimension != "rate":
            continue
        if search.min.hz < bound.value <= search.max.hz:
            continue
        end = "max" if bound.value > search.max.hz else "min"
        limit = search.max if end == "max" else search.min
        yield Finding(
            message=f"a search from {search.min} to {search.max} cannot decide "
            f"{quote(metric.located.requirement.text)}",
            path=metric.located.path,
            part=metric.located.bound_part,
            help=f"set {quote(end)} of the search {'above' if end == 'max' else 'below'} "
            f"{bound.value:g} Hz",
            related=(
                Pointer(
                    f"the search {'ends' if end == 'max' else 'begins'} at {limit}", (*_SEARCH, end)
                ),
            ),
            suppressed_by={metric.located.subject},
        )


@rule("R2B508")
def search_range_empty(context: Context) -> Findings:
    """Searches with an empty range."""
    search = context.spec.benchmark.search
    if search is not None and search.min.hz >= search.max.hz:
        yield Finding(
            message=f"search range is empty: 'max' ({search.max}) is not above 'min' "
            f"({search.min})",
            path=(*_SEARCH, "max"),
            help="set 'max', the highest rate that is tried, above 'min'",
            related=(Pointer("the search begins here", (*_SEARCH, "min")),),
        )


@rule("R2B512")
def rate_duplicate(context: Context) -> Findings:
    """Duplicate rates."""
    first: dict[Rate, int] = {}
    for index, rate in enumerate(context.spec.benchmark.rates):
        if rate in first:
            yield Finding(
                message=f"duplicate rate {rate}",
                path=("benchmark", "rates", index),
                help="remove it; to repeat every rate, increase 'iterations'",
                related=(Pointer("first listed here", ("benchmark", "rates", first[rate])),),
            )
        first.setdefault(rate, index)


@rule("R2B517")
def objective_above_search(context: Context) -> Findings:
    """Objectives at rates above the range of the search."""
    search = context.spec.benchmark.search
    if search is None or search.min.hz >= search.max.hz:
        return
    for name, objective in context.spec.slos.items():
        if objective.at is not None and objective.at.hz > search.max.hz:
            yield Finding(
                message=f"objective {quote(name)} applies at {objective.at}, but the search ends "
                f"at {search.max}",
                path=("slos", name, "at"),
                help=f"set 'max' of the search to {objective.at} or more",
                related=(Pointer("the search ends here", ("benchmark", "search", "max")),),
            )


@rule("R2B532")
def confirm_shorter_than_probe(context: Context) -> Findings:
    """Searches that play the lower end of the result for a shorter time than a probe."""
    search = context.spec.benchmark.search
    if search is not None and 0 < search.confirm.ns < search.probe.ns:
        yield Finding(
            message=f"'confirm' ({search.confirm}) is shorter than 'probe' ({search.probe}), so it "
            "shows less than the probes do",
            path=(*_SEARCH, "confirm"),
            help="make it longer than a probe, or write 'confirm: 0 s' to play no rate whole",
            related=(Pointer("a probe lasts up to this", (*_SEARCH, "probe")),),
        )
