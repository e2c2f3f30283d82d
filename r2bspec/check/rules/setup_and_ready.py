"""What happens before the first message: probes of the graph, states of nodes."""

from __future__ import annotations

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, rule
from r2bspec.diagnostics.quote import quote
from r2bspec.plan.wiring.wiring import NodeWiring
from r2bspec.safe_io.line_pattern import PatternError, compile_line_pattern


@rule("R2B609")
def ready_pattern_invalid(context: Context) -> Findings:
    """Find ready probes with an invalid regular expression."""
    for name, probe in context.spec.ready.items():
        if probe.log is None:
            continue
        try:
            compile_line_pattern(probe.log.pattern)
        except PatternError as error:
            yield Finding(
                message=f"{quote(probe.log.pattern)} is not a valid regular expression: {error}",
                path=("ready", name, "log", "pattern"),
                part=error.part,
                help="escape special characters with a backslash",
            )


@rule("R2B237")
def lifecycle_node_not_activated(context: Context) -> Findings:
    """Find lifecycle nodes that nothing in the graph can activate."""
    if context.spec.after_ready:
        return
    for phase in context.wiring.phases:
        if any(_may_manage(node) for node in phase.nodes):
            continue
        for node in phase.nodes:
            if node.interface.is_lifecycle and node.node.lifecycle is None:
                yield Finding(
                    message=f"{node.key} is a lifecycle node, and nothing in the graph activates "
                    "it, unless it does so itself",
                    path=node.path,
                    key=True,
                    help="write 'lifecycle: active', and the run configures and activates it",
                )


def _may_manage(node: NodeWiring) -> bool:
    """Return whether a node may change the states of others.

    What a source says of topics is no answer.
    """
    return not (node.interface.is_lifecycle or node.interface.publishes_from == "table")
