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
from pathlib import Path
from typing import Literal

from r2bspec.language.spec import QoS
from r2bspec.plan.wiring import literal_calls, python_files, self_references
from r2bspec.plan.wiring.literal_calls import TopicNames
from r2bspec.plan.wiring.node_interface import InterfaceEntry, ParameterInfo
from r2bspec.plan.wiring.program_nodes import class_of_program
from r2bspec.plan.wiring.python_source import SourceNames, nodes_below, own_nodes, program_class
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


@dataclass
class _PartialInterface:
    """The interface so far.

    Attributes:
        topics: the types of the known topics of each side; empty if unknown.
        more: why there may be more topics of a side; empty if there are none.
        parameters: None as soon as they are not all known.
        services: the types of services and actions by name; empty for one that it only calls.
        name: that its constructor gives it; empty if the text does not say it.
        timed: the topics that it publishes by a timer, with its period as text.
    """

    names: SourceNames
    topics: dict[_Side, dict[str, str]] = field(
        default_factory=lambda: {"publishes": {}, "subscribes": {}}
    )
    more: dict[_Side, str] = field(default_factory=lambda: {"publishes": "", "subscribes": ""})
    parameters: dict[str, ParameterInfo] | None = field(default_factory=dict)
    qos: dict[str, QoS] = field(default_factory=dict)
    services: dict[str, str] = field(default_factory=dict)
    name: str = ""
    timed: dict[str, str | None] = field(default_factory=dict)

    def forget(self, method: str, why: str) -> None:
        """Note that a method of `Node` may be called elsewhere."""
        if method in self_references.PARAMETER_METHODS:
            self.parameters = None
        else:
            self.add_doubt("subscribes" if method.endswith("_subscription") else "publishes", why)

    def forget_all(self, why: str) -> None:
        """Note that nothing is known to be complete."""
        self.add_doubt("publishes", why)
        self.add_doubt("subscribes", why)
        self.parameters = None

    def add_doubt(self, side: _Side, why: str) -> None:
        """Note why there may be more topics of a side."""
        self.more[side] = self.more[side] or why

    def add_topic(
        self, side: _Side, call: ast.Call, topic: str | None, kind: ast.expr | None, certain: bool
    ) -> None:
        """Take a publisher or a subscription into account."""
        what = "publisher" if side == "publishes" else "subscription"
        if topic is None:
            self.add_doubt(side, f"line {call.lineno} makes a {what} whose topic is no literal")
            return
        if not certain:
            self.add_doubt(
                side, f"whether line {call.lineno} makes a {what}, and how often, is not known"
            )
        written = literal_calls.interface_type(kind, self.names)
        if self.topics[side].setdefault(topic, written) != written:
            self.topics[side][topic] = ""

    def add_parameters(self, call: ast.Call, method: str, certain: bool) -> None:
        """Take the declaration of a parameter, or of several, into account."""
        declared = None
        if certain and method == "declare_parameter":
            found = literal_calls.declared_parameter(call)
            declared = None if found is None else [found]
        elif certain and method == "declare_parameters":
            declared = literal_calls.declared_parameters(call)
        if declared is None or self.parameters is None:
            self.parameters = None
        else:
            self.parameters.update(declared)

    def add_base_constructor(self, call: ast.Call) -> None:
        """Take the arguments of ``super().__init__`` into account.

        They name the node, and may declare every parameter that is set, and rename topics.
        """
        match literal_calls.argument(call, 0, "node_name"):
            case ast.Constant(value=str(name)):
                self.name = name
        for keyword in call.keywords:
            if keyword.arg == "cli_args":
                self.forget_all(f"line {call.lineno} sets cli_args, which may rename topics")
            if keyword.arg in _PARAMETER_OPTIONS and ast.unparse(keyword.value) != "False":
                self.parameters = None

    def settle_parameters_in_topics(self) -> None:
        """Leave out topics that are named by parameters whose default the text does not say."""
        for side, topics in self.topics.items():
            for topic in [
                planned_topic
                for planned_topic in topics
                if planned_topic.startswith("$(parameter ")
            ]:
                name = topic.removeprefix("$(parameter ").removesuffix(")")
                declared = (self.parameters or {}).get(name)
                if declared is None or not isinstance(declared.default, str):
                    del topics[topic]
                    self.add_doubt(side, f"the default of parameter {name!r} is no literal")

    def entry(self, *, lifecycle: bool) -> InterfaceEntry:
        """The interface."""
        self.settle_parameters_in_topics()
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
            is_lifecycle=lifecycle,
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
    found = python_files.find_definition(python_files.source_file(tree, path, read), name)
    more = ""
    if found is not None and isinstance(found.node, ast.FunctionDef):
        file, program = found.file, found.node
        made, more = program_class(
            program, file.names, lambda each: _class_named(file, each) is not None
        )
        if made:
            found = _class_named(file, made)
        else:
            as_class = class_of_program(program, file.names)
            found = None if as_class is None else python_files.Definition(file, as_class)
            more = more if found is None else ""
    if found is None or not isinstance(found.node, ast.ClassDef):
        return unknown_interface(more or f"{name} is not a class of its file")
    if self_references.replaces_methods(found.file.tree, found.node):
        return unknown_interface(f"{name} makes its topics by methods of its own")
    result = _PartialInterface(found.file.names)
    if more:
        result.forget_all(more)
    bases = list(_bases(found))
    lifecycle = any(_is_lifecycle(each) for each in (found, *bases))
    _add_class(result, found.file, found.node, lifecycle=lifecycle)
    for base in bases:
        _add_inherited(result, base, lifecycle=lifecycle)
    return result.entry(lifecycle=lifecycle)


def _class_named(file: python_files.SourceFile, name: str) -> python_files.Definition | None:
    found = python_files.find_definition(file, name)
    return found if found is not None and isinstance(found.node, ast.ClassDef) else None


def _bases(found: python_files.Definition) -> Iterator[python_files.Definition]:
    """The base classes that can be read, the nearest first."""
    for _ in range(MAX_BASE_CLASSES):
        bases = found.node.bases if isinstance(found.node, ast.ClassDef) else []
        above = (
            _class_named(found.file, bases[0].id)
            if len(bases) == 1 and isinstance(bases[0], ast.Name)
            else None
        )
        if above is None or above.node is found.node:
            return
        yield above
        found = above


def _is_lifecycle(found: python_files.Definition) -> bool:
    return (
        isinstance(found.node, ast.ClassDef)
        and _base_name(found.node, found.file.names) in _LIFECYCLE_NODES
    )


def _add_inherited(
    result: _PartialInterface, base: python_files.Definition, *, lifecycle: bool
) -> None:
    """The literal topics of a base class; that there may be others has been noted."""
    if not isinstance(base.node, ast.ClassDef) or self_references.replaces_methods(
        base.file.tree, base.node
    ):
        return
    inherited = _PartialInterface(base.file.names)
    _add_class(inherited, base.file, base.node, lifecycle=lifecycle)
    inherited.settle_parameters_in_topics()
    for side, topics in inherited.topics.items():
        for topic, kind in topics.items():
            if "$(" not in topic:
                result.topics[side].setdefault(topic, kind)


def _add_class(
    result: _PartialInterface,
    file: python_files.SourceFile,
    node_class: ast.ClassDef,
    *,
    lifecycle: bool,
) -> None:
    names = file.names
    if why := _unusual_base(node_class, names):
        result.forget_all(why)
    uses = self_references.SelfReferences(file.tree, node_class, names)
    if uses.escape:
        result.forget_all(uses.escape)
    for method, why in uses.escaped_methods.items():
        result.forget(method, why)
    topics = TopicNames(node_class, names)
    for call, inside, certain in _calls(node_class, names, lifecycle=lifecycle):
        _add_call(result, call, topics, inside, certain=certain)
    result.timed.update(literal_calls.timer_outputs(node_class, topics))
    if not _passes_keywords_unchanged(node_class):
        result.forget_all("its constructor changes the arguments that it passes to Node")


def _base_name(found: ast.ClassDef, names: SourceNames) -> str:
    return names.full_name(found.bases[0]) if len(found.bases) == 1 else ""


def _unusual_base(found: ast.ClassDef, names: SourceNames) -> str:
    """Why a class may have topics of others; empty if it is a plain class of a node."""
    if _base_name(found, names) not in {"rclpy.node.Node", *_LIFECYCLE_NODES}:
        bases = ", ".join(map(ast.unparse, found.bases)) or "nothing"
        return f"{found.name} inherits from {bases}, which may have others"
    if found.decorator_list or found.keywords:
        return f"{found.name} has a decorator or a metaclass"
    return ""


def _add_call(
    result: _PartialInterface, call: ast.Call, topics: TopicNames, inside: ast.AST, *, certain: bool
) -> None:
    """Take a call of a method of `self`, or of a helper, into account."""
    method = self_references.method_of_self(call)
    helper = self_references.helper_of(call, result.names)
    if helper is not None:
        _add_helper(result, call, helper, topics, inside, certain=certain)
    elif method in self_references.PUBLISHER_METHODS or method == "create_subscription":
        side: _Side = "subscribes" if method == "create_subscription" else "publishes"
        topic = topics.resolve(literal_calls.argument(call, 1, "topic"), inside)
        result.add_topic(side, call, topic, literal_calls.argument(call, 0, "msg_type"), certain)
        qos = literal_calls.qos_profile(call, 3 if side == "subscribes" else 2, result.names)
        if topic is not None and qos is not None:
            result.qos[topic] = qos
    elif method == "create_service":
        _add_service(result, call, topics, inside, "srv", first=0)
    elif method in {"declare_parameter", "declare_parameters"}:
        result.add_parameters(call, method, certain)
    elif method == "__init__":
        result.add_base_constructor(call)
    elif method in {"destroy_publisher", "destroy_subscription", "undeclare_parameter"} and (
        getattr(inside, "name", "") not in _CLEANING_METHODS
    ):
        result.forget(method, f"line {call.lineno} calls {method}")


def _add_helper(
    result: _PartialInterface,
    call: ast.Call,
    helper: self_references.NodeHelper,
    topics: TopicNames,
    inside: ast.AST,
    *,
    certain: bool,
) -> None:
    """Take the topics into account that a class of another package makes for the node."""
    sides: tuple[tuple[_Side, dict[str, str]], ...] = (
        ("publishes", dict(helper.publishes)),
        ("subscribes", dict(helper.subscribes)),
    )
    for side, made in sides:
        result.topics[side].update(made)
    if helper.makes_subscription:
        topic = topics.resolve(literal_calls.argument(call, 2, "topic"), inside)
        result.add_topic(
            "subscribes", call, topic, literal_calls.argument(call, 1, "msg_type"), certain
        )
    if helper.names_action:
        _add_service(result, call, topics, inside, "action", first=1, answers=helper.answers)


def _add_service(
    result: _PartialInterface,
    call: ast.Call,
    topics: TopicNames,
    inside: ast.AST,
    kind: Literal["srv", "action"],
    *,
    first: int,
    answers: bool = True,
) -> None:
    """Take a service or an action into account: its type is this argument, its name the next."""
    name = topics.resolve(literal_calls.argument(call, first + 1, f"{kind}_name"), inside)
    if name is not None:
        given = literal_calls.argument(call, first, f"{kind}_type")
        written = literal_calls.interface_type(given, result.names, kind)
        result.services[name] = written if answers else ""


def _passes_keywords_unchanged(found: ast.ClassDef) -> bool:
    """Whether arguments with ``**`` are only those of the caller, and are not changed.

    Others may have any option of `Node`.
    """
    for method in found.body:
        if not isinstance(method, ast.FunctionDef) or method.name != "__init__":
            continue
        own = method.args.kwarg.arg if method.args.kwarg else ""
        nodes = nodes_below(method)
        if sum(self_references.is_name(node, own) for node in nodes) != sum(
            _harmless_uses(node, own) for node in nodes
        ):
            return False
        base_calls = (
            node
            for node in nodes
            if isinstance(node, ast.Call) and self_references.method_of_self(node) == "__init__"
        )
        keywords = (keyword for call in base_calls for keyword in call.keywords)
        if any(
            keyword.arg is None and not self_references.is_name(keyword.value, own)
            for keyword in keywords
        ):
            return False
    return True


def _harmless_uses(node: ast.AST, name: str) -> int:
    """How often a node directly uses a map without changing it or giving it another name."""
    match node:
        case ast.keyword(arg=None, value=value) | ast.If(test=value):
            return self_references.is_name(value, name)
        case (
            ast.Call(func=ast.Attribute(value=value, attr="get" | "pop"))
            | ast.Subscript(value=value, ctx=ast.Load())
        ):
            return self_references.is_name(value, name)
        case ast.Compare():
            return sum(
                self_references.is_name(part, name) for part in (node.left, *node.comparators)
            )
    return 0


def _calls(
    found: ast.ClassDef, names: SourceNames, *, lifecycle: bool
) -> Iterator[tuple[ast.Call, ast.AST, bool]]:
    """Each call that may make topics, its method, and whether it is certainly made exactly once."""
    methods = {part.name: part for part in found.body if isinstance(part, ast.FunctionDef)}
    first = [methods[name] for name in _first_methods(lifecycle=lifecycle) if name in methods]
    waiting, once = list(first), {each.name for each in first}
    mentioned = literal_calls.attributes_of_self(found)
    while waiting:
        for call, certain in _calls_in(waiting.pop(), names):
            called = methods.get(self_references.method_of_self(call)) if certain else None
            if called is not None and called.name not in once and mentioned[called.name] == 1:
                once.add(called.name)
                waiting.append(called)
    for part in found.body:
        if isinstance(part, ast.FunctionDef) and methods[part.name] is part and part.name in once:
            yield from ((call, part, certain) for call, certain in _calls_in(part, names))
        else:
            yield from ((call, part, False) for call, _ in _calls_below(part, names, certain=False))


def _first_methods(*, lifecycle: bool) -> tuple[str, ...]:
    return ("__init__", "on_configure") if lifecycle else ("__init__",)


def _calls_in(method: ast.FunctionDef, names: SourceNames) -> Iterator[tuple[ast.Call, bool]]:
    """The calls in a method that is executed once."""
    returned = bool(method.decorator_list)
    for statement in method.body:
        simple = isinstance(statement, (*_SIMPLE_STATEMENTS, ast.Return))
        yield from _calls_below(statement, names, certain=simple and not returned)
        returned = returned or any(isinstance(node, ast.Return) for node in own_nodes([statement]))


def _calls_below(
    top: ast.AST, names: SourceNames, *, certain: bool
) -> Iterator[tuple[ast.Call, bool]]:
    # Without recursion: each `elif` is one level deeper than the one before.
    waiting: list[tuple[ast.AST, bool]] = [(top, certain)]
    while waiting:
        node, certain = waiting.pop()
        certain = certain and not isinstance(node, _CONDITIONAL_NODES)
        if isinstance(node, ast.Call) and (
            self_references.method_of_self(node) or self_references.helper_of(node, names)
        ):
            yield node, certain
        waiting.extend(reversed([(child, certain) for child in ast.iter_child_nodes(node)]))
