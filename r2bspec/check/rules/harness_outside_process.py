"""A graph in one process, with player and monitors in others."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote
from r2bspec.plan.plan import ProcessPlan
from r2bspec.plan.process_plans import graph_processes

_TYPICAL = (
    "between two processes 0.04 ms for small messages and 1 ms for images of 1280x720, within one "
    "process 0.01 and 0.4 ms"
)


def _find(context: Context) -> Findings:
    spec = context.spec
    if spec.harness.placement == "graph" or spec.graph.placement == "harness":
        return
    processes = graph_processes(spec, context.wiring)
    if len(processes) != 1 or spec.has_external_nodes or not _shared_by_design(processes[0]):
        return
    container = processes[0].container
    yield Finding(
        message=f"the graph is in one process, {quote(processes[0].name)}, and player and monitors "
        "run in others: every latency contains the way there and back",
        path=("containers", container) if container else ("graph",),
        key=True,
        help="write 'harness: {placement: graph}' to play and monitor in that process; "
        "'r2bspec run --scan harness.placement=separate,graph' shows both. "
        f"Typical overheads (docs/performance.md): {_TYPICAL}",
    )


def _shared_by_design(process: ProcessPlan) -> bool:
    """Whether it is a process for several nodes: one that a robot shares between nodes, too."""
    return process.role == "container" or len(process.nodes) > 1


RULE = Rule(code="R2B673", find=_find)
