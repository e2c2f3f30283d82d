"""Writers and readers whose profiles exclude each other."""

from __future__ import annotations

from collections.abc import Iterator

from r2bspec.check import suppression_keys
from r2bspec.check.check_context import Context
from r2bspec.check.example_spec import example
from r2bspec.check.finding import Finding, Pointer
from r2bspec.check.rule import Rule
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.diagnostics.quote import quote
from r2bspec.wiring.wiring import Endpoint, PhaseWiring


def _find(context: Context) -> Iterator[Finding]:
    for phase in context.wiring.phases:
        for topic in phase.topics:
            for writer in phase.writers(topic):
                for reader in phase.readers(topic):
                    problem = _problem(writer, reader)
                    if problem:
                        yield _finding(context, phase, writer, reader, problem)


def _problem(writer: Endpoint, reader: Endpoint) -> tuple[str, str, str] | None:
    """What the reader asks for, what the writer offers, and the field of both."""
    if writer.qos is None or reader.qos is None:
        return None
    if reader.qos.reliability == "reliable" and writer.qos.reliability == "best_effort":
        return "reliable", "best_effort", "reliability"
    if reader.qos.durability == "transient_local" and writer.qos.durability == "volatile":
        return "transient_local", "volatile", "durability"
    return None


def _finding(
    context: Context,
    phase: PhaseWiring,
    writer: Endpoint,
    reader: Endpoint,
    problem: tuple[str, str, str],
) -> Finding:
    asked, offered, field = problem
    wrong, other = (reader, writer) if reader.qos_path else (writer, reader)
    return Finding(
        message=f"{_who(reader)} asks for {asked} messages on "
        f"{quote(context.shown(writer.topic))}, but {_who(writer)} offers {offered} ones",
        path=(*wrong.qos_path, field) if wrong.qos_path else wrong.path,
        help=f"write {quote(f'{field}: {offered}')} for {_who(reader)}, or "
        f"{quote(f'{field}: {asked}')} for {_who(writer)}",
        related=(Pointer("the other side", other.qos_path or other.path),),
        about=frozenset({suppression_keys.topic(phase.phase, writer.topic)}),
        explains=frozenset({suppression_keys.flow(phase.phase)}),
    )


def _who(endpoint: Endpoint) -> str:
    if endpoint.monitor:
        return f"monitor {endpoint.monitor}"
    return endpoint.owner.rpartition("/")[2] if endpoint.is_node else f"the {endpoint.owner}"


RULE = Rule(
    code="R2B216",
    title="a writer and a reader whose profiles exclude each other",
    severity=Severity.ERROR,
    why="A reader that asks for more than its writer offers is never connected with it, and "
    "nothing arrives.",
    failing=example(
        playback="""
            inputs:
              image:
                from: image_raw
                format: sensor_msgs/msg/Image
                qos: {reliability: best_effort}
        """,
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image}
                qos: {input: {reliability: reliable}}
        """,
    ),
    passing=example(
        playback="""
            inputs:
              image:
                from: image_raw
                format: sensor_msgs/msg/Image
                qos: {reliability: best_effort}
        """,
        graph="""
            nodes:
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image}
                qos: {input: {reliability: best_effort}}
        """,
    ),
    find=_find,
)
