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


class Refusal(msgspec.Struct, frozen=True):
    """Why a kind of node cannot have a key, and what to do; empty to remove the key."""

    why: str
    help: str = ""


class NodeKind(msgspec.Struct, frozen=True, eq=False):
    """A kind of node.

    Attributes:
        keys: the keys that together say that a node is of this kind. Kinds that share their first
            key exclude each other by the others.
        is_flag: whether its only key is true or false.
        role: of the process that it runs in, ``host`` for Python nodes, ``container`` for C++
            components, ``command`` for a process that the node makes itself; None if r2bspec
            starts nothing.
        refuses: keys that mean nothing for it.
        by_others: whether its nodes are made by something other than r2bspec: they cannot be
            started alone, have no settings of a process, and may leave the namespace of the
            benchmark.
        names_own_nodes: whether its nodes have names that the spec does not know.
        any_program: whether it may be any program, which need be no ROS process and may hold
            several nodes: it gets ROS arguments only where the spec states something of ROS, and
            parameter files as they are.
        listed_by: the ROS command that lists what there is of it in a package.
    """

    name: NodeKindName
    keys: tuple[str, ...]
    role: Literal["host", "container", "command"] | None = "command"
    is_flag: bool = False
    refuses: Mapping[str, Refusal] = msgspec.field(default_factory=dict)
    by_others: bool = False
    names_own_nodes: bool = False
    any_program: bool = False
    listed_by: str = ""

    @property
    def group(self) -> str:
        """The key that it shares with similar kinds, or its only key."""
        return self.keys[0]

    @property
    def marker(self) -> str:
        """The key that distinguishes it from similar kinds."""
        return self.keys[-1]

    @property
    def shares_process(self) -> bool:
        """Whether several nodes of this kind can run in one process."""
        return self.role in {"host", "container"}


def _no_arguments(help_text: str = "") -> dict[str, Refusal]:
    return {"arguments": Refusal("only an executable or a command has arguments", help_text)}


def _no_lifecycle(why: str, help_text: str) -> dict[str, Refusal]:
    return {"lifecycle": Refusal(why, help_text)}


_NOT_LOADED: Final = Refusal("only a plugin is loaded by a container")
_NO_PLUGIN = {"intra_process": _NOT_LOADED, "extra_arguments": _NOT_LOADED}
_OWN_EXECUTOR: Final = Refusal("its program makes its executor itself")
_NO_EXECUTOR = {"executor": _OWN_EXECUTOR, "threads": _OWN_EXECUTOR}
_OF_CONTAINER: Final = Refusal(
    "a plugin has the executor of its container", "set it in 'containers', and name that container"
)
_NO_CONTAINER = {"container": Refusal("only Python nodes and plugins run in a container")}

PYTHON: Final = NodeKind(
    name="python",
    keys=("python",),
    role="host",
    refuses=_no_arguments("use 'parameters' for a Python node") | _NO_PLUGIN,
)

PLUGIN: Final = NodeKind(
    name="plugin",
    keys=("package", "plugin"),
    role="container",
    refuses=_no_arguments("use 'parameters' for a plugin")
    | {"executor": _OF_CONTAINER, "threads": _OF_CONTAINER},
    listed_by="ros2 component types",
)

EXECUTABLE: Final = NodeKind(
    name="executable",
    keys=("package", "executable"),
    refuses=_NO_CONTAINER | _NO_PLUGIN | _NO_EXECUTOR,
    listed_by="ros2 pkg executables",
)

COMMAND: Final = NodeKind(
    name="command",
    keys=("command",),
    refuses=_NO_CONTAINER
    | _NO_PLUGIN
    | _NO_EXECUTOR
    | _no_lifecycle(
        "a command may have nodes of any name",
        "write the node as 'package' with 'executable', or change its state under 'after_ready'",
    ),
    any_program=True,
)

LAUNCH: Final = NodeKind(
    name="launch",
    keys=("launch",),
    refuses=_no_arguments("put them under 'launch.arguments'")
    | _NO_CONTAINER
    | _NO_PLUGIN
    | _no_lifecycle(
        "a launch file may have nodes of any name",
        "let it or a lifecycle manager activate its nodes, or write them one by one",
    ),
    by_others=True,
    names_own_nodes=True,
)

EXTERNAL: Final = NodeKind(
    name="external",
    keys=("external",),
    is_flag=True,
    role=None,
    refuses={
        **_no_arguments(),
        **_NO_CONTAINER,
        **_no_lifecycle(
            "the run changes nothing of an external node", "activate the node before the run"
        ),
        **_NO_PLUGIN,
        "env": Refusal("an external node already has its environment"),
        "parameters": Refusal("an external node already has its parameters"),
    },
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
    return _one_of([" with ".join(f"'{key}'" for key in kind.keys) for kind in NODE_KINDS])


def kinds_help() -> str:
    """Return the kinds as a hint, with similar kinds together and the values of markers."""
    groups = {group: members(group) for group in dict.fromkeys(kind.group for kind in NODE_KINDS)}
    return _one_of([_written(group, kinds) for group, kinds in groups.items()])


def members(group: str) -> tuple[NodeKind, ...]:
    """Return the kinds that have the same first key."""
    return tuple(kind for kind in NODE_KINDS if kind.group == group)


def _written(group: str, kinds: tuple[NodeKind, ...]) -> str:
    if len(kinds) > 1:
        markers = " or ".join(f"'{kind.marker}'" for kind in kinds)
        return f"'{group}' with {markers}"
    return f"'{group}: true'" if kinds[0].is_flag else f"'{group}'"


def _one_of(words: list[str]) -> str:
    return f"{', '.join(words[:-1])}, or {words[-1]}"
