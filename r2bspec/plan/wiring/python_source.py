"""What the source of a Python file says of its classes and functions, without running it.

Names mean what the text alone determines. How a node can be started: a constructor that passes its
``**kwargs`` to `Node` receives name, namespace, remappings and parameters as keyword arguments. One
that takes none receives them as the global ROS arguments of a process, as by ``ros2 run``, so that
its process can hold no other node. A function that calls ``rclpy.init`` itself, such as the
``main`` of an ordinary node, is a program of its own.
"""

from __future__ import annotations

import ast
import copy
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import Literal

import msgspec

from r2bspec.safe_io.limits import MAX_BASE_CLASSES


@lru_cache(maxsize=32)
def nodes_below(top: ast.AST) -> tuple[ast.AST, ...]:
    """A node of a tree and everything below it, as `ast.walk` gives it; kept for the next walk.

    A class is walked for a dozen questions, which was most of the time of reading it.
    """
    return tuple(ast.walk(top))


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
        for node in nodes_below(tree):
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

    def definition(self, name: str) -> ast.FunctionDef | ast.ClassDef | None:
        """The function or class at the top level, if nothing else in the file binds its name."""
        if name in self._imported or self._has_star_import:
            return None
        match self._bound.get(name):
            case [ast.FunctionDef() | ast.ClassDef() as only] if only in self._tree.body:
                return only
        return None

    def imported_from(self, name: str) -> tuple[int, str, str] | None:
        """The level, the module and the name of the only ``from`` import that binds a name."""
        if name in self._bound or self._has_star_import or len(self._imported.get(name, ())) != 1:
            return None
        origins = self._origins.get(name, set())
        return next(iter(origins)) if len(origins) == 1 else None

    def constant(self, name: str) -> ast.expr | None:
        """The value of a variable at the top level, if nothing else in the file binds its name."""
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
        """The full name of an imported object, such as ``rclpy.node.Node``; empty if unknown."""
        if isinstance(node, ast.Attribute):
            above = self.full_name(node.value)
            return f"{above}.{node.attr}" if above else ""
        if not isinstance(node, ast.Name) or node.id in self._bound or self._has_star_import:
            return ""
        imported = self._imported.get(node.id, set())
        full = next(iter(imported)) if len(imported) == 1 else ""
        return "" if full.startswith(".") else full


def bound_names(node: ast.AST) -> Iterator[str]:
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
        threads_of_main: of the multi-threaded executor that a program of the same file makes for
            the class, 0 for its default; None if no program makes one.
    """

    style: StartStyle = "keywords"
    required: tuple[str, ...] = ()
    threads_of_main: int | None = None

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
            if is_program(definition):
                return NodeStart("main", _required(definition.args, 0))
            return _start(definition.args, 0)
        case ast.ClassDef():
            constructor = _constructor(names, definition)
            start = None if constructor is None else _start(constructor.args, 1)
            threads = _threads_of_main(tree, names, name)
            if threads is None:
                return start
            return msgspec.structs.replace(start or KEYWORDS, threads_of_main=threads)
    return None


_MULTI_THREADED = "rclpy.executors.MultiThreadedExecutor"


def _threads_of_main(tree: ast.Module, names: SourceNames, name: str) -> int | None:
    """The threads of the multi-threaded executor that a program of the file makes for a class."""
    for function in tree.body:
        if not isinstance(function, ast.FunctionDef) or not is_program(function):
            continue
        calls = [node for node in nodes_below(function) if isinstance(node, ast.Call)]
        if not any(isinstance(each.func, ast.Name) and each.func.id == name for each in calls):
            continue
        for call in calls:
            if names.full_name(call.func) == _MULTI_THREADED:
                values = [*call.args, *(k.value for k in call.keywords if k.arg == "num_threads")]
                given = values[0] if values else None
                threads = given.value if isinstance(given, ast.Constant) else 0
                return threads if isinstance(threads, int) else 0
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


def is_program(function: ast.FunctionDef) -> bool:
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
        *("init", "ok", "shutdown", "try_shutdown"),
        *("spin", "spin_once", "spin_until_future_complete"),
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


def program_class(
    function: ast.FunctionDef, names: SourceNames, is_class: Callable[[str], bool]
) -> tuple[str, str]:
    """The name of the class that a program such as ``main`` makes its only node of.

    Args:
        function: the program.
        names: of its file.
        is_class: whether a name is that of a class that can be read.

    Returns:
        The name, empty if there is none or there are several; and why the program may
        make other topics, too: because it does anything else than to initialise ROS, to make the
        node once, to spin it and to tidy up. Empty if it does not.
    """
    if function.decorator_list or not is_program(function):
        return "", f"{function.name} is a function that returns a node"
    classes: list[str] = []
    more = ""
    created = created_locals(function)
    waiting = deque[tuple[ast.AST, bool]]((statement, True) for statement in function.body)
    while waiting:
        node, once = waiting.popleft()
        if isinstance(node, _NESTED_SCOPES):
            more = more or f"line {node.lineno} is a function inside of {function.name}"
        if isinstance(node, ast.Call):
            called = node.func.id if isinstance(node.func, ast.Name) else ""
            if called and is_class(called):
                classes.append(called)
                if not once or node.args or node.keywords:
                    more = more or f"line {node.lineno} makes {called} in its own way"
            elif not is_program_call(node.func, names, created):
                more = more or f"line {node.lineno} calls {ast.unparse(node.func)}()"
        once = once and not isinstance(node, _REPEATED)
        waiting.extend((child, once) for child in ast.iter_child_nodes(node))
    if len(classes) == 1:
        return classes[0], more
    return "", f"{function.name} makes {len(classes) or 'no'} nodes of classes that are read"


def created_locals(function: ast.FunctionDef) -> frozenset[str]:
    """The variables of a function to which nothing else than results of calls is assigned."""
    called = {
        target.id
        for node in nodes_below(function)
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    stored = Counter(
        node.id
        for node in nodes_below(function)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    )
    return frozenset(name for name in called if stored[name] == 1)


def is_program_call(called: ast.expr, names: SourceNames, created: frozenset[str]) -> bool:
    """Whether a program calls it to spin and to tidy up: it makes no topic and no parameter."""
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


_LOAD = ast.Load()


def class_of_program(program: ast.FunctionDef, names: SourceNames) -> ast.ClassDef | None:
    """The class that a program amounts to that makes its node itself.

    ``node = rclpy.create_node("filter")`` or ``node = Node("filter")`` in a ``main``, whose
    callbacks are functions inside of it, makes what a class makes whose constructor has the same
    text, with `self` in the place of `node`. None if the function is no program, or does not make
    exactly one node, once, in a variable of its own, or spins another one.
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
