"""ROS 2 name resolution, as rcl does it: expand, then remap once.

Grammar of a topic name, which the schema of the language enforces::

    name      = ["/" | "~/"] token { "/" token }  |  "~"
    token     = letter or "_", then letters, digits and "_"

An absolute name begins with ``/``; a relative one is resolved in the namespace of the node, and
``~`` is replaced by the full name of the node. Substitutions in braces are not supported.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

NODE_TOPICS = frozenset({"/rosout", "/parameter_events"})
"""Topics that every node has, without a word of its code."""

SHARED_TOPICS = NODE_TOPICS | {"/tf", "/tf_static", "/clock", "/diagnostics"}
"""Topics made for any number of publishers and subscriptions, or that every node has."""


class ResolvedName(NamedTuple):
    """A topic name after remapping, and the key of the rule that was applied, if any."""

    name: str
    rule: str | None


def join_namespaces(outer: str, inner: str) -> str:
    """Return the full namespace of `inner` inside `outer`: absolute, ``/`` for the root.

    An absolute `inner` is returned as it is; an empty `inner` adds nothing.
    """
    text = inner if inner.startswith("/") else f"{outer}/{inner}"
    return "/" + "/".join(token for token in text.split("/") if token)


def is_node_parameter(name: str) -> bool:
    """Return True for a parameter of every node, or for the QoS of its topics."""
    return name in {"use_sim_time", "start_type_description_service"} or name.startswith(
        "qos_overrides."
    )


def node_name(node: str, namespace: str) -> str:
    """Return the full name of a node in an absolute namespace."""
    return f"{'' if namespace == '/' else namespace}/{node}"


def expand(name: str, node: str, namespace: str) -> str:
    """Return the absolute form of a topic name that a node uses.

    Args:
        name: as in the code of the node.
        node: the node's name without namespace.
        namespace: the node's absolute namespace.
    """
    if name == "~" or name.startswith("~/"):
        name = node_name(node, namespace) + name[1:]
    return name if name.startswith("/") else node_name(name, namespace)


class Remapper:
    """The names of a node: its remapping rules are expanded once for all of its topics.

    As in rcl, both sides of a rule are expanded in the node's namespace, the first rule whose left
    side equals the expanded name is applied, and its result is not remapped again.

    Args:
        rules: the rules in their order.
        node: the node's name without namespace.
        namespace: the node's absolute namespace.
    """

    def __init__(self, rules: Mapping[str, str], node: str, namespace: str) -> None:
        self._rules = rules
        self._node = node
        self._namespace = namespace
        self._first: dict[str, str] = {}
        for left in rules:
            self._first.setdefault(self.full(left), left)

    def full(self, name: str) -> str:
        """Return the full name of a topic of the node before remapping."""
        return expand(name, self._node, self._namespace)

    def resolve(self, name: str) -> ResolvedName:
        """Return the topic of the node after its remapping rules."""
        full = self.full(name)
        left = self._first.get(full)
        if left is None:
            return ResolvedName(full, None)
        return ResolvedName(self.full(self._rules[left]), left)
