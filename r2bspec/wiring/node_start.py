"""How a Python node can be started, read from its source without running it.

A constructor that passes its ``**kwargs`` to `Node` receives name, namespace, remappings and
parameters as keyword arguments. One that takes none receives them as the global ROS arguments of a
process, as by ``ros2 run``, so that its process can hold no other node. A function that calls
``rclpy.init`` itself, such as the ``main`` of an ordinary node, is a program of its own.
"""

from __future__ import annotations

import ast
from typing import Literal

import msgspec

from r2bspec.wiring.source_names import SourceNames

KEYWORD_ARGUMENTS = ("namespace", "cli_args", "use_global_arguments", "parameter_overrides")
"""The keyword arguments of `Node` that r2bspec sets."""

_MAX_BASES = 100
"""Classes may name each other as their bases, although they cannot then be defined."""

StartStyle = Literal["keywords", "ros_arguments", "main"]


class NodeStart(msgspec.Struct, frozen=True):
    """How a Python node is started.

    Attributes:
        style: ``keywords`` for keyword arguments of its constructor, ``ros_arguments`` for global
            ROS arguments of its own process, ``main`` for a function that is a program.
        required: parameters without a default, for which r2bspec has no value.
    """

    style: StartStyle = "keywords"
    required: tuple[str, ...] = ()

    @property
    def needs_own_process(self) -> bool:
        """Whether its process can hold no other node."""
        return self.style != "keywords"


KEYWORDS = NodeStart()
"""How a node is started about whose constructor nothing is known."""


def read_node_start(tree: ast.Module, name: str) -> NodeStart | None:
    """How the class or function `name` of a file is started; None if the file does not say."""
    names = SourceNames(tree)
    found = names.definition(name)
    match found:
        case ast.FunctionDef():
            if found.decorator_list:
                return None
            if _is_program(found):
                return NodeStart("main", _required(found.args, 0))
            return _start(found.args, 0)
        case ast.ClassDef():
            constructor = _constructor(names, found)
            return None if constructor is None else _start(constructor.args, 1)
    return None


def _constructor(names: SourceNames, found: ast.ClassDef) -> ast.FunctionDef | None:
    """The ``__init__`` of a class or of its base classes in the same file."""
    for _ in range(_MAX_BASES):
        if found.decorator_list or found.keywords:
            return None
        named = {each.name: each for each in found.body if isinstance(each, ast.FunctionDef)}
        if "__new__" in named:
            return None
        if "__init__" in named:
            made = named["__init__"]
            return None if made.decorator_list else made
        base = found.bases[0] if len(found.bases) == 1 else None
        above = names.definition(base.id) if isinstance(base, ast.Name) else None
        if not isinstance(above, ast.ClassDef):
            return None
        found = above
    return None


def _start(arguments: ast.arguments, bound: int) -> NodeStart:
    """The start of a callable; its first `bound` parameters are not the caller's."""
    named = {each.arg for each in (*arguments.args[bound:], *arguments.kwonlyargs)}
    takes_all = arguments.kwarg is not None or named.issuperset(KEYWORD_ARGUMENTS)
    required = _required(arguments, bound)
    if takes_all:
        missing = tuple(each for each in required if each not in KEYWORD_ARGUMENTS)
        return NodeStart("keywords", missing)
    return NodeStart("ros_arguments", required)


def _required(arguments: ast.arguments, bound: int) -> tuple[str, ...]:
    """The names of the parameters without defaults."""
    positional = [*arguments.posonlyargs, *arguments.args]
    without_default = positional[bound : len(positional) - len(arguments.defaults)]
    keyword_only = [
        each
        for each, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
        if default is None
    ]
    return tuple(each.arg for each in (*without_default, *keyword_only))


def _is_program(function: ast.FunctionDef) -> bool:
    """Whether a function initialises ROS itself and returns no node."""
    calls = False
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            continue
        if isinstance(node, ast.Return) and not _is_exit_status(node.value):
            return False
        calls = calls or (isinstance(node, ast.Call) and _calls_init(node.func))
        waiting.extend(ast.iter_child_nodes(node))
    return calls


def _is_exit_status(value: ast.expr | None) -> bool:
    return value is None or (isinstance(value, ast.Constant) and not isinstance(value.value, str))


def _calls_init(called: ast.expr) -> bool:
    return (
        isinstance(called, ast.Attribute)
        and called.attr == "init"
        and isinstance(called.value, ast.Name)
        and called.value.id == "rclpy"
    )
