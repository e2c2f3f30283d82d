"""Constraints between the keys of nodes and of recordings.

JSON Schema's ``oneOf`` could express them, but its messages are hard to understand. All other
constraints are in `r2bspec.language.key_constraints.document_keys`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

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
from r2bspec.language.node_kinds import (
    NODE_KIND_KEYS,
    NODE_KINDS,
    PROCESS_KEYS,
    kinds_help,
    members,
)

_NODE_MAPS: tuple[Path, ...] = (("preprocessors",), ("graph", "nodes"))
_GROUPS = {key: kind.group for kind in NODE_KINDS for key in kind.keys}
_KIND_HELP = f"use one of {kinds_help()}"


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
    given = [key for key in node.entries if key in NODE_KIND_KEYS and not _is_false(node, key)]
    name = f"'{format_path(path)}'"
    first_of: dict[str, str] = {}
    for key in given:
        first_of.setdefault(_GROUPS[key], key)
    if not first_of:
        if path not in misspelt:
            yield _error("R2B113", f"{name} does not define what to run", root, path, _KIND_HELP)
        return
    if len(first_of) > 1:
        first, second = list(first_of.values())[:2]
        yield _both(name, path, node, (first, second), "R2B113", _KIND_HELP)
        return
    group = next(iter(first_of))
    alike = members(group)
    if len(alike) > 1:
        markers = [key for key in given if key != group]
        if len(markers) > 1:
            yield _both(name, path, node, (markers[0], markers[1]), "R2B113", _KIND_HELP)
            return
        if len(given) == 1 and path not in misspelt:
            yield _incomplete(name, path, given[0], group, root)
            return
    kind = next((each for each in alike if each.marker in given), alike[-1])
    for key, refusal in kind.refuses.items():
        if key in node.entries:
            message = f"{name} cannot have '{key}': {refusal.why}"
            help_text = refusal.help or f"remove '{key}'"
            yield _error("R2B119", message, root, (*path, key), help_text)
    if "container" in node.entries:
        for key in (*PROCESS_KEYS, "env"):
            if key in node.entries:
                message = f"{name} cannot have '{key}': it shares its process with other nodes"
                help_text = f"move '{key}' to the container"
                yield _error("R2B119", message, root, (*path, key), help_text)


def _incomplete(name: str, path: Path, given: str, group: str, root: TreeNode) -> Diagnostic:
    """The diagnostic for a node that has one of the two keys of its kind."""
    alike = sorted(members(group), key=lambda kind: kind.marker)
    if given == group:
        missing = " and ".join(f"no '{each.marker}'" for each in alike)
        message = f"{name} has '{group}' but {missing}"
        help_text = f"add one of them; see {' or '.join(repr(each.listed_by) for each in alike)}"
    else:
        message = f"{name} has '{given}' but no '{group}'"
        listed = next(each.listed_by for each in alike if each.marker == given)
        help_text = f"add '{group}'; see '{listed}'"
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
