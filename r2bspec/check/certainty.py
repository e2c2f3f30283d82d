"""How far a finding can be relied on that follows from what is known of a node."""

from __future__ import annotations

from dataclasses import replace

from r2bspec.check.finding import Finding
from r2bspec.wiring.node_interface import Interface

COMPLETE_SOURCES = frozenset({"table", "file", "source"})
"""Sources that know a node completely: its own code, or a recording of it."""


def as_version_warning(interface: Interface, finding: Finding) -> Finding:
    """The finding as a warning that says which version of a package it is about."""
    version = f"as {interface.described_package} has it"
    return replace(
        finding,
        help=f"{finding.help} ({version})" if finding.help else version,
        severity="warning",
        machine_dependent=True,
    )
