"""Several starts of a graph with nodes that a run cannot start."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule


def _find(context: Context) -> Findings:
    starts = context.spec.benchmark.starts or 1
    if starts > 1 and context.spec.has_external_nodes:
        yield Finding(
            message="'starts' has no effect: r2bspec cannot restart the external nodes of the "
            "graph, so the run has one start",
            path=("benchmark", "starts"),
            help="write 'starts: 1', and run several times, each time with external nodes that "
            "were restarted; or let r2bspec start the nodes",
        )


RULE = Rule(code="R2B531", find=_find)
