"""The classes and functions of a Python file, read without running it.

Names mean what the text alone determines. How a node can be started: a constructor that passes its
``**kwargs`` to `Node` receives name, namespace, remappings and parameters as keyword arguments. A
constructor without them receives these as the global ROS arguments of a process, as by ``ros2
run``, so that its process can hold no other node. A function that calls ``rclpy.init`` itself, such
as the ``main`` of an ordinary node, is a program of its own.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Literal

import msgspec

from r2bspec.safe_io.limits import MAX_BASE_CLASSES


class SourceNames:
    """The names that a file binds, anywhere.

    A name means what an import says only if nothing else in the file binds it.
    """

    def __init__(self, tree: ast.Module) -> None:
        self._tree = tree
        self._imported: dict[str, set[str]] = defaultdict(set)
        self._bound: dict[str, list[ast.AST]] = defaultdict(list)
        self._has_star_import = False
        self._origins: dict[str, set[tuple[int, str, str]]] = defaultdict(set)
        for node in ast.walk(tree):
            for name in bound_names(node):
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
                name = alias.asname or alias.name
                self._imported[name].add(f"{module}.{alias.name}")
                self._origins[name].add((node.level, node.module or "", alias.name))

    @property
    def top_level(self) -> list[ast.stmt]:
        """The statements of the file."""
        return self._tree.body

    def definition(self, name: str) -> ast.FunctionDef | ast.ClassDef | None:
        """Return the function or class at the top level, if nothing else binds its name."""
        if name in self._imported or self._has_star_import:
            return None
        match self._bound.get(name):
            case [ast.FunctionDef() | ast.ClassDef() as only] if only in self._tree.body:
                return only
        return None

    def imported_from(self, name: str) -> tuple[int, str, str] | None:
        """Return level, module and name of the only ``from`` import that binds a name."""
        if name in self._bound or self._has_star_import or len(self._imported.get(name, ())) != 1:
            return None
        origins = self._origins.get(name, set())
        return next(iter(origins)) if len(origins) == 1 else None

    def constant(self, name: str) -> ast.expr | None:
        """Return the value of a variable at the top level, if nothing else binds its name."""
        if name in self._imported or self._has_star_import or len(self._bound.get(name, ())) != 1:
            return None
        for statement in self._tree.body:
            match statement:
                case ast.Assign(targets=[ast.Name(id=target)], value=value) if target == name:
                    return value
                case ast.AnnAssign(target=ast.Name(id=target), value=value) if target == name:
                    return value
        return None

    def full_name(self, node: ast.expr) -> str:
        """Return the full name of an imported object, such as ``rclpy.node.Node``.

        Empty if unknown.
        """
        if isinstance(node, ast.Attribute):
            above = self.full_name(node.value)
            return f"{above}.{node.attr}" if above else ""
        if not isinstance(node, ast.Name) or node.id in self._bound or self._has_star_import:
            return ""
        imported = self._imported.get(node.id, set())
        full = next(iter(imported)) if len(imported) == 1 else ""
        return "" if full.startswith(".") else full


def bound_names(node: ast.AST) -> Iterator[str]:
    """Yield the names that a node binds, other than by an import."""
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


KEYWORD_ARGUMENTS = ("namespace", "cli_args", "use_global_arguments", "parameter_overrides")
"""The keyword arguments of `Node` that r2bspec sets."""


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
    """Return how the class or function `name` of a file is started.

    None if the file does not say.
    """
    names = SourceNames(tree)
    match definition := names.definition(name):
        case ast.FunctionDef(decorator_list=[]):
            if is_program(definition):
                return NodeStart("main", _required(definition.args, 0))
            return _start(definition.args, 0)
        case ast.ClassDef():
            constructor = _constructor(names, definition)
            return None if constructor is None else _start(constructor.args, 1)
    return None


def _constructor(names: SourceNames, found: ast.ClassDef) -> ast.FunctionDef | None:
    """Return the ``__init__`` of a class or of its base classes in the same file."""
    for _ in range(MAX_BASE_CLASSES):
        if found.decorator_list or found.keywords:
            return None
        methods = {part.name: part for part in found.body if isinstance(part, ast.FunctionDef)}
        if "__new__" in methods:
            return None
        if (constructor := methods.get("__init__")) is not None:
            return None if constructor.decorator_list else constructor
        base = found.bases[0] if len(found.bases) == 1 else None
        above = names.definition(base.id) if isinstance(base, ast.Name) else None
        if not isinstance(above, ast.ClassDef):
            return None
        found = above
    return None


def _start(arguments: ast.arguments, bound: int) -> NodeStart:
    """Return the start of a callable; its first `bound` parameters are not the caller's."""
    names = {parameter.arg for parameter in (*arguments.args[bound:], *arguments.kwonlyargs)}
    required = _required(arguments, bound)
    if arguments.kwarg is None and not names.issuperset(KEYWORD_ARGUMENTS):
        return NodeStart("ros_arguments", required)
    return NodeStart("keywords", tuple(name for name in required if name not in KEYWORD_ARGUMENTS))


def _required(arguments: ast.arguments, bound: int) -> tuple[str, ...]:
    """Return the names of the parameters without defaults."""
    positional = [*arguments.posonlyargs, *arguments.args]
    without_default = positional[bound : len(positional) - len(arguments.defaults)]
    keyword_only = [
        parameter
        for parameter, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
        if default is None
    ]
    return tuple(parameter.arg for parameter in (*without_default, *keyword_only))


def is_program(function: ast.FunctionDef) -> bool:
    """Return True if a function initialises ROS itself and returns no node."""
    nodes = list(own_nodes(function.body))
    returned = (node.value for node in nodes if isinstance(node, ast.Return))
    called = (node.func for node in nodes if isinstance(node, ast.Call))
    return all(map(_is_exit_status, returned)) and any(map(_calls_init, called))


_NESTED_SCOPES = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda, ast.ClassDef)


def own_nodes(statements: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """Yield the nodes of statements, without those of nested functions and classes.

    Without recursion: each `elif` is one level deeper than the one before.
    """
    waiting = list(statements)
    while waiting:
        node = waiting.pop()
        if not isinstance(node, _NESTED_SCOPES):
            yield node
            waiting.extend(ast.iter_child_nodes(node))


def returned_value(definition: ast.stmt) -> ast.expr | None:
    """Return what a function returns; None without a single ``return``."""
    body = definition.body if isinstance(definition, ast.FunctionDef) else []
    match [node for node in own_nodes(body) if isinstance(node, ast.Return)]:
        case [only]:
            return only.value
    return None


def _is_exit_status(value: ast.expr | None) -> bool:
    return value is None or (isinstance(value, ast.Constant) and not isinstance(value.value, str))


def _calls_init(called: ast.expr) -> bool:
    return isinstance(called, ast.Attribute) and ast.unparse(called) == "rclpy.init"
