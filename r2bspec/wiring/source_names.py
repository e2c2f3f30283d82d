"""Names in the source of a Python file, as far as the text alone determines what they mean."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator


class SourceNames:
    """The names that a file binds, anywhere.

    A name means what an import says only if nothing else in the file binds it.
    """

    def __init__(self, tree: ast.Module) -> None:
        self._tree = tree
        self._imported: dict[str, set[str]] = defaultdict(set)
        self._bound: dict[str, list[ast.AST]] = defaultdict(list)
        self._has_star_import = False
        for node in ast.walk(tree):
            for name in _bound_names(node):
                self._bound[name].append(node)
            if isinstance(node, ast.Import | ast.ImportFrom):
                self._add_import(node)

    def _add_import(self, node: ast.Import | ast.ImportFrom) -> None:
        for alias in node.names:
            if isinstance(node, ast.Import):
                first = alias.name.partition(".")[0]
                self._imported[alias.asname or first].add(alias.name if alias.asname else first)
            elif alias.name == "*":
                self._has_star_import = True
            else:
                module = "" if node.level or not node.module else node.module
                self._imported[alias.asname or alias.name].add(f"{module}.{alias.name}")

    def definition(self, name: str) -> ast.FunctionDef | ast.ClassDef | None:
        """The function or class at the top level, if nothing else in the file binds its name."""
        if name in self._imported or self._has_star_import:
            return None
        match self._bound.get(name):
            case [ast.FunctionDef() | ast.ClassDef() as only] if only in self._tree.body:
                return only
        return None

    def full_name(self, node: ast.expr) -> str:
        """The full name of an imported object, such as ``rclpy.node.Node``; empty if unknown."""
        if isinstance(node, ast.Attribute):
            above = self.full_name(node.value)
            return f"{above}.{node.attr}" if above else ""
        if not isinstance(node, ast.Name) or node.id in self._bound or self._has_star_import:
            return ""
        found = self._imported.get(node.id, set())
        full = next(iter(found)) if len(found) == 1 else ""
        return "" if full.startswith(".") else full


def _bound_names(node: ast.AST) -> Iterator[str]:
    """The names that a node binds, other than by an import."""
    match node:
        case ast.Name(id=name, ctx=ast.Store() | ast.Del()):
            yield name
        case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
            yield node.name
        case ast.arg():
            yield node.arg
        case ast.ExceptHandler(name=str(name)) | ast.MatchAs(name=str(name)):
            yield name
        case ast.MatchStar(name=str(name)) | ast.MatchMapping(rest=str(name)):
            yield name
