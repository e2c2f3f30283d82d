"""The kinds of node: the keys that mark each kind, and its traits.

A new kind is an entry of `NODE_KINDS`, its keys in `r2bspec.language.spec_graph.Node`, its snippet
in ``snippets.yaml``, and its command line in `r2bspec.plan.command_lines`. A kind that runs inside
a process of the harness also has a case in `r2bspec.harness.node_host`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

import msgspec

NodeKindName = Literal["python", "plugin", "executable", "command", "launch", "external"]


class NodeKind(msgspec.Struct, frozen=True, eq=False):
    """A kind of node.

    Attributes:
        keys: the keys that together say that a node is of this kind. Kinds that share their first
            key exclude each other by the others.
        role: the role of the process that it runs in, ``host`` for Python nodes, ``container`` for
            C++ components, ``command`` for a process that the node makes itself; None if r2bspec
            starts nothing.
        refuses: keys that mean nothing for it, and why.
        by_others: whether its nodes are made by something other than r2bspec: they cannot be
            started alone, have no settings of a process, and may leave the namespace of the
            benchmark.
        names_own_nodes: whether its nodes have names that the spec does not know.
        any_program: whether it may be any program, which need be no ROS process and may hold
            several nodes: it gets ROS arguments only where the spec states something of ROS, and
            parameter files as they are.
    """

    name: NodeKindName
    keys: tuple[str, ...]
    role: Literal["host", "container", "command"] | None = "command"
    refuses: Mapping[str, str] = msgspec.field(default_factory=dict)
    by_others: bool = False
    names_own_nodes: bool = False
    any_program: bool = False

    @property
    def shares_process(self) -> bool:
        """Whether several nodes of this kind can run in one process."""
        return self.role in {"host", "container"}


def _refused(why: str, *keys: str) -> dict[str, str]:
    return dict.fromkeys(keys, why)


_NO_PLUGIN = _refused("only a plugin is loaded by a container", "intra_process", "extra_arguments")
_NO_EXECUTOR = _refused("its program makes its executor itself", "executor", "threads")
_NO_CONTAINER = _refused("only Python nodes and plugins run in a container", "container")
_NO_ARGUMENTS: Final = "only an executable or a command has arguments"

PYTHON: Final = NodeKind(
    name="python",
    keys=("python",),
    role="host",
    refuses=_refused(f"{_NO_ARGUMENTS}; a Python node has 'parameters'", "arguments") | _NO_PLUGIN,
)

PLUGIN: Final = NodeKind(
    name="plugin",
    keys=("package", "plugin"),
    role="container",
    refuses=_refused(f"{_NO_ARGUMENTS}; a plugin has 'parameters'", "arguments")
    | _refused("a plugin has that of its container in 'containers'", "executor", "threads"),
)

EXECUTABLE: Final = NodeKind(
    name="executable",
    keys=("package", "executable"),
    refuses=_NO_CONTAINER | _NO_PLUGIN | _NO_EXECUTOR,
)

COMMAND: Final = NodeKind(
    name="command",
    keys=("command",),
    refuses=_NO_CONTAINER
    | _NO_PLUGIN
    | _NO_EXECUTOR
    | _refused(
        "a command may have nodes of any name; name 'package' and 'executable', or change their "
        "states under 'after_ready'",
        "lifecycle",
    ),
    any_program=True,
)

LAUNCH: Final = NodeKind(
    name="launch",
    keys=("launch",),
    refuses=_refused(f"{_NO_ARGUMENTS}; a launch file has 'launch.arguments'", "arguments")
    | _NO_CONTAINER
    | _NO_PLUGIN
    | _refused(
        "a launch file may have nodes of any name; let it activate them, or write them one by one",
        "lifecycle",
    ),
    by_others=True,
    names_own_nodes=True,
)

EXTERNAL: Final = NodeKind(
    name="external",
    keys=("external",),
    role=None,
    refuses=_refused("an external node already runs", "env", "parameters", "arguments", "lifecycle")
    | _NO_CONTAINER
    | _NO_PLUGIN,
    by_others=True,
)

NODE_KINDS: Final = (PYTHON, PLUGIN, EXECUTABLE, COMMAND, LAUNCH, EXTERNAL)
"""Every kind, in the order in which messages and pages list them."""

NODE_KIND_KEYS: Final = tuple(dict.fromkeys(key for kind in NODE_KINDS for key in kind.keys))
"""The keys that say what kind a node is."""


def kind_of(values: object) -> NodeKind:
    """Return the kind of a node whose keys are attributes; a command if no key marks a kind."""
    return next(
        (kind for kind in NODE_KINDS if all(getattr(values, key) for key in kind.keys)), COMMAND
    )


def kinds_text() -> str:
    """Return the kinds by their keys, such as ``'a', 'b' with 'c', or 'd'``."""
    *others, last = (" with ".join(f"'{key}'" for key in kind.keys) for kind in NODE_KINDS)
    return f"{', '.join(others)}, or {last}"
