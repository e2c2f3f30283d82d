"""What happens before the first message: setup steps, and probes that wait for the graph."""

from __future__ import annotations

import re

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, publisher_advice, rule, topic_key
from r2bspec.diagnostics.quote import quote, suggestion
from r2bspec.safe_io.line_pattern import PatternError, compile_line_pattern


@rule("R2B413")
def ready_topic_without_publisher(context: Context) -> Findings:
    """Ready probes that wait for a topic without a publisher."""
    phase = context.wiring.measure
    for name, probe in context.spec.ready.items():
        topic = context.harness_topic(probe.topic) if probe.topic else ""
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
        if probe.log is None or probe.log.process in context.processes:
            continue
        yield Finding(
            message=f"unknown process {quote(probe.log.process)}",
            path=("ready", name, "log", "process"),
            help=suggestion(probe.log.process, context.processes, "processes"),
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
