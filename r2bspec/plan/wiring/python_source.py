"""What the source of a Python file says of its classes and functions, without running it.

Names mean what the text alone determines. How a node can be started: a constructor that passes its
``**kwargs`` to `Node` receives name, namespace, remappings and parameters as keyword arguments. One
that takes none receives them as the global ROS arguments of a process, as by ``ros2 run``, so that
its process can hold no other node. A function that calls ``rclpy.init`` itself, such as the
``main`` of an ordinary node, is a program of its own.

What a class says of its node is complete only if `self`, and the methods of `Node` that create
publishers, subscriptions and parameters, are used in no other way than in direct calls, such as
``self.create_publisher(...)``. As soon as one of them is passed, stored or renamed, any code may
use it, and the text of the class no longer determines the interface of the node.
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
        imported = self._imported.get(node.id, set())
        full = next(iter(imported)) if len(imported) == 1 else ""
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
    """How the class or function `name` of a file is started; None if the file does not say."""
    names = SourceNames(tree)
    match definition := names.definition(name):
        case ast.FunctionDef(decorator_list=[]):
            if _is_program(definition):
                return NodeStart("main", _required(definition.args, 0))
            return _start(definition.args, 0)
        case ast.ClassDef():
            constructor = _constructor(names, definition)
            return None if constructor is None else _start(constructor.args, 1)
    return None


def _constructor(names: SourceNames, found: ast.ClassDef) -> ast.FunctionDef | None:
    """The ``__init__`` of a class or of its base classes in the same file."""
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
    """The start of a callable; its first `bound` parameters are not the caller's."""
    names = {parameter.arg for parameter in (*arguments.args[bound:], *arguments.kwonlyargs)}
    required = _required(arguments, bound)
    if arguments.kwarg is None and not names.issuperset(KEYWORD_ARGUMENTS):
        return NodeStart("ros_arguments", required)
    return NodeStart("keywords", tuple(name for name in required if name not in KEYWORD_ARGUMENTS))


def _required(arguments: ast.arguments, bound: int) -> tuple[str, ...]:
    """The names of the parameters without defaults."""
    positional = [*arguments.posonlyargs, *arguments.args]
    without_default = positional[bound : len(positional) - len(arguments.defaults)]
    keyword_only = [
        parameter
        for parameter, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
        if default is None
    ]
    return tuple(parameter.arg for parameter in (*without_default, *keyword_only))


def _is_program(function: ast.FunctionDef) -> bool:
    """Whether a function initialises ROS itself and returns no node."""
    nodes = list(own_nodes(function.body))
    returned = (node.value for node in nodes if isinstance(node, ast.Return))
    called = (node.func for node in nodes if isinstance(node, ast.Call))
    return all(map(_is_exit_status, returned)) and any(map(_calls_init, called))


_NESTED_SCOPES = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda, ast.ClassDef)


def own_nodes(statements: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """The nodes of statements, without those of nested functions and classes.

    Without recursion: each `elif` is one level deeper than the one before.
    """
    waiting = list(statements)
    while waiting:
        node = waiting.pop()
        if not isinstance(node, _NESTED_SCOPES):
            yield node
            waiting.extend(ast.iter_child_nodes(node))


_PROGRAM_CALLS = frozenset(
    f"rclpy.{name}"
    for name in (
        *("init", "ok", "shutdown", "try_shutdown", "spin", "spin_once"),
        *("executors.SingleThreadedExecutor", "executors.MultiThreadedExecutor"),
    )
)
"""What a program calls that creates no topic and no parameter."""

_PROGRAM_METHODS = frozenset(
    {"add_node", "destroy_node", "remove_node", "shutdown", "spin", "spin_once", "get_logger"}
    | {"debug", "info", "warning", "warn", "error", "fatal"}
)
"""Methods of nodes, executors and loggers that a program calls, likewise."""

_REPEATED = (ast.If, ast.For, ast.While, ast.Match, ast.IfExp, ast.BoolOp, ast.ExceptHandler)
"""What is in them may be executed never, or several times."""


def program_class(function: ast.FunctionDef, names: SourceNames) -> ast.ClassDef | None:
    """The class of the file that a program such as ``main`` makes its only node of.

    None if the text does not say that: if the program does anything else than to initialise ROS,
    to make the node once, to spin it and to tidy up.
    """
    if function.decorator_list or not _is_program(function):
        return None
    classes: list[ast.ClassDef] = []
    created = _created_locals(function)
    waiting: list[tuple[ast.AST, bool]] = [(statement, True) for statement in function.body]
    while waiting:
        node, once = waiting.pop()
        if isinstance(node, _NESTED_SCOPES):
            return None
        if isinstance(node, ast.Call):
            of_file = names.definition(node.func.id) if isinstance(node.func, ast.Name) else None
            if isinstance(of_file, ast.ClassDef) and once and not (node.args or node.keywords):
                classes.append(of_file)
            elif not _is_program_call(node.func, names, created):
                return None
        once = once and not isinstance(node, _REPEATED)
        waiting.extend((child, once) for child in ast.iter_child_nodes(node))
    return classes[0] if len(classes) == 1 else None


def _created_locals(function: ast.FunctionDef) -> frozenset[str]:
    """The variables of a function to which nothing else than results of calls is assigned."""
    called = {
        target.id
        for node in ast.walk(function)
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    stored = [
        node.id
        for node in ast.walk(function)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    ]
    return frozenset(name for name in called if stored.count(name) == 1)


def _is_program_call(called: ast.expr, names: SourceNames, created: frozenset[str]) -> bool:
    if names.full_name(called) in _PROGRAM_CALLS:
        return True
    if not isinstance(called, ast.Attribute) or called.attr not in _PROGRAM_METHODS:
        return False
    owner = called.value
    return isinstance(owner, ast.Call) or (isinstance(owner, ast.Name) and owner.id in created)


def _is_exit_status(value: ast.expr | None) -> bool:
    return value is None or (isinstance(value, ast.Constant) and not isinstance(value.value, str))


def _calls_init(called: ast.expr) -> bool:
    return isinstance(called, ast.Attribute) and ast.unparse(called) == "rclpy.init"


PARAMETER_METHODS = frozenset({"declare_parameter", "declare_parameters", "undeclare_parameter"})
_CREATING = PARAMETER_METHODS | {
    *("create_publisher", "create_subscription", "destroy_publisher", "destroy_subscription")
}

_HARMLESS_ATTRIBUTES = frozenset({"default_callback_group", "context", "handle"})
"""Attributes of `Node` that may be passed to other code."""

_METHOD_DECORATORS = frozenset({"staticmethod", "classmethod", "property"})
_NAMES_WITH_ACCESS = frozenset({"locals", "globals", "vars", "eval", "exec", "__class__"})
"""Names of functions that find `self` by other means than its name."""

_SPECIAL_METHODS = frozenset({"__init__", "__del__", "__repr__", "__str__"})
"""Special methods that do not change what an attribute or a constructor is."""


def method_of_self(call: ast.Call) -> str:
    """The method of ``self.method(...)`` or ``super().method(...)``; empty for any other call."""
    called = call.func
    return called.attr if isinstance(called, ast.Attribute) and is_self(called.value) else ""


def is_self(node: ast.AST) -> bool:
    """Whether an expression is `self`, or a call of `super`."""
    if isinstance(node, ast.Name):
        return node.id == "self"
    return isinstance(node, ast.Call) and is_name(node.func, "super") and not node.keywords


def is_name(node: ast.AST, name: str) -> bool:
    """Whether an expression is a name, and this one."""
    return isinstance(node, ast.Name) and node.id == name


def _is_changed_elsewhere(tree: ast.Module, found: ast.ClassDef) -> bool:
    """Whether code of the file may replace attributes of the class, or of `Node`."""
    inside = {id(node) for node in ast.walk(found)}
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(attr=name, ctx=ast.Store() | ast.Del()) if name in _CREATING:
                return True
            case ast.Attribute(value=ast.Name(id=name), ctx=ast.Store() | ast.Del()) if (
                name == found.name
            ):
                return True
            case ast.Constant(value=str(text)) if text in _CREATING:
                return True
            case ast.Call() if id(node) not in inside and _passes(node, found.name):
                return True
            case ast.ClassDef() if node is not found and found.name in {
                name.id for name in node.decorator_list if isinstance(name, ast.Name)
            }:
                return True
    return False


def _passes(call: ast.Call, name: str) -> bool:
    """Whether a call has a name in its arguments, other than as what is called: ``spin(N())``."""
    arguments = (*call.args, *(keyword.value for keyword in call.keywords))
    below = [node for argument in arguments for node in ast.walk(argument)]
    called = sum(isinstance(node, ast.Call) and is_name(node.func, name) for node in below)
    return sum(is_name(node, name) for node in below) != called


def _has_plain_body(found: ast.ClassDef) -> bool:
    """Whether a class consists of plain methods and values, and overrides nothing that creates."""
    for part in found.body:
        match part:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                if not _is_plain_method(part):
                    return False
            case ast.Assign() | ast.AnnAssign():
                if any(isinstance(n, ast.Name) and n.id in _CREATING for n in ast.walk(part)):
                    return False
            case ast.Pass() | ast.Expr(value=ast.Constant()):
                pass
            case _:
                return False
    return True


def _is_plain_method(method: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    special = method.name.startswith("__") and method.name not in _SPECIAL_METHODS
    if special or method.name in _CREATING:
        return False
    decorators = [name.id if isinstance(name, ast.Name) else "" for name in method.decorator_list]
    if not _METHOD_DECORATORS.issuperset(decorators):
        return False
    if {"staticmethod", "classmethod"} & set(decorators):
        return True
    parameters = [*method.args.posonlyargs, *method.args.args]
    return bool(parameters) and parameters[0].arg == "self"


class SelfReferences:
    """How a class uses `self`: a walk over its methods looks at every use.

    Attributes:
        escapes: whether other code may reach the node, or change its class.
        escaped_methods: methods of `Node` that are used other than in direct calls.
    """

    def __init__(self, tree: ast.Module, found: ast.ClassDef) -> None:
        self.escapes = _is_changed_elsewhere(tree, found) or not _has_plain_body(found)
        self.escaped_methods: set[str] = set()
        self._class = found.name
        functions = (ast.FunctionDef, ast.AsyncFunctionDef)
        self._methods = {part.name for part in found.body if isinstance(part, functions)}
        self._data = {
            node.attr
            for node in ast.walk(found)
            if isinstance(node, ast.Attribute)
            and is_self(node.value)
            and isinstance(node.ctx, ast.Store)
        } | {
            node.id
            for statement in found.body
            if isinstance(statement, ast.Assign | ast.AnnAssign)
            for node in ast.walk(statement)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        }
        for part in found.body if not self.escapes else ():
            self._visit(part)

    def _visit(self, top: ast.AST) -> None:
        """Look at everything below a node; without recursion, as each `elif` is one level deep."""
        waiting: list[ast.AST] = [top]
        while waiting:
            node = waiting.pop()
            match node:
                case ast.Attribute() if is_self(node.value):
                    self._attribute(node, called=False, harmless_target=False)
                case ast.Call() if isinstance(node.func, ast.Attribute) and is_self(
                    node.func.value
                ):
                    self._attribute(node.func, called=True, harmless_target=False)
                    waiting.extend(self._arguments(node))
                case ast.Name() if node.id in {"self", "super"} | _NAMES_WITH_ACCESS:
                    self.escapes = True
                case _:
                    waiting.extend(ast.iter_child_nodes(node))

    def _arguments(self, call: ast.Call) -> Iterator[ast.AST]:
        """The arguments of a method of self, other than methods that `Node` takes as callbacks."""
        of_node = method_of_self(call) not in self._methods | self._data
        for argument in (*call.args, *(keyword.value for keyword in call.keywords)):
            if of_node and isinstance(argument, ast.Attribute) and is_self(argument.value):
                self._attribute(argument, called=False, harmless_target=True)
            else:
                yield argument

    def _attribute(self, node: ast.Attribute, *, called: bool, harmless_target: bool) -> None:
        name = node.attr
        if isinstance(node.value, ast.Call) and not self._is_plain_super(node.value):
            self.escapes = True
        elif name.startswith("__"):
            self.escapes |= not (called and name == "__init__" and isinstance(node.value, ast.Call))
        elif name in _CREATING:
            if not called:
                self.escaped_methods.add(name)
        elif name in self._methods:
            self.escapes |= not (called or harmless_target) or name in self._data
        elif name in self._data or name in _HARMLESS_ATTRIBUTES:
            pass
        else:
            # A method of Node: harmless if public and called.
            self.escapes |= not called or name.startswith("_")

    def _is_plain_super(self, call: ast.Call) -> bool:
        """``super()``, or ``super(Class, self)``."""
        match call.args:
            case [] | [ast.Name(id=self._class), ast.Name(id="self")]:
                return True
        return False
