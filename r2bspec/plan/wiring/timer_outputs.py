"""The topics that a class publishes by a timer alone, at most once each time: at a pace of its own.

It stores the publisher and calls its ``publish`` in one place, in a method that nothing but one
timer calls, and in no loop there.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator

from r2bspec.plan.wiring import self_references
from r2bspec.plan.wiring.literal_calls import argument
from r2bspec.plan.wiring.python_source import nodes_below
from r2bspec.plan.wiring.topic_names import TopicNames

_REPEATED = (
    *(ast.For, ast.AsyncFor, ast.While, ast.ListComp, ast.SetComp, ast.DictComp),
    *(ast.GeneratorExp, ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda),
)
"""What may evaluate the expressions in it several times, or later."""


def timer_outputs(found: ast.ClassDef, topics: TopicNames) -> Iterator[tuple[str, str | None]]:
    """Each such topic of a class, and the period of its timer as `TopicNames.number` has it."""
    mentioned = attributes_of_self(found)
    methods = {part.name: part for part in found.body if isinstance(part, ast.FunctionDef)}
    for method in methods.values():
        for call in nodes_below(method):
            if not isinstance(call, ast.Call) or (
                self_references.method_of_self(call) != "create_timer"
            ):
                continue
            callback = _attribute(argument(call, 1, "callback"))
            if callback not in methods or mentioned[callback] != 1:
                continue
            period_s = topics.number(argument(call, 0, "timer_period_sec"), method)
            for publisher in _published_once(methods[callback]):
                # Where it is stored, and here.
                made = topics.stored(publisher) if mentioned[publisher] == 2 else None
                if isinstance(made, ast.Call) and (
                    self_references.method_of_self(made) in self_references.PUBLISHER_METHODS
                ):
                    topic = topics.resolve(argument(made, 1, "topic"), method)
                    if topic is not None:
                        yield topic, period_s


def attributes_of_self(found: ast.ClassDef) -> Counter[str]:
    """How often a class mentions each attribute of its node."""
    return Counter(name for node in nodes_below(found) if (name := _attribute(node)))


def _attribute(node: ast.AST | None) -> str:
    is_own = isinstance(node, ast.Attribute) and self_references.is_self(node.value)
    return node.attr if is_own and isinstance(node, ast.Attribute) else ""


def _published_once(method: ast.FunctionDef) -> Iterator[str]:
    """The attributes of `self` on which a method calls ``publish`` at most once."""
    waiting: list[ast.AST] = [*method.body]
    while waiting:
        node = waiting.pop()
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Attribute() as target, attr="publish")):
                if name := _attribute(target):
                    yield name
        if not isinstance(node, _REPEATED):
            waiting.extend(ast.iter_child_nodes(node))
