"""Several starts of a graph with nodes that a run cannot start."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example


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


_EXTERNAL = """
    nodes:
      relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
      localisation:
        external: true
        subscribes: {output: sensor_msgs/msg/Image}
        publishes: {pose: geometry_msgs/msg/PoseStamped}
"""

RULE = Rule(
    code="R2B531",
    title="several starts of external nodes",
    severity="warning",
    why="Each start runs in new processes, so that a verdict is about the graph and not about one "
    "start of it. External nodes are started by others.",
    failing=example(graph=_EXTERNAL, benchmark="{iterations: 10, starts: 5, rates: [30 Hz]}"),
    passing=example(graph=_EXTERNAL, benchmark="{iterations: 10, starts: 1, rates: [30 Hz]}"),
    find=_find,
)
