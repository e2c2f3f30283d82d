"""The nodes of a first spec, collected from one or several sources."""

from __future__ import annotations

from dataclasses import dataclass, field

from r2bspec.interop.script_import.yaml_writer import Block


@dataclass(slots=True)
class DraftNodes:
    """The nodes and containers of a spec, and what the sources do not tell.

    Attributes:
        nodes: entries of ``graph.nodes``.
        containers: entries of ``containers``.
        variables: variables that the nodes refer to, with their values.
        environment: environment variables that the nodes refer to.
        topics: absolute names of topics that the nodes are remapped to.
        unknown: what nothing says, one line each.
        is_absolute: whether the nodes have absolute namespaces, as launch files and running
            systems do; the namespace of the benchmark is then the root.
    """

    nodes: Block = field(default_factory=Block)
    containers: Block = field(default_factory=Block)
    variables: dict[str, object] = field(default_factory=dict)
    environment: list[str] = field(default_factory=list)
    topics: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    is_absolute: bool = False

    @property
    def keys(self) -> set[str]:
        """The names of nodes and containers so far."""
        return {each.key for each in (*self.nodes.entries, *self.containers.entries)}
