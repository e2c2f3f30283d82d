"""The classes and functions of a Python file, read without running it.

Names mean what the text alone determines. How a node can be started: a constructor that passes its
``**kwargs`` to `Node` receives name, namespace, remappings and parameters as keyword arguments. A
constructor without them receives these as the global ROS arguments of a process, as by ``ros2
run``, so that its process can hold no other node. A function that calls ``rclpy.init`` itself, such
as the ``main`` of an ordinary node, is a program of its own.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Literal

import msgspec

from r2bspec.safe_io.limits import MAX_BASE_CLASSES


class SourceNames:
    """The names that a file binds, anywhere.

    A name means what an import says only if nothing else in the file binds it. What ``import *``
    binds is known of ROS; of other modules it binds no name that the file binds, too.
    """

    def __init__(self, tree: ast.Module) -> None:
        self._tree = tree
        self._imported: dict[str, set[str]] = defaultdict(set)
        self._import_lines: dict[str, int] = {}
        self._bound: dict[str, list[ast.AST]] = defaultdict(list)
        self._stars: list[tuple[int, int, str]] = []
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
                self._stars.append((node.lineno, node.level, node.module or ""))
            else:
                module = "" if node.level or not node.module else node.module
                name = alias.asname or alias.name
                self._imported[name].add(f"{module}.{alias.name}")
                self._origins[name].add((node.level, node.module or "", alias.name))
            self._import_lines[alias.asname or alias.name.partition(".")[0]] = node.lineno

    @property
    def top_level(self) -> list[ast.stmt]:
        """The statements of the file."""
        return self._tree.body

    def _is_hidden(self, name: str, line: int, full: str = "") -> bool:
        """Return whether an ``import *`` after this line may bind the name to something else."""
        return any(
            f"{module}.{name}" != full
            and (_star_binds(module, name) or (_has_types(module) and _has_types(full)))
            for at, _, module in self._stars
            if at > line and _star_binds(module, name) is not False
        )

    def definition(self, name: str) -> ast.FunctionDef | ast.ClassDef | None:
        """Return the function or class at the top level, if nothing else binds its name."""
        if name in self._imported:
            return None
        match self._bound.get(name):
            case [ast.FunctionDef() | ast.ClassDef() as only] if only in self._tree.body:
                return None if self._is_hidden(name, only.lineno) else only
        return None

    def imported_from(self, name: str) -> list[tuple[int, str, str]]:
        """Return level, module and name of the only ``from`` import that may bind a name.

        Of a name that nothing else binds there is one for each ``import *`` of a module that is
        not known, the last first.
        """
        if name in self._bound:
            return []
        if name not in self._imported:
            stars = [(level, module, name) for _, level, module in reversed(self._stars)]
            return [star for star in stars if _star_binds(star[1], name) is None]
        origins = self._origins.get(name, set())
        if not len(origins) == len(self._imported[name]) == 1:
            return []
        is_hidden = self._is_hidden(name, self._import_lines[name], *self._imported[name])
        return [] if is_hidden else [*origins]

    def _starred(self, name: str) -> str:
        """Return the full name of what an ``import *`` binds; empty if that is not known."""
        modules = [module for _, _, module in reversed(self._stars)]
        known = [module for module in modules if _star_binds(module, name)]
        own = {module for module in modules if _star_binds(module, name) is None}
        own = {module for module in own if _has_types(module) and name[:1].isupper()}
        module = known[0] if known else own.pop() if len(own) == 1 else ""
        return f"{module}.{name}" if module else ""

    def constant(self, name: str) -> ast.expr | None:
        """Return the value of a variable at the top level, if nothing else binds its name."""
        if name in self._imported or len(self._bound.get(name, ())) != 1:
            return None
        for statement in self._tree.body:
            match statement:
                case (
                    ast.Assign(targets=[ast.Name(id=target)], value=value)
                    | ast.AnnAssign(target=ast.Name(id=target), value=value)
                ) if target == name:
                    return None if self._is_hidden(name, statement.lineno) else value
        return None

    def full_name(self, node: ast.expr) -> str:
        """Return the full name of an imported object, such as ``rclpy.node.Node``.

        Empty if unknown.
        """
        if isinstance(node, ast.Attribute):
            above = self.full_name(node.value)
            return f"{above}.{node.attr}" if above else ""
        if not isinstance(node, ast.Name) or node.id in self._bound:
            return ""
        imported = self._imported.get(node.id, set())
        if not imported:
            return self._starred(node.id)
        full = next(iter(imported)) if len(imported) == 1 else ""
        is_hidden = self._is_hidden(node.id, self._import_lines[node.id], full)
        return "" if is_hidden or full.startswith(".") else full


_OF_RCLPY = re.compile(
    r"Node|LifecycleNode|Parameter|Duration|Time|Action(Client|Server)|(?i:qos)\w*"
    r"|\w+(Policy|Executor|CallbackGroup)"
)
"""The names of rclpy that nodes use."""


def _has_types(module: str) -> bool:
    """Return whether a module, or that of a full name, has the types of a package."""
    return module.split(".")[1:2] in (["msg"], ["srv"], ["action"])


@lru_cache(maxsize=10_000)
def _star_binds(module: str, name: str) -> bool | None:
    """Return whether ``from module import *`` binds a name; None if the module is not known."""
    package, _, kind = module.partition(".")
    if package == "rclpy":
        return _OF_RCLPY.fullmatch(name) is not None
    if not _has_types(module):
        return None
    from r2bspec.bags.message_types import typestore

    types = typestore().types
    if not any(known.startswith(f"{package}/{kind}/") for known in types):
        return None
    own = f"{package}/{kind}/{name}"
    return any(f"{own}{end}" in types for end in ("", "_Request", "_Goal"))


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


def single_values(top: ast.AST, statements: Iterable[ast.AST] = ()) -> dict[str, ast.expr | None]:
    """Return the only value that each variable gets, ``self.NAME`` too; None if there are others.

    Args:
        top: a method, or a class.
        statements: of it that count; by default all.
    """
    values: dict[str, ast.expr | None] = {}
    for node in statements or ast.walk(top):
        match node:
            case ast.Assign(
                targets=[ast.Name() | ast.Attribute(value=ast.Name(id="self")) as target],
                value=value,
            ):
                name = ast.unparse(target)
                values[name] = None if name in values else value
            case ast.AugAssign(target=ast.Name(id=name)) | ast.For(target=ast.Name(id=name)):
                values[name] = None
            case ast.arg(arg=name):
                values[name] = None
    return values


def _is_exit_status(value: ast.expr | None) -> bool:
    return value is None or (isinstance(value, ast.Constant) and not isinstance(value.value, str))


def _calls_init(called: ast.expr) -> bool:
    return isinstance(called, ast.Attribute) and ast.unparse(called) == "rclpy.init"
