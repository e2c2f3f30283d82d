"""The topic that an expression in the source of a node means, if the text determines it.

It is a literal, a name that is bound to one once, or the value of a parameter with a literal name,
which is written ``$(parameter NAME)`` as in an interface file.
"""

from __future__ import annotations

import ast
from collections import defaultdict

from r2bspec.plan.wiring.python_source import SourceNames, nodes_below
from r2bspec.plan.wiring.self_references import is_name, is_self, method_of_self

_PARAMETER_VALUES = frozenset({"value", "string_value"})
_NUMBER_VALUES = frozenset({"value", "double_value", "integer_value"})
_PARAMETER_SOURCES = frozenset({"declare_parameter", "get_parameter"})
_MAX_STEPS = 10


class TopicNames:
    """Resolves the expressions of one class.

    Args:
        found: the class.
        names: the names of its file.
    """

    def __init__(self, found: ast.ClassDef, names: SourceNames) -> None:
        self._names = names
        self._locals = {
            id(method): _single_values(method, attributes=False)
            for method in found.body
            if isinstance(method, ast.FunctionDef)
        }
        self._attributes = _single_values(found, attributes=True)

    def resolve(self, node: ast.expr | None, method: ast.AST) -> str | None:
        """The topic that an expression in a method means; None if the text does not say it."""
        match self._followed(node, method):
            case ast.Constant(value=str(text)):
                return text
            case ast.Attribute(value=inner, attr=name) if name in _PARAMETER_VALUES:
                return self._parameter(inner, method)
        return None

    def number(self, node: ast.expr | None, method: ast.AST) -> str | None:
        """The number that an expression in a method means, or the quotient of two; as text.

        The value of a parameter is ``$(parameter NAME)``.
        """
        match self._followed(node, method):
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                sides = [self._simple_number(side, method) for side in (left, right)]
                return " / ".join(side for side in sides if side) if all(sides) else None
            case found:
                return self._simple_number(found, method)

    def _simple_number(self, node: ast.expr | None, method: ast.AST) -> str | None:
        match self._followed(node, method):
            case ast.Constant(value=int() | float() as number):
                return f"{number}"
            case ast.Attribute(value=inner, attr=name) if name in _NUMBER_VALUES:
                return self._parameter(inner, method)
        return None

    def stored(self, attribute: str) -> ast.expr | None:
        """The only value that an attribute of `self` gets; None if there are others."""
        return self._attributes.get(attribute)

    def _followed(self, node: ast.expr | None, method: ast.AST) -> ast.expr | None:
        """What a name or an attribute is bound to, once and for all; None if that is not known."""
        for _ in range(_MAX_STEPS):
            match node:
                case ast.Name(id=name):
                    known = self._locals.get(id(method), {})
                    node = known[name] if name in known else self._names.constant(name)
                case ast.Attribute(attr=name) if is_name(node.value, "self"):
                    node = self.stored(name)
                case _:
                    return node
        return None

    def _parameter(self, node: ast.expr | None, method: ast.AST) -> str | None:
        """The reference to a parameter that an expression is, or whose value it is."""
        for _ in range(_MAX_STEPS):
            match node:
                case ast.Name(id=name):
                    node = self._locals.get(id(method), {}).get(name)
                case ast.Call(func=ast.Attribute(value=inner, attr="get_parameter_value")):
                    node = inner
                case ast.Call(args=[ast.Constant(value=str(name)), *_]) if (
                    method_of_self(node) in _PARAMETER_SOURCES
                ):
                    return f"$(parameter {name})"
                case _:
                    return None
        return None


def _single_values(top: ast.AST, *, attributes: bool) -> dict[str, ast.expr | None]:
    """The only value that each variable gets, or attribute of `self`; None if there are others."""
    values: dict[str, list[ast.expr | None]] = defaultdict(list)
    for node in nodes_below(top):
        match node:
            case ast.Assign(targets=[target], value=value):
                _add(values, target, value, attributes=attributes)
            case ast.AnnAssign(target=target, value=ast.expr() as value):
                _add(values, target, value, attributes=attributes)
            case ast.arg(arg=name) if not attributes:
                values[name] += [None, None]
    for node in nodes_below(top):
        # What is bound by a loop, `with` or the like has no value here.
        if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            name = _bound(node, attributes=attributes)
            stored = values[name] if name else []
            stored.append(None)
    # Each assignment was counted as one, and its target as another.
    return {name: found[0] if len(found) == 2 else None for name, found in values.items()}


def _add(
    values: dict[str, list[ast.expr | None]],
    target: ast.expr,
    value: ast.expr,
    *,
    attributes: bool,
) -> None:
    if name := _bound(target, attributes=attributes):
        values[name].append(value)


def _bound(target: ast.expr, *, attributes: bool) -> str:
    """The variable, or the attribute of `self`, that a target binds; empty for another one."""
    match target:
        case ast.Name(id=name) if not attributes:
            return name
        case ast.Attribute(attr=name) if attributes and is_self(target.value):
            return name
    return ""
