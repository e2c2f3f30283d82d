"""Constraints between the keys of nodes and of recordings.

JSON Schema's ``oneOf`` could express them, but its messages are hard to understand. All other
constraints are in `r2bspec.language.key_constraints.document_keys`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from r2bspec.diagnostics import Diagnostic, Path, Related, Severity, format_path
from r2bspec.language.key_constraints.document_keys import section_constraint_errors
from r2bspec.language.located_tree import (
    ListNode,
    MapNode,
    ScalarNode,
    TreeNode,
    child,
    lookup,
    span_at,
)

_KIND_BY_KEY = {
    "python": "python",
    "package": "package",
    "plugin": "package",
    "executable": "package",
    "command": "command",
    "launch": "launch",
    "external": "external",
}
_NODE_MAPS: tuple[Path, ...] = (("preprocessors",), ("graph", "nodes"))
_KIND_HELP = (
    "use one of 'python', 'package' with 'plugin' or 'executable', 'command', 'launch', or "
    "'external: true'"
)
_RESOURCES = ("cpus", "nice", "prefix", "memory_limit")
_PROCESS_KINDS = ("executable", "command")
_UNSUPPORTED_KEYS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "arguments": (
        ("python", "plugin", "external", "launch"),
        "only an executable or a command has arguments",
    ),
    "container": (
        (*_PROCESS_KINDS, "launch", "external"),
        "only Python nodes and plugins run in a container",
    ),
    "env": (("external",), "an external node already has its environment"),
    "parameters": (("external",), "an external node already has its parameters"),
    **dict.fromkeys(_RESOURCES, (("launch", "external"), "r2bspec does not start its processes")),
}
"""Keys without effect for some kinds of node, and why."""

_UNSUPPORTED_KEYS_HELP = {
    ("arguments", "launch"): "put them under 'launch.arguments'",
    ("arguments", "python"): "use 'parameters' for a Python node",
    ("arguments", "plugin"): "use 'parameters' for a plugin",
}


def key_constraint_errors(root: TreeNode, found: Sequence[Diagnostic] = ()) -> Iterator[Diagnostic]:
    """Violated constraints: nodes of no kind or of several, bags without a source, and others.

    `found` are the violations of the schema: a map with an unknown key may have the missing key in
    a misspelt form.
    """
    misspelt = {one.path[:-1] for one in found if one.code == "R2B101"}
    for path in _NODE_MAPS:
        nodes = lookup(root, path)
        if isinstance(nodes, MapNode):
            for name, entry in nodes.entries.items():
                if isinstance(entry.value, MapNode):
                    yield from _node(entry.value, (*path, name), root, misspelt)
    yield from _bags(root, misspelt)
    yield from section_constraint_errors(root, misspelt)


def _node(node: MapNode, path: Path, root: TreeNode, misspelt: set[Path]) -> Iterator[Diagnostic]:
    given = [key for key in node.entries if key in _KIND_BY_KEY and not _is_false(node, key)]
    name = f"'{format_path(path)}'"
    first_of: dict[str, str] = {}
    for key in given:
        first_of.setdefault(_KIND_BY_KEY[key], key)
    if not first_of:
        if path not in misspelt:
            yield _error("R2B113", f"{name} does not define what to run", root, path, _KIND_HELP)
        return
    if len(first_of) > 1:
        first, second = list(first_of.values())[:2]
        yield _both(name, path, node, (first, second), "R2B113", _KIND_HELP)
        return
    if "package" in first_of:
        parts = [key for key in given if key != "package"]
        if len(parts) > 1:
            yield _both(name, path, node, (parts[0], parts[1]), "R2B113", _KIND_HELP)
            return
        if len(given) == 1 and path not in misspelt:
            yield _incomplete_package(name, path, given[0], root)
            return
        kind = "plugin" if "plugin" in given else "executable"
    else:
        kind = next(iter(first_of))
    for key, (kinds, why) in _UNSUPPORTED_KEYS.items():
        if key in node.entries and kind in kinds:
            help_text = _UNSUPPORTED_KEYS_HELP.get((key, kind), f"remove '{key}'")
            message = f"{name} cannot have '{key}': {why}"
            yield _error("R2B119", message, root, (*path, key), help_text)
    if "container" in node.entries:
        for key in (*_RESOURCES, "env"):
            if key in node.entries:
                message = f"{name} cannot have '{key}': it shares its process with other nodes"
                help_text = f"move '{key}' to the container"
                yield _error("R2B119", message, root, (*path, key), help_text)


def _incomplete_package(name: str, path: Path, given: str, root: TreeNode) -> Diagnostic:
    if given == "package":
        message = f"{name} has 'package' but no 'executable' and no 'plugin'"
        help_text = "add one of them; see 'ros2 pkg executables' or 'ros2 component types'"
    else:
        message = f"{name} has '{given}' but no 'package'"
        shown = "ros2 component types" if given == "plugin" else "ros2 pkg executables"
        help_text = f"add 'package'; see '{shown}'"
    return _error("R2B113", message, root, (*path, given), help_text)


def _is_false(node: MapNode, key: str) -> bool:
    value = node.entries[key].value
    return isinstance(value, ScalarNode) and value.value is False


def _bags(root: TreeNode, misspelt: set[Path]) -> Iterator[Diagnostic]:
    loader = child(root, "data_loader")
    if not isinstance(loader, MapNode):
        return
    place: Path = ("data_loader",)
    given = [key for key in loader.entries if key in ("bag", "bags")]
    if len(given) == 2:
        help_text = "list all recordings under 'bags'"
        yield _both("'data_loader'", place, loader, (given[0], given[1]), "R2B114", help_text)
    elif not given and place not in misspelt:
        message = "'data_loader' needs 'bag' or 'bags'"
        yield _error("R2B114", message, root, place, "add 'bag: r2b_storage', or 'bag: ./a/bag'")
    bag, bags = child(loader, "bag"), child(loader, "bags")
    if isinstance(bag, MapNode):
        yield from _bag(bag, (*place, "bag"), root, misspelt)
    if isinstance(bags, ListNode):
        if not bags.items:
            message = "'data_loader.bags' must not be empty"
            yield _error("R2B108", message, root, (*place, "bags"), "for example: [./a/bag]")
        for index, each in enumerate(bags.items):
            if isinstance(each, MapNode):
                yield from _bag(each, (*place, "bags", index), root, misspelt)


def _bag(bag: MapNode, path: Path, root: TreeNode, misspelt: set[Path]) -> Iterator[Diagnostic]:
    name = f"'{format_path(path)}'"
    given = [key for key in bag.entries if key in ("dataset", "path")]
    if len(given) == 2:
        help_text = "keep one of them"
        yield _both(name, path, bag, (given[0], given[1]), "R2B114", help_text)
    elif not given and path not in misspelt:
        help_text = "add 'dataset: r2b_storage', or 'path: ./a/bag'"
        yield _error("R2B114", f"{name} needs 'dataset' or 'path'", root, path, help_text)


def _both(
    name: str, path: Path, node: MapNode, keys: tuple[str, str], code: str, help_text: str
) -> Diagnostic:
    first, second = keys
    return Diagnostic(
        code,
        Severity.ERROR,
        f"{name} has both '{first}' and '{second}'",
        node.entries[second].key_span,
        path=(*path, second),
        help=help_text,
        related=(Related("the other key", node.entries[first].key_span),),
    )


def _error(code: str, message: str, root: TreeNode, path: Path, help_text: str) -> Diagnostic:
    span = span_at(root, path, key=True)
    return Diagnostic(code, Severity.ERROR, message, span, path=path, help=help_text)
