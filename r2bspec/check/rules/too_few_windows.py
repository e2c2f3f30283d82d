"""Shares of windows that the declared number of windows cannot confirm."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Pointer,
    Rule,
    known_metrics,
    pluralize,
    quote,
)
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.language.quantities import Duration


def _find(context: Context) -> Findings:
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
            message=f"{pluralize(windows, 'window')} of {length} cannot confirm "
            f"{quote(requirement.text)}"
            + (f": at least {needed:,} are needed" if needed is not None else ""),
            path=located.path,
            help="allow a small share of windows to violate the bound"
            if needed is None
            else "increase 'duration' or 'iterations', use shorter windows, or require a smaller "
            "share",
            related=(
                Pointer(f"an iteration takes {benchmark.duration}", ("benchmark", "duration")),
            ),
            suppressed_by={located.subject},
        )


RULE = Rule(code="R2B520", find=_find)
