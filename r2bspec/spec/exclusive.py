"""Keys that exclude or need each other, in words of their own.

JSON Schema's ``oneOf`` would say the same, with messages that nobody understands.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from r2bspec.diagnostics import Diagnostic, Path, Related, Severity, format_path
from r2bspec.spec.tree import MapNode, TreeNode, lookup, span_at

_KIND_OF = {
    "python": "python",
    "package": "package",
    "executable": "package",
    "command": "command",
}
_NODE_MAPS: tuple[Path, ...] = (("preprocessors",), ("graph", "nodes"))
_KIND_HELP = "give it one of 'python', 'package' with 'executable', or 'command'"


def exclusive_errors(root: TreeNode, found: Sequence[Diagnostic] = ()) -> Iterator[Diagnostic]:
    """Nodes that are not exactly one kind of node, and bags that are not exactly one source.

    `found` is what the schema says: a map in which it found an unknown key may well have the
    key that is missed here, misspelt.
    """
    misspelt = {one.path[:-1] for one in found if one.code == "R2B101"}
    for path in _NODE_MAPS:
        nodes = lookup(root, path)
        if isinstance(nodes, MapNode):
            for name, entry in nodes.entries.items():
                if isinstance(entry.value, MapNode):
                    yield from _node(entry.value, (*path, name), root, misspelt)
    bag = lookup(root, ("data_loader", "bag"))
    if isinstance(bag, MapNode):
        yield from _bag(bag, root, misspelt)


def _node(node: MapNode, path: Path, root: TreeNode, misspelt: set[Path]) -> Iterator[Diagnostic]:
    given = [key for key in node.entries if key in _KIND_OF]
    name = f"'{format_path(path)}'"
    first_of: dict[str, str] = {}
    for key in given:
        first_of.setdefault(_KIND_OF[key], key)
    if not first_of:
        if path not in misspelt:
            yield _error("R2B113", f"{name} does not say what it runs", root, path, _KIND_HELP)
        return
    if len(first_of) > 1:
        first, second = list(first_of.values())[:2]
        yield _both(name, path, node, (first, second), "R2B113", _KIND_HELP)
        return
    if "package" in first_of and len(given) == 1 and path not in misspelt:
        other = "executable" if given == ["package"] else "package"
        yield _error(
            "R2B113",
            f"{name} has '{given[0]}' but no '{other}'",
            root,
            (*path, given[0]),
            f"add '{other}'; ros2 pkg executables lists both",
        )


def _bag(bag: MapNode, root: TreeNode, misspelt: set[Path]) -> Iterator[Diagnostic]:
    path: Path = ("data_loader", "bag")
    given = [key for key in bag.entries if key in ("dataset", "path")]
    if len(given) == 2:
        help_text = "keep the one that is meant"
        yield _both("'data_loader.bag'", path, bag, (given[0], given[1]), "R2B114", help_text)
    elif not given and path not in misspelt:
        yield _error(
            "R2B114",
            "'data_loader.bag' names no recording",
            root,
            path,
            "give it 'dataset: r2b_storage', or 'path: ./a/bag'",
        )


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
        related=(Related("the first one", node.entries[first].key_span),),
    )


def _error(code: str, message: str, root: TreeNode, path: Path, help_text: str) -> Diagnostic:
    span = span_at(root, path, key=True)
    return Diagnostic(code, Severity.ERROR, message, span, path=path, help=help_text)
