"""External nodes of which the spec says nothing."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Iterator, Rule, Severity, example, quote


def _find(context: Context) -> Iterator[Finding]:
    for _, node in context.nodes:
        interface = node.interface
        if (
            node.node.kind.role is None
            and interface.publishes is None
            and interface.subscribes is None
        ):
            yield Finding(
                message=f"nothing is known of the external node {quote(node.name)}",
                path=node.path,
                key=True,
                help="say what it 'publishes:' or 'subscribes:'",
            )


RULE = Rule(
    code="R2B220",
    title="an external node of which nothing is known",
    severity=Severity.INFO,
    why="Nobody starts it, so all that can be checked of it is its topics: whether they are there, "
    "and of the right type.",
    failing=example(
        graph="""
            nodes:
              relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
              localisation: {external: true}
        """
    ),
    passing=example(
        graph="""
            nodes:
              relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
              localisation:
                external: true
                subscribes: {output: sensor_msgs/msg/Image}
                publishes: {pose: geometry_msgs/msg/PoseStamped}
        """
    ),
    find=_find,
)
