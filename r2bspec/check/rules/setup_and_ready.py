"""What happens before the first message: setup steps, states of nodes, probes of the graph."""

from __future__ import annotations

import re

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, publisher_advice, rule, topic_key
from r2bspec.diagnostics.quote import quote, suggestion
from r2bspec.plan.wiring.wiring import NodeWiring
from r2bspec.safe_io.line_pattern import PatternError, compile_line_pattern


@rule("R2B413")
def ready_topic_without_publisher(context: Context) -> Findings:
    """Ready probes that wait for a topic without a publisher."""
    phase = context.wiring.measure
    for name, probe in context.spec.ready.items():
        topic = context.wiring.topic(probe.topic) if probe.topic else ""
        if not topic or phase.publishers(topic):
            continue
        unknown = phase.possible_publishers
        yield Finding(
            message=f"no {'known ' if unknown else ''}publisher on "
            f"{quote(context.relative_name(topic))}, which this probe waits for",
            path=("ready", name, "topic"),
            help=publisher_advice(context, phase, topic),
            severity="warning" if unknown else None,
            suppressed_by={topic_key(phase.phase, topic)},
        )


_BUILD_COMMAND = re.compile(
    r"(?:^|/)(?:colcon|cmake|make|ninja|bazel|cargo|pip|trtexec)$|build|compile|convert|download"
)


@rule("R2B607")
def setup_without_creates(context: Context) -> Findings:
    """Setup steps that build something, without `creates`."""
    for name, step in context.spec.setup.items():
        word = next((argument for argument in step.command if _BUILD_COMMAND.search(argument)), "")
        if word and not step.creates:
            yield Finding(
                message=f"setup step {quote(name)} seems to build something, but has no 'creates'",
                path=("setup", name),
                key=True,
                help="name the built file under 'creates': the step is skipped if the file exists",
            )


@rule("R2B608")
def ready_process_unknown(context: Context) -> Findings:
    """Ready probes of a process that does not exist."""
    for name, probe in context.spec.ready.items():
        if probe.log is None or probe.log.process in context.subjects.processes:
            continue
        yield Finding(
            message=f"unknown process {quote(probe.log.process)}",
            path=("ready", name, "log", "process"),
            help=suggestion(probe.log.process, context.subjects.processes, "processes"),
        )


@rule("R2B609")
def ready_pattern_invalid(context: Context) -> Findings:
    """Ready probes with an invalid regular expression."""
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
    """Lifecycle nodes that nothing in the graph can activate."""
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
    """Whether a node may change the states of others; what a source says of topics is no answer."""
    return not (node.interface.is_lifecycle or node.interface.publishes_from == "table")


@rule("R2B238")
def no_lifecycle_node(context: Context) -> Findings:
    """Nodes that are to be activated and are no lifecycle nodes."""
    for _, node in context.nodes:
        has_source = node.interface.publishes_from in {"source", "table"}
        if node.node.lifecycle is not None and has_source and not node.interface.is_lifecycle:
            yield Finding(
                message=f"{node.key} is no lifecycle node, and has no states",
                path=(*node.path, "lifecycle"),
                help="remove 'lifecycle'",
            )
