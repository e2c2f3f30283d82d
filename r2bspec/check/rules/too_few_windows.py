"""Shares of windows that too few windows can show."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Iterator,
    Pointer,
    Rule,
    Severity,
    example,
    known_metrics,
    pluralize,
    quote,
)
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.language.quantities import Duration


def _find(context: Context) -> Iterator[Finding]:
    benchmark = context.spec.benchmark
    iterations = max(benchmark.iterations, benchmark.max_iterations)
    for each in known_metrics(context):
        located = each.located
        requirement = located.requirement
        if requirement.windows_share is None or located.role != "objective":
            continue
        windows = benchmark.duration.ns // requirement.window_ns * iterations
        needed = min_sample_size(1 - requirement.windows_share, located.confidence)
        if needed is not None and windows >= needed:
            continue
        length = Duration(requirement.window_ns)
        yield Finding(
            message=f"{pluralize(windows, 'window')} of {length} can never show that "
            f"{quote(requirement.text)}"
            + (f"; that takes {needed:,} at least" if needed is not None else ""),
            path=located.path,
            help="allow a small share of windows to miss the bound"
            if needed is None
            else "play longer or more often, take shorter windows, or ask for a smaller share",
            related=(Pointer("an iteration is this long", ("benchmark", "duration")),),
            suppressed_by=frozenset({located.subject}),
        )


RULE = Rule(
    code="R2B520",
    title="a share of windows that too few windows can show",
    severity=Severity.ERROR,
    why="By the exact binomial test a share p of windows is shown at confidence c by no fewer than "
    "ln(1 - c) / ln(p) windows, even if every one of them is within the bound.",
    failing=example(
        slos="{steady: {at: 30 Hz, require: [latency.max < 50 ms in 99 % of 1 s windows]}}"
    ),
    passing=example(
        benchmark="{duration: 20 s, iterations: 5, rates: [30 Hz]}",
        slos="{steady: {at: 30 Hz, require: [latency.max < 50 ms in 95 % of 1 s windows]}}",
    ),
    find=_find,
)
