"""The certainty of findings that follow from the known interface of a node."""

from __future__ import annotations

from msgspec.structs import replace

from r2bspec.check.check_context import Context
from r2bspec.check.finding import Finding
from r2bspec.wiring.node_interface import Interface, InterfaceSource
from r2bspec.wiring.wiring import Endpoint, NodeWiring, PhaseWiring

COMPLETE_SOURCES = frozenset({"table", "file", "source"})
"""Sources that describe a node completely: its own code, or a recording of it."""


def as_version_warning(interface: Interface, finding: Finding) -> Finding:
    """The finding as a warning that names the package version it applies to."""
    version = f"as in {interface.described_package}"
    return replace(
        finding,
        help=f"{finding.help} ({version})" if finding.help else version,
        severity="warning",
        machine_dependent=True,
    )


def with_record(
    context: Context, finding: Finding, *rests_on: tuple[NodeWiring, InterfaceSource]
) -> Finding:
    """The finding, naming the recorded interfaces that it rests on.

    It is a warning if one of them was recorded with another version of the package.

    Args:
        context: of the spec.
        finding: what a rule found.
        rests_on: the nodes whose interfaces it follows from, each with the source of the part.
    """
    nodes = {node.key: node for node, source in rests_on if source == "file"}
    if not nodes:
        return finding
    names = ", ".join(node.interface.described_package for node in nodes.values())
    recorded = f"recorded in {names}"
    finding = replace(finding, help=f"{finding.help} ({recorded})" if finding.help else recorded)
    if any(context.record_versions(node) is not None for node in nodes.values()):
        finding = replace(finding, severity="warning", machine_dependent=True)
    return finding


def with_endpoint_records(
    context: Context, phase: PhaseWiring, finding: Finding, *endpoints: Endpoint
) -> Finding:
    """The same for a finding that follows from what is known of endpoints."""
    rests_on = [
        (
            node,
            node.interface.publishes_from if each.is_publisher else node.interface.subscribes_from,
        )
        for each in endpoints
        if (node := phase.node(each.owner)) is not None
    ]
    return with_record(context, finding, *rests_on)
