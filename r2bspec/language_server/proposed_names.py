"""Names of a spec, of its bag and of its nodes as proposals, and which value takes which names.

Each source is a function of the analysis and the path; a table names the paths that it serves.
Message types are those of the topic first, then all known types.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, Final

from lsprotocol import types

from r2bspec.bags.message_types import common_types
from r2bspec.check.check_context import Context
from r2bspec.diagnostics import Path
from r2bspec.diagnostics.diagnostic import format_path
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.declaration import ValueRule, rule_at
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, TreeNode, lookup
from r2bspec.language.names import MESSAGE_TYPE
from r2bspec.language.variables import parse_path
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.positions import CompletionProposal, CursorContext
from r2bspec.language_server.proposed_values import (
    executables,
    launch_files,
    metrics,
    packages,
    plugins,
    python_classes,
    quantities,
    recordings,
    requirements,
)
from r2bspec.language_server.symbols import names_of
from r2bspec.plan.installed_packages import installed_message_types
from r2bspec.plan.wiring.name_resolution import expand
from r2bspec.plan.wiring.wiring import NodeWiring

ProposalSource = Callable[[Analysis, CursorContext], Iterator[CompletionProposal]]
"""What can be written at the path of a context."""


def message_types(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield message types: of the topic in the same map, of the spec, of this machine."""
    known = analysis.known
    if known is not None:
        owner = context.path[:-1]
        for used in dict.fromkeys(_of_topics(known, owner, _topics_beside(analysis, owner))):
            yield _proposal(used, "of this topic", 1)
        ends = [endpoint for phase in known.wiring.phases for endpoint in phase.endpoints]
        for used in dict.fromkeys(end.type for end in ends if end.type):
            yield _proposal(used, "used in this spec", 5)
    for name in sorted(installed_message_types()):
        yield _proposal(name, "installed", 600)
    for name in _common_types():
        yield _proposal(name, "", 610)


def _proposal(name: str, detail: str, order: int) -> CompletionProposal:
    return CompletionProposal(name, detail, kind=types.CompletionItemKind.Struct, order=order)


def _topic(
    name: str, detail: str, *, documentation: str = "", order: int = 5
) -> CompletionProposal:
    field = types.CompletionItemKind.Field
    return CompletionProposal(name, detail, documentation, kind=field, order=order)


def _topics_beside(analysis: Analysis, owner: Path) -> Iterator[str]:
    """Yield the topics of the input or the monitor whose type is written."""
    if owner[:2] == ("playback", "inputs"):
        yield str(owner[-1])
    for key in ("from", "topic"):
        node = lookup(analysis.loaded.tree, (*owner, key))
        if isinstance(node, ScalarNode):
            yield node.text


def _of_topics(known: Context, owner: Path, topics: Iterator[str]) -> Iterator[str]:
    """Yield the types of topics, without what the entry that is written says itself."""
    names = {expand(topic, "", known.wiring.namespace) for topic in topics if topic}
    for phase in known.wiring.phases:
        for end in phase.endpoints:
            if end.topic in names and end.type and owner not in {end.path, end.path[: len(owner)]}:
                yield end.type


@cache
def _common_types() -> tuple[str, ...]:
    return tuple(sorted(common_types()))


def variable_value(analysis: Analysis, name: str) -> str:
    """Return the value of a variable as it is written; empty if it is unknown."""
    node = lookup(analysis.loaded.tree, ("variables", name))
    return node.text if isinstance(node, ScalarNode) else ""


def environment_names(analysis: Analysis) -> list[str]:
    """Return the names of the environment that the spec may use."""
    listed = (lookup(tree, ("environment",)) for tree in analysis.written.values())
    return list(dict.fromkeys(name for value in listed for name in _texts(value)))


def bag_topics(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the topics of the recordings, with their types."""
    bag = analysis.known.bag if analysis.known is not None else None
    for name, info in (bag.topics if bag is not None else {}).items():
        yield _topic(name, info.type)


def graph_topics(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the topics of the spec, relative to its namespace, with their types."""
    spec_context = analysis.known
    if spec_context is None:
        return
    for phase in reversed(spec_context.wiring.phases):
        for topic in phase.topics:
            ends = (*phase.publishers(topic), *phase.subscriptions(topic))
            known = next((end.type for end in ends if end.type), "")
            lines = "\n".join(_owners(topic, ends))
            yield _topic(spec_context.relative_name(topic), known, documentation=lines)


def _owners(topic: str, ends: Iterable[Any]) -> Iterator[str]:
    yield f"`{topic}`"
    for end in ends:
        yield f"- {'published' if end.is_publisher else 'subscribed to'} by {end.owner}"


def input_topics(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the topics that the graph needs and does not publish, then the loaded topics."""
    spec_context = analysis.known
    if spec_context is None:
        return
    phase = spec_context.wiring.measure
    for topic in phase.topics:
        readers = [
            subscription for subscription in phase.subscriptions(topic) if subscription.is_node
        ]
        publishers = [publisher for publisher in phase.publishers(topic) if publisher.is_node]
        if readers and not publishers:
            known = next((reader.type for reader in readers if reader.type), "")
            yield _topic(spec_context.relative_name(topic), known, order=1)
    # Before the graph is written, the recorded names are the best that is known.
    for name, info in (spec_context.bag.topics if spec_context.bag is not None else {}).items():
        if name in spec_context.spec.data_loader.topics:
            recorded = "The name in the recording."
            yield _topic(name.removeprefix("/"), info.type, order=2, documentation=recorded)


def _node_at(analysis: Analysis, path: Path) -> NodeWiring | None:
    spec_context = analysis.known
    if spec_context is None:
        return None
    return next(
        (node for _, node in spec_context.nodes if path[: len(node.path)] == node.path), None
    )


def own_topics(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the topics of a node by their names in its code."""
    node = _node_at(analysis, context.path)
    if node is None:
        return
    endpoints = {**(node.interface.publishes or {}), **(node.interface.subscribes or {})}
    for name, type_name in endpoints.items():
        yield _topic(name, type_name)


def parameters(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the declared parameters of a node, with their types and defaults."""
    node = _node_at(analysis, context.path)
    for name, info in ((node.interface.parameters or {}) if node is not None else {}).items():
        default = "" if info.default is None else f", default {info.default}"
        yield CompletionProposal(
            name,
            f"{info.type or 'parameter'}{default}",
            kind=types.CompletionItemKind.Property,
            order=5,
        )


def containers(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the containers of the spec."""
    for name in names_of(analysis, "container"):
        yield CompletionProposal(name, "container", kind=types.CompletionItemKind.Module, order=5)


def lever_paths(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the paths that a search can vary: parameters of nodes, and threads of processes."""
    known = analysis.known
    for node in known.wiring.measure.nodes if known is not None else ():
        names = [f"parameters.{name}" for name in node.interface.parameters or {}]
        for name in (*names, "threads"):
            path = f"{format_path(node.path)}.{name}"
            yield CompletionProposal(path, kind=types.CompletionItemKind.Property, order=5)


def variables(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the variables of the spec, with their values."""
    for name in names_of(analysis, "variable"):
        value = variable_value(analysis, name)
        yield CompletionProposal(name, value, kind=types.CompletionItemKind.Variable, order=5)


def inputs(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the inputs of the player; for a live graph, the topics of monitors."""
    spec = analysis.known.spec if analysis.known is not None else None
    for name in spec.playback.inputs if spec is not None else ():
        yield _topic(name, "input")
    for monitor in spec.monitors.values() if spec is not None and spec.live else ():
        yield _topic(monitor.topic, "monitored topic")


def rates(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the rates of the benchmark."""
    known = analysis.known
    for rate in known.spec.benchmark.rates if known is not None else ():
        yield CompletionProposal(str(rate), "a rate of the benchmark", order=5)


def parameter_values(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the default of the parameter at the cursor."""
    node = _node_at(analysis, context.path)
    known = (node.interface.parameters or {}) if node is not None else {}
    info = known.get(str(context.path[-1]))
    if info is not None and info.default is not None and not isinstance(info.default, list):
        default = info.default
        text = str(default).lower() if isinstance(default, bool) else str(default)
        yield CompletionProposal(text, f"default, {info.type or 'parameter'}", order=1)


def axes(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the variables of the matrix, in which cases differ."""
    for name in _axes(analysis):
        detail = ", ".join(_texts(_axes(analysis)[name]))
        yield CompletionProposal(name, detail, kind=types.CompletionItemKind.Variable, order=3)


def axis_values(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the values of the variable at the cursor in the cases of the matrix."""
    for text in _texts(_axes(analysis).get(str(context.path[-1]))):
        yield CompletionProposal(
            text, "of a case", kind=types.CompletionItemKind.EnumMember, order=3
        )


def case_variables(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the variables in which a case can differ: those of the matrix, then all others."""
    yield from axes(analysis, context)
    yield from variables(analysis, context)


def _axes(analysis: Analysis) -> dict[str, TreeNode]:
    """Return the axes of the matrix as they are written, in this file or one that it extends."""
    found: dict[str, TreeNode] = {}
    for tree in analysis.written.values():
        node = lookup(tree, ("matrix", "axes"))
        if isinstance(node, MapNode):
            found.update((name, entry.value) for name, entry in node.entries.items())
    return found


def _texts(axis: TreeNode | None) -> list[str]:
    items = axis.items if isinstance(axis, ListNode) else ()
    return [item.text for item in items if isinstance(item, ScalarNode)]


def proposed_values(
    analysis: Analysis | None, context: CursorContext
) -> Iterator[CompletionProposal]:
    """Yield the values that can be written at the path of a context."""
    if context.path[:2] == ("tune", "values") and len(context.path) > len(("tune", "values")):
        # A value of a lever is one of the key that the lever names.
        context = replace(context, path=parse_path(str(context.path[2])))
    known = list(_from_sources(_VALUES, analysis, context))
    rule = rule_at(context.path)
    if rule is not None:
        if analysis is not None:
            if rule.pattern is MESSAGE_TYPE:
                known += message_types(analysis, context)
            items = rule.items.quantity if rule.items is not None else None
            if Requirement in (rule.quantity, items):
                known += requirements(analysis, context)
        known += _declared_values(rule, context)
    # An example says what a value looks like, where nothing says what it can be.
    yield from known or (_examples(rule) if rule is not None else ())


def names_as_keys(
    analysis: Analysis | None, context: CursorContext
) -> Iterator[CompletionProposal]:
    """Yield the names that can be the keys of the map at the path of a context."""
    for proposal in _from_sources(_KEYS, analysis, context):
        key = f"{proposal.insert or proposal.label}: "
        yield proposal if context.has_colon else replace(proposal, insert=key)


def _from_sources(
    table: Mapping[ProposalSource, tuple[str, ...]],
    analysis: Analysis | None,
    context: CursorContext,
) -> Iterator[CompletionProposal]:
    if analysis is None:
        return
    for source, patterns in table.items():
        if any(_matches(context.path, pattern.split(".")) for pattern in patterns):
            yield from source(analysis, context)


def _matches(path: Path, pattern: Sequence[str]) -> bool:
    """Return whether a path fits a pattern: ``*`` is any part, ``**`` at first any beginning."""
    if pattern[0] == "**":
        pattern = pattern[1:]
        path = path[-len(pattern) :]
    return len(path) == len(pattern) and all(
        expected in {"*", part} for part, expected in zip(path, pattern, strict=True)
    )


def _declared_values(rule: ValueRule, context: CursorContext) -> Iterator[CompletionProposal]:
    yield from quantities(rule, context.before)
    if rule.kinds == ("boolean",):
        yield from (CompletionProposal(text, order=10) for text in ("true", "false"))
    default = rule.shown_default
    if rule.const is not None:
        yield CompletionProposal(str(rule.const), order=10)
    for word in rule.words:
        yield CompletionProposal(
            str(word),
            detail="default" if word == default else "",
            kind=types.CompletionItemKind.EnumMember,
            order=10,
        )
    if isinstance(default, str | int | float) and default != "" and not rule.is_choice:
        yield CompletionProposal(
            str(default).lower() if isinstance(default, bool) else str(default), "default", order=20
        )


def _examples(rule: ValueRule) -> Iterator[CompletionProposal]:
    for example in rule.about.examples:
        if isinstance(example, str) and rule.quantity is not Requirement:
            yield CompletionProposal(example, "example", order=800)


_VALUES: Final[Mapping[ProposalSource, tuple[str, ...]]] = {
    rates: ("slos.*.at",),
    axis_values: ("slos.*.when.*", "matrix.exclude.*.*"),
    recordings: ("data_loader.bag", "data_loader.bag.dataset", "data_loader.bag.path"),
    graph_topics: (
        *("data_loader.topics.*", "playback.inputs.*.from", "playback.calls.*.from"),
        *("monitors.*.topic", "**.remappings.*"),
    ),
    inputs: ("monitors.*.answers.*",),
    containers: ("**.container",),
    metrics: ("tune.minimize",),
    python_classes: ("**.python",),
    packages: ("**.package",),
    executables: ("**.executable",),
    plugins: ("**.plugin",),
    launch_files: ("**.launch.file",),
    parameter_values: ("**.parameters.*", "**.parameters.*.*"),
}
"""What can be written as the value at a path, besides what its declaration says."""

_KEYS: Final[Mapping[ProposalSource, tuple[str, ...]]] = {
    bag_topics: ("data_loader.topics",),
    input_topics: ("playback.inputs",),
    own_topics: ("**.remappings",),
    parameters: (
        *("graph.nodes.*.parameters", "graph.nodes.*.parameters.*"),
        *("preprocessors.*.parameters", "preprocessors.*.parameters.*"),
    ),
    case_variables: ("slos.*.when", "matrix.cases.*"),
    axes: ("matrix.exclude.*",),
    variables: ("matrix.axes",),
    lever_paths: ("tune.values",),
}
"""What can be a key of the map at a path, besides what its declaration says."""
