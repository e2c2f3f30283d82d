"""A program that makes its node itself, read as the class that it amounts to.

``node = rclpy.create_node("filter")`` or ``node = Node("filter")`` in a ``main``, whose callbacks
are functions inside of it, makes what a class makes whose constructor has the same text, with
`self` in the place of `node`.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator

from r2bspec.plan.wiring.python_source import (
    SourceNames,
    bound_names,
    created_locals,
    is_program,
    is_program_call,
)

_LOAD = ast.Load()


def class_of_program(program: ast.FunctionDef, names: SourceNames) -> ast.ClassDef | None:
    """The class that a program amounts to.

    None if the function is no program, or does not make exactly one node, once, in a variable of
    its own, or spins another one.
    """
    if not (is_program(program) and any(_base(each, names) for each in ast.walk(program))):
        return None
    # Trees are shared.
    program = copy.deepcopy(program)
    statements = list(_executed_once(program.body))
    made = [each for each in ast.walk(program) if _base(each, names)]
    for number, statement in enumerate(statements):
        match statement:
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Call() as call) if made == [
                call
            ] and _is_the_only(program, name):
                base = _base(call, names)
                statements[number] = ast.Expr(call)
                call.func = ast.Attribute(
                    ast.Call(ast.Name("super", _LOAD), [], []), "__init__", _LOAD
                )
                break
    else:
        return None
    substitution = _Substitution(name, names, created_locals(program))
    body = [substitution.visit(statement) for statement in statements]
    if substitution.spins_another or base is None:
        return None
    parameters = ast.arguments([], [ast.arg("self")], None, [], [], None, [])
    constructor = ast.FunctionDef("__init__", parameters, body, [])
    found = ast.ClassDef(program.name, [base], [], [constructor], [])
    return ast.fix_missing_locations(ast.copy_location(found, program))


def _base(node: ast.AST, names: SourceNames) -> ast.expr | None:
    """The class of a node that a call makes of no other class; None for any other call."""
    match node:
        case ast.Call(func=ast.Attribute(value=package) as func) if (
            names.full_name(func) == "rclpy.create_node"
        ):
            return ast.Attribute(ast.Attribute(package, "node", _LOAD), "Node", _LOAD)
        case ast.Call(func=func) if names.full_name(func) == "rclpy.node.Node":
            return func
    return None


def _executed_once(statements: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements, with those of `with` and `try` in their place."""
    for statement in statements:
        match statement:
            case ast.With(items=items, body=body):
                yield from (
                    ast.copy_location(ast.Expr(each.context_expr), body[0]) for each in items
                )
                yield from _executed_once(body)
            case ast.Try(body=body, handlers=handlers, orelse=orelse, finalbody=finalbody):
                yield from _executed_once(body)
                rest = [part for each in handlers for part in each.body] + orelse + finalbody
                yield ast.copy_location(ast.If(ast.Constant(True), rest, []), statement)
            case _:
                yield statement


def _is_the_only(program: ast.FunctionDef, name: str) -> bool:
    """Whether a variable of a program is bound once, and `self` nowhere."""
    bound = [found for node in ast.walk(program) for found in bound_names(node)]
    imported = {
        each.asname or each.name for each in ast.walk(program) if isinstance(each, ast.alias)
    }
    shared = {
        each
        for node in ast.walk(program)
        if isinstance(node, ast.Global | ast.Nonlocal)
        for each in node.names
    }
    mentioned = {node.id for node in ast.walk(program) if isinstance(node, ast.Name)}
    return bound.count(name) == 1 and not {name, "self"} & (imported | shared | mentioned - {name})


class _Substitution(ast.NodeTransformer):
    """Puts `self` in the place of a variable, but where a program only spins or removes the node.

    Attributes:
        spins_another: whether the program spins something else.
    """

    def __init__(self, name: str, names: SourceNames, created: frozenset[str]) -> None:
        self._name = name
        self._names = names
        self._created = created
        self.spins_another = False

    def visit_Name(self, node: ast.Name) -> ast.Name:
        if node.id != self._name:
            return node
        return ast.copy_location(ast.Name("self", _LOAD), node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        if is_program_call(node.func, self._names, self._created):
            is_method = isinstance(node.func, ast.Attribute) and node.func.attr == "add_node"
            takes_node = is_method or self._names.full_name(node.func).startswith("rclpy.spin")
            for number, given in enumerate(node.args):
                if isinstance(given, ast.Name) and given.id == self._name:
                    node.args[number] = ast.copy_location(ast.Constant(None), given)
                elif number == 0 and takes_node:
                    self.spins_another = True
        return self.generic_visit(node)
