"""The certainty of findings that follow from the known interface of a node."""

from __future__ import annotations

from dataclasses import replace

from r2bspec.check.finding import Finding
from r2bspec.wiring.node_interface import Interface

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
