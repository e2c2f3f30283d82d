"""What a list of launch actions starts: nodes, containers and included files, as values.

A node has everything that an action says of it, with what the groups around it pass on: namespace,
remappings, parameters and environment variables.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from r2bspec.diagnostics import Span
from r2bspec.interop.script_import.values import Construct, ImportNote


@dataclass(frozen=True, slots=True)
class Remapping:
    """One remapping: what the node calls it, and the topic to use; `node` limits it to one node."""

    source: str
    target: str
    place: Span
    node: str = ""


@dataclass(frozen=True, slots=True)
class ProcessSettings:
    """What an action says of its process: environment variables, and words before the command."""

    environment: dict[str, Any] = field(default_factory=dict)
    prefix: tuple[str, ...] = ()


@dataclass(slots=True)
class NodeAction:
    """A node that a script starts or loads.

    Attributes:
        source: the construct that it comes from.
        namespace: absolute; empty for none.
        parameters: maps and paths of files, in order.
        container: the name of the container that it is loaded into.
        intra_process: whether it is loaded with ``use_intra_process_comms``.
        extra_arguments: further arguments that it is loaded with.
        lifecycle: the state into which the file brings it; empty if it makes no transition.
        process: of a node with a process of its own.
    """

    name: str
    source: Construct
    package: str = ""
    plugin: str = ""
    executable: str = ""
    command: list[str] = field(default_factory=list)
    namespace: str = ""
    parameters: list[Any] = field(default_factory=list)
    remappings: list[Remapping] = field(default_factory=list)
    arguments: list[str] = field(default_factory=list)
    container: str = ""
    intra_process: bool = False
    extra_arguments: dict[str, Any] = field(default_factory=dict)
    lifecycle: str = ""
    process: ProcessSettings = field(default_factory=ProcessSettings)

    @property
    def plugin_class(self) -> str:
        """The last part of the plugin: ``ResizeNode``."""
        return self.plugin.rpartition("::")[2]

    def parameter(self, name: str) -> Any:
        """The last value of a parameter in the script; None without one."""
        maps = [each for each in self.parameters if isinstance(each, dict) and name in each]
        return maps[-1][name] if maps else None

    def remapped(self, source: str) -> str:
        """What the node calls `source` in the graph; by default itself."""
        targets = (each.target for each in self.remappings if each.source.lstrip("/") == source)
        return next(targets, source)


@dataclass(slots=True)
class ContainerAction:
    """A component container.

    Attributes:
        source: the construct that it comes from.
        name: its key in a spec, by which nodes name it.
        full_name: with its namespace.
        threads: of its executor; 0 for the default.
        is_multi_threaded: whether each component of an isolated container has several threads.
    """

    source: Construct
    name: str
    full_name: str
    executable: str
    threads: int = 0
    is_multi_threaded: bool = False
    arguments: list[str] = field(default_factory=list)
    process: ProcessSettings = field(default_factory=ProcessSettings)


@dataclass(slots=True)
class IncludeAction:
    """An included launch file.

    Attributes:
        package: the package of the file; empty with `path`.
        file: relative to the share folder of the package.
        environment: what the actions before it set.
    """

    source: Construct
    package: str = ""
    file: str = ""
    path: str = ""
    arguments: dict[str, Any] = field(default_factory=dict)
    namespace: str = ""
    remappings: list[Remapping] = field(default_factory=list)
    environment: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The name of the file."""
        return (self.file or self.path).rpartition("/")[2]


Member = NodeAction | IncludeAction


@dataclass(slots=True)
class LaunchParts:
    """Everything that a list of actions starts, and what was not understood.

    Attributes:
        containers: component containers, by the names that nodes have for them.
        ignored: what is started, or said of it, and cannot be known or written.
        changes: what the parts say in another way than the actions.
        missing: what is left out because a module was not found, by the name of the module.
    """

    nodes: list[NodeAction] = field(default_factory=list)
    containers: dict[str, ContainerAction] = field(default_factory=dict)
    includes: list[IncludeAction] = field(default_factory=list)
    ignored: list[ImportNote] = field(default_factory=list)
    changes: list[ImportNote] = field(default_factory=list)
    missing: dict[str, list[Construct]] = field(default_factory=dict)

    @property
    def members(self) -> list[Member]:
        """Nodes and included files."""
        return [*self.nodes, *self.includes]
