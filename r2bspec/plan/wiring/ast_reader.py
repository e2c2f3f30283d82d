"""Reading a node's topics and parameters from its Python source, without running it.

Every call of `create_publisher`, `create_subscription` and `declare_parameter` on `self` counts
whose arguments the text determines. These are all that the node has if the only base class of its
class is `Node` or `LifecycleNode`, if no other code can create topics or parameters of the node
(`r2bspec.plan.wiring.self_references`), and if each of the calls is certainly made once: by a
statement of the constructor, of a method that only the constructor calls, or of ``on_configure``,
outside of loops and branches. Otherwise the interface says why there may be more. A function that
makes one node of such a class, or of `Node` itself, and spins it, has the interface of that node.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

from r2bspec.language.spec import QoS
from r2bspec.plan.wiring import literal_calls, python_files, self_references
from r2bspec.plan.wiring.literal_calls import TopicNames
from r2bspec.plan.wiring.node_interface import InterfaceEntry, ParameterInfo
from r2bspec.plan.wiring.python_source import (
    SourceNames,
    class_of_program,
    nodes_below,
    own_nodes,
    program_class,
)
from r2bspec.plan.wiring.self_references import is_name
from r2bspec.safe_io.limits import MAX_BASE_CLASSES

_SIMPLE_STATEMENTS = (ast.Expr, ast.Assign, ast.AnnAssign)
"""Statements of a constructor that are executed exactly once."""

_CONDITIONAL_NODES = (
    *(ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda, ast.ClassDef),
    *(ast.IfExp, ast.BoolOp, ast.Compare),
    *(ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp),
)
"""Expressions whose parts may be evaluated several times, or not at all."""

_PARAMETER_OPTIONS = frozenset(
    {"automatically_declare_parameters_from_overrides", "allow_undeclared_parameters"}
)
"""Options of `Node` with which it has parameters that it does not declare by name."""

_LIFECYCLE_NODES = frozenset(
    f"rclpy.lifecycle.{name}" for name in ("LifecycleNode", "Node", "node.LifecycleNode")
)
_CLEANING_METHODS = frozenset({"on_cleanup", "on_shutdown", "on_error", "destroy_node"})
"""What they destroy is not missed by a run."""

_Side = Literal["publishes", "subscribes"]


class _NodeClass(NamedTuple):
    """A class of a node, and the file that defines it."""

    file: python_files.SourceFile
    node: ast.ClassDef

    @property
    def base(self) -> str:
        """The full name of the only class that it inherits from; empty if it is not known."""
        bases = self.node.bases
        return self.file.names.full_name(bases[0]) if len(bases) == 1 else ""

    @property
    def replaces_methods(self) -> bool:
        """Whether what creates topics may be others than the methods of `Node`."""
        return self_references.replaces_methods(self.file.tree, self.node)


class _Call(NamedTuple):
    """A call that may make topics, its method, and whether it is certainly made exactly once."""

    node: ast.Call
    method: ast.AST
    certain: bool

    def argument(self, position: int, name: str) -> ast.expr | None:
        """An argument by its position or its name; None if it is not given."""
        return literal_calls.argument(self.node, position, name)


@dataclass
class _ClassReading:
    """What a class says of its node, so far.

    Attributes:
        lifecycle: whether it is the class of a lifecycle node.
        topics: the types of the known topics of each side; empty if unknown.
        more: why there may be more topics of a side; empty if there are none.
        parameters: None as soon as they are not all known.
        services: the types of services and actions by name; empty for one that it only calls.
        name: that its constructor gives it; empty if the text does not say it.
        timed: the topics that it publishes by a timer, with its period as text.
    """

    found: _NodeClass
    lifecycle: bool
    topics: dict[_Side, dict[str, str]] = field(
        default_factory=lambda: {"publishes": {}, "subscribes": {}}
    )
    more: dict[_Side, str] = field(default_factory=lambda: {"publishes": "", "subscribes": ""})
    parameters: dict[str, ParameterInfo] | None = field(default_factory=dict)
    qos: dict[str, QoS] = field(default_factory=dict)
    services: dict[str, str] = field(default_factory=dict)
    name: str = ""
    timed: dict[str, str | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.names = self.found.file.names
        self.values = TopicNames(self.found.node, self.names)

    def read(self) -> None:
        """Take the text of the class into account."""
        tree, node_class = self.found.file.tree, self.found.node
        if why := _unusual_base(self.found):
            self.forget_all(why)
        uses = self_references.SelfReferences(tree, node_class, self.names)
        if uses.escape:
            self.forget_all(uses.escape)
        for method, why in uses.escaped_methods.items():
            self.forget(method, why)
        for call in _calls(node_class, self.names, lifecycle=self.lifecycle):
            self._add(call)
        self.timed.update(literal_calls.timer_outputs(node_class, self.values))
        if not _passes_keywords_unchanged(node_class):
            self.forget_all("its constructor changes the arguments that it passes to Node")
        self._settle_parameters_in_topics()

    def inherit(self, base: _ClassReading) -> None:
        """Add the literal topics of a base class; that there may be others has been noted."""
        for side, topics in base.topics.items():
            for topic, kind in topics.items():
                if "$(" not in topic:
                    self.topics[side].setdefault(topic, kind)

    def forget(self, method: str, why: str) -> None:
        """Note that a method of `Node` may be called elsewhere."""
        if method in self_references.PARAMETER_METHODS:
            self.parameters = None
        else:
            self._doubt("subscribes" if method.endswith("_subscription") else "publishes", why)

    def forget_all(self, why: str) -> None:
        """Note that nothing is known to be complete."""
        self._doubt("publishes", why)
        self._doubt("subscribes", why)
        self.parameters = None

    def _doubt(self, side: _Side, why: str) -> None:
        """Note why there may be more topics of a side."""
        self.more[side] = self.more[side] or why

    def _add(self, call: _Call) -> None:
        """Take a call of a method of `self`, or of a helper, into account."""
        method = self_references.method_of_self(call.node)
        helper = self_references.helper_of(call.node, self.names)
        if helper is not None:
            self._add_helper(call, helper)
        elif method in self_references.PUBLISHER_METHODS:
            self._add_topic("publishes", call)
        elif method == "create_subscription":
            self._add_topic("subscribes", call)
        elif method == "create_service":
            self._add_service(call, "srv", first=0)
        elif method in {"declare_parameter", "declare_parameters"}:
            self._add_parameters(call, method)
        elif method == "__init__":
            self._add_base_constructor(call)
        elif method in {"destroy_publisher", "destroy_subscription", "undeclare_parameter"} and (
            getattr(call.method, "name", "") not in _CLEANING_METHODS
        ):
            self.forget(method, f"line {call.node.lineno} calls {method}")

    def _add_topic(self, side: _Side, call: _Call, first: int = 0) -> None:
        """Take a publisher or a subscription into account, whose type is the argument `first`."""
        what = "publisher" if side == "publishes" else "subscription"
        line = f"line {call.node.lineno}"
        topic = self.values.resolve(call.argument(first + 1, "topic"), call.method)
        if topic is None:
            self._doubt(side, f"{line} makes a {what} whose topic is no literal")
            return
        if not call.certain:
            self._doubt(side, f"whether {line} makes a {what}, and how often, is not known")
        written = literal_calls.interface_type(call.argument(first, "msg_type"), self.names)
        if self.topics[side].setdefault(topic, written) != written:
            self.topics[side][topic] = ""
        position = first + (2 if side == "publishes" else 3)
        qos = literal_calls.qos_profile(call.node, position, self.names)
        if qos is not None:
            self.qos[topic] = qos

    def _add_helper(self, call: _Call, helper: self_references.NodeHelper) -> None:
        """Take the topics into account that a class of another package makes for the node."""
        self.topics["publishes"].update(helper.publishes)
        self.topics["subscribes"].update(helper.subscribes)
        if helper.makes_subscription:
            self._add_topic("subscribes", call, first=1)
        if helper.names_action:
            self._add_service(call, "action", first=1, answers=helper.answers)

    def _add_service(
        self, call: _Call, kind: Literal["srv", "action"], *, first: int, answers: bool = True
    ) -> None:
        """Take a service or an action into account: its type is an argument, its name the next."""
        name = self.values.resolve(call.argument(first + 1, f"{kind}_name"), call.method)
        if name is not None:
            given = call.argument(first, f"{kind}_type")
            written = literal_calls.interface_type(given, self.names, kind)
            self.services[name] = written if answers else ""

    def _add_parameters(self, call: _Call, method: str) -> None:
        """Take the declaration of a parameter, or of several, into account."""
        declared = literal_calls.declared_parameters(call.node, method) if call.certain else None
        if declared is None or self.parameters is None:
            self.parameters = None
        else:
            self.parameters.update(declared)

    def _add_base_constructor(self, call: _Call) -> None:
        """Take the arguments of ``super().__init__`` into account.

        They name the node, and may declare every parameter that is set, and rename topics.
        """
        match call.argument(0, "node_name"):
            case ast.Constant(value=str(name)):
                self.name = name
        for keyword in call.node.keywords:
            if keyword.arg == "cli_args":
                self.forget_all(f"line {call.node.lineno} sets cli_args, which may rename topics")
            if keyword.arg in _PARAMETER_OPTIONS and ast.unparse(keyword.value) != "False":
                self.parameters = None

    def _settle_parameters_in_topics(self) -> None:
        """Leave out topics that are named by parameters whose default the text does not say."""
        for side, topics in self.topics.items():
            for topic in [each for each in topics if each.startswith("$(parameter ")]:
                name = topic.removeprefix("$(parameter ").removesuffix(")")
                declared = (self.parameters or {}).get(name)
                if declared is None or not isinstance(declared.default, str):
                    del topics[topic]
                    self._doubt(side, f"the default of parameter {name!r} is no literal")

    def entry(self) -> InterfaceEntry:
        """The interface."""
        return InterfaceEntry(
            subscribes=self.topics["subscribes"],
            publishes=self.topics["publishes"],
            parameters=self.parameters,
            services=self.services,
            qos=self.qos,
            origin="source",
            name=self.name,
            timed=self.timed,
            may_publish_more=self.more["publishes"],
            may_subscribe_more=self.more["subscribes"],
            is_lifecycle=self.lifecycle,
        )


def unknown_interface(why: str) -> InterfaceEntry:
    """The interface of a node of which nothing is known, and why."""
    return InterfaceEntry(
        None, None, None, origin="source", may_publish_more=why, may_subscribe_more=why
    )


def read_node_class(
    tree: ast.Module,
    name: str,
    path: Path | None = None,
    read: python_files.ReadSource = lambda _: None,
) -> InterfaceEntry:
    """The interface of a class of a file, or of the function that runs one.

    Args:
        tree: of the file.
        name: of the class, or of a function such as ``main`` (`program_class`).
        path: of the file, absolute; without one, its imports are not followed.
        read: reads other files of its package.
    """
    found, more = _started_class(python_files.source_file(tree, path, read), name)
    if found is None:
        return unknown_interface(more)
    if found.replaces_methods:
        return unknown_interface(f"{name} makes its topics by methods of its own")
    bases = list(_bases(found))
    lifecycle = any(each.base in _LIFECYCLE_NODES for each in (found, *bases))
    result = _ClassReading(found, lifecycle)
    if more:
        result.forget_all(more)
    result.read()
    for base in bases:
        if not base.replaces_methods:
            inherited = _ClassReading(base, lifecycle)
            inherited.read()
            result.inherit(inherited)
    return result.entry()


def _started_class(file: python_files.SourceFile, name: str) -> tuple[_NodeClass | None, str]:
    """The class that a name means, or that a program amounts to; and why there may be more."""
    found = python_files.find_definition(file, name)
    match found:
        case python_files.Definition(file=file, node=ast.ClassDef() as node):
            return _NodeClass(file, node), ""
        case python_files.Definition(file=file, node=ast.FunctionDef() as program):
            is_class = partial(_class_named, file)
            made, more = program_class(program, file.names, lambda each: bool(is_class(each)))
            if made:
                return is_class(made), more
            as_class = class_of_program(program, file.names)
            return (None, more) if as_class is None else (_NodeClass(file, as_class), "")
    return None, f"{name} is not a class of its file"


def _class_named(file: python_files.SourceFile, name: str) -> _NodeClass | None:
    match python_files.find_definition(file, name):
        case python_files.Definition(file=origin, node=ast.ClassDef() as node):
            return _NodeClass(origin, node)
    return None


def _bases(found: _NodeClass) -> Iterator[_NodeClass]:
    """The base classes that can be read, the nearest first."""
    for _ in range(MAX_BASE_CLASSES):
        match found.node.bases:
            case [ast.Name(id=name)]:
                above = _class_named(found.file, name)
            case _:
                return
        if above is None or above.node is found.node:
            return
        yield above
        found = above


def _unusual_base(found: _NodeClass) -> str:
    """Why a class may have topics of others; empty if it is a plain class of a node."""
    node = found.node
    if found.base not in {"rclpy.node.Node", *_LIFECYCLE_NODES}:
        bases = ", ".join(map(ast.unparse, node.bases)) or "nothing"
        return f"{node.name} inherits from {bases}, which may have others"
    if node.decorator_list or node.keywords:
        return f"{node.name} has a decorator or a metaclass"
    return ""


def _passes_keywords_unchanged(found: ast.ClassDef) -> bool:
    """Whether arguments with ``**`` are only those of the caller, and are not changed.

    Others may have any option of `Node`.
    """
    for method in found.body:
        if not isinstance(method, ast.FunctionDef) or method.name != "__init__":
            continue
        own = method.args.kwarg.arg if method.args.kwarg else ""
        nodes = nodes_below(method)
        mentions = sum(is_name(node, own) for node in nodes)
        if mentions != sum(_harmless_uses(node, own) for node in nodes):
            return False
        for node in nodes:
            if isinstance(node, ast.Call) and self_references.method_of_self(node) == "__init__":
                passed = (each.value for each in node.keywords if each.arg is None)
                if not all(is_name(value, own) for value in passed):
                    return False
    return True


def _harmless_uses(node: ast.AST, name: str) -> int:
    """How often a node directly uses a map without changing it or giving it another name."""
    match node:
        case (
            ast.keyword(arg=None, value=value)
            | ast.If(test=value)
            | ast.Call(func=ast.Attribute(value=value, attr="get" | "pop"))
            | ast.Subscript(value=value, ctx=ast.Load())
        ):
            return is_name(value, name)
        case ast.Compare():
            return sum(is_name(part, name) for part in (node.left, *node.comparators))
    return 0


def _calls(found: ast.ClassDef, names: SourceNames, *, lifecycle: bool) -> Iterator[_Call]:
    """Each call that may make topics."""
    methods = {part.name: part for part in found.body if isinstance(part, ast.FunctionDef)}
    first = ("__init__", "on_configure") if lifecycle else ("__init__",)
    waiting = [methods[name] for name in first if name in methods]
    once = {each.name for each in waiting}
    mentioned = literal_calls.attributes_of_self(found)
    while waiting:
        for call in _calls_in(waiting.pop(), names):
            called = methods.get(self_references.method_of_self(call.node))
            if called is not None and call.certain and mentioned[called.name] == 1:
                if called.name not in once:
                    waiting.append(called)
                once.add(called.name)
    for part in found.body:
        if isinstance(part, ast.FunctionDef) and methods[part.name] is part and part.name in once:
            yield from _calls_in(part, names)
        else:
            yield from _calls_below(part, part, names, certain=False)


def _calls_in(method: ast.FunctionDef, names: SourceNames) -> Iterator[_Call]:
    """The calls in a method that is executed once."""
    returned = bool(method.decorator_list)
    for statement in method.body:
        simple = isinstance(statement, (*_SIMPLE_STATEMENTS, ast.Return))
        yield from _calls_below(statement, method, names, certain=simple and not returned)
        returned = returned or any(isinstance(node, ast.Return) for node in own_nodes([statement]))


def _calls_below(
    top: ast.AST, method: ast.AST, names: SourceNames, *, certain: bool
) -> Iterator[_Call]:
    # Without recursion: each `elif` is one level deeper than the one before.
    waiting: list[tuple[ast.AST, bool]] = [(top, certain)]
    while waiting:
        node, certain = waiting.pop()
        certain = certain and not isinstance(node, _CONDITIONAL_NODES)
        if isinstance(node, ast.Call) and (
            self_references.method_of_self(node) or self_references.helper_of(node, names)
        ):
            yield _Call(node, method, certain)
        waiting.extend(reversed([(child, certain) for child in ast.iter_child_nodes(node)]))
