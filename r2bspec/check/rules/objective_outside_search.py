"""Objectives at rates that the search does not reach."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Pointer, Rule, example, quote


def _find(context: Context) -> Findings:
    search = context.spec.benchmark.search
    if search is None or search.min.hz >= search.max.hz:
        return
    for name, objective in context.spec.slos.items():
        if objective.at is not None and objective.at.hz > search.max.hz:
            yield Finding(
                message=f"{quote(name)} is to hold at {objective.at}, but the search ends at "
                f"{search.max}",
                path=("slos", name, "at"),
                help=f"search up to {objective.at} at least, to see how far above it the graph is",
                related=(Pointer("it ends here", ("benchmark", "search", "max")),),
            )


RULE = Rule(
    code="R2B517",
    title="an objective above the search",
    severity="warning",
    why="A search that ends below what is required says only that the graph holds more than its "
    "end, which is less than what matters.",
    failing=example(
        benchmark="{rates: [60 Hz], search: {min: 5 Hz, max: 40 Hz}}",
        slos="{fast: {at: 60 Hz, require: [latency.p90 < 50 ms]}}",
    ),
    passing=example(
        benchmark="{rates: [60 Hz], search: {min: 5 Hz, max: 200 Hz}}",
        slos="{fast: {at: 60 Hz, require: [latency.p90 < 50 ms]}}",
    ),
    find=_find,
)
