"""What can be written at a place of a spec: names of the spec, of its bag and of what is installed.

Each source is a function of the analysis and the context of the cursor; a table names the paths
that it serves. Message types are those of the topic first, then all known types.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

from lsprotocol import types

from r2bspec.bags.message_types import common_types
from r2bspec.bags.recording import DataError
from r2bspec.check.check_context import Context
from r2bspec.datasets.catalogue import known_datasets
from r2bspec.diagnostics import Path
from r2bspec.judge.measure.metric import Scope
from r2bspec.judge.measure.metric_catalogue import NO_SUBJECTS, MetricError, find_metric, names
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.declaration import ValueRule, rule_at
from r2bspec.language.located_tree import ListNode, ScalarNode, TreeNode, lookup
from r2bspec.language.names import MESSAGE_TYPE
from r2bspec.language.quantities import Quantity
from r2bspec.language.variables import parse_path
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.positions import CursorContext
from r2bspec.language_server.symbols import names_of
from r2bspec.plan import installed_packages
from r2bspec.plan.wiring.name_resolution import expand
from r2bspec.plan.wiring.node_interface import (
    catalogue_nodes,
    catalogue_packages,
    reference_node_interfaces,
)
from r2bspec.plan.wiring.wiring import NodeWiring

_Kind = types.CompletionItemKind


@dataclass(frozen=True, slots=True)
class CompletionProposal:
    """A text that can be inserted.

    Attributes:
        label: what is shown, and inserted if `insert` is empty.
        insert: what is inserted instead of the label; the lines after the first one are relative
            to the indentation of the first.
        is_snippet: whether `insert` has placeholders.
        order: proposals with lower numbers are shown first.
    """

    label: str
    detail: str = ""
    documentation: str = ""
    insert: str = ""
    kind: types.CompletionItemKind = _Kind.Value
    is_snippet: bool = False
    order: int = 500


ProposalSource = Callable[[Analysis, CursorContext], Iterator[CompletionProposal]]
"""What can be written at the path of a context."""


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
                known += _message_types(analysis, context)
            items = rule.items.quantity if rule.items is not None else None
            if Requirement in (rule.quantity, items):
                known += _requirements(analysis, context)
        known += _declared_values(rule, context)
    # An example says what a value looks like, where nothing says what it can be.
    yield from known or (_examples(rule) if rule is not None else ())


def proposed_keys(
    analysis: Analysis | None, context: CursorContext
) -> Iterator[CompletionProposal]:
    """Yield the names that can be the keys of the map at the path of a context."""
    for proposal in _from_sources(_KEYS, analysis, context):
        key = f"{proposal.insert or proposal.label}: "
        yield proposal if context.has_colon else replace(proposal, insert=key)


def references(analysis: Analysis | None, kind: str) -> Iterator[CompletionProposal]:
    """Yield the variables, and the names of the environment that the spec lists.

    Args:
        analysis: the analysis of the spec.
        kind: ``var`` or ``env``, where that is written already; empty for both.
    """
    if analysis is None:
        return
    if kind != "env":
        for name in names_of(analysis, "variable"):
            node = lookup(analysis.loaded.tree, ("variables", name))
            value = node.text if isinstance(node, ScalarNode) else ""
            label = name if kind else f"$(var {name})"
            yield CompletionProposal(label, value, kind=_Kind.Variable)
    if kind != "var":
        listed = (lookup(tree, ("environment",)) for tree in analysis.written.values())
        for name in dict.fromkeys(name for value in listed for name in _texts(value)):
            label = name if kind else f"$(env {name})"
            yield CompletionProposal(label, "of the environment", kind=_Kind.Constant)


def _texts(value: TreeNode | None) -> list[str]:
    items = value.items if isinstance(value, ListNode) else ()
    return [item.text for item in items if isinstance(item, ScalarNode)]


def _message_types(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield message types: of the topic in the same map, of the spec, of this machine."""
    known = analysis.known
    if known is not None:
        owner = context.path[:-1]
        for used in dict.fromkeys(_of_topics(known, owner, _topics_beside(context, owner))):
            yield _type(used, "of this topic", 1)
        ends = [endpoint for phase in known.wiring.phases for endpoint in phase.endpoints]
        for used in dict.fromkeys(end.type for end in ends if end.type):
            yield _type(used, "used in this spec", 5)
    for name in sorted(installed_packages.installed_message_types()):
        yield _type(name, "installed", 600)
    for name in _common_types():
        yield _type(name, "", 610)


@cache
def _common_types() -> tuple[str, ...]:
    return tuple(sorted(common_types()))


def _type(name: str, detail: str, order: int) -> CompletionProposal:
    return CompletionProposal(name, detail, kind=_Kind.Struct, order=order)


def _topics_beside(context: CursorContext, owner: Path) -> Iterator[str]:
    """Yield the topics of the input or the monitor whose type is written."""
    if owner[:2] == ("playback", "inputs"):
        yield str(owner[-1])
    for key in ("from", "topic"):
        yield _text_at(context, (*owner, key))


def _text_at(context: CursorContext, path: Path) -> str:
    node = lookup(context.tree, path)
    return node.text if isinstance(node, ScalarNode) else ""


def _of_topics(known: Context, owner: Path, topics: Iterator[str]) -> Iterator[str]:
    """Yield the types of topics, without what the entry that is written says itself."""
    full = {expand(topic, "", known.wiring.namespace) for topic in topics if topic}
    for phase in known.wiring.phases:
        for end in phase.endpoints:
            if end.topic in full and end.type and owner not in {end.path, end.path[: len(owner)]}:
                yield end.type


def _topic(name: str, detail: str, order: int = 5) -> CompletionProposal:
    return CompletionProposal(name, detail, kind=_Kind.Field, order=order)


def _bag_topics(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    bag = analysis.known.bag if analysis.known is not None else None
    for name, info in (bag.topics if bag is not None else {}).items():
        yield _topic(name, info.type)


def _graph_topics(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the topics of the spec, relative to its namespace, with their types."""
    known = analysis.known
    for phase in reversed(known.wiring.phases) if known is not None else ():
        for topic in phase.topics:
            ends = (*phase.publishers(topic), *phase.subscriptions(topic))
            kind = next((end.type for end in ends if end.type), "")
            if known is not None:
                yield _topic(known.relative_name(topic), kind)


def _input_topics(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the topics that the graph needs and does not publish, then the loaded topics."""
    known = analysis.known
    if known is None:
        return
    phase = known.wiring.measure
    for topic in phase.topics:
        readers = [reader for reader in phase.subscriptions(topic) if reader.is_node]
        if readers and not any(end.is_node for end in phase.publishers(topic)):
            kind = next((reader.type for reader in readers if reader.type), "")
            yield _topic(known.relative_name(topic), kind, order=1)
    # Before the graph is written, the recorded names are the best that is known.
    for name, info in (known.bag.topics if known.bag is not None else {}).items():
        if name in known.spec.data_loader.topics:
            yield _topic(name.removeprefix("/"), info.type, order=2)


def _node_at(analysis: Analysis, path: Path) -> NodeWiring | None:
    nodes = analysis.known.nodes if analysis.known is not None else ()
    return next((node for _, node in nodes if path[: len(node.path)] == node.path), None)


def _own_topics(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the topics of a node by their names in its code."""
    node = _node_at(analysis, context.path)
    if node is not None:
        endpoints = {**(node.interface.publishes or {}), **(node.interface.subscribes or {})}
        yield from (_topic(name, kind) for name, kind in endpoints.items())


def _parameters(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the declared parameters of a node, with their types and defaults."""
    node = _node_at(analysis, context.path)
    for name, info in ((node.interface.parameters or {}) if node is not None else {}).items():
        default = "" if info.default is None else f", default {info.default}"
        detail = f"{info.type or 'parameter'}{default}"
        yield CompletionProposal(name, detail, kind=_Kind.Property, order=5)


def _containers(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    for name in names_of(analysis, "container"):
        yield CompletionProposal(name, "container", kind=_Kind.Module, order=5)


def _variables(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    for proposal in references(analysis, "var"):
        yield replace(proposal, order=5)


def _inputs(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the inputs of the player; for a live graph, the topics of monitors."""
    spec = analysis.known.spec if analysis.known is not None else None
    if spec is not None:
        yield from (_topic(name, "input") for name in spec.playback.inputs)
        monitors = spec.monitors.values() if spec.live else ()
        yield from (_topic(monitor.topic, "monitored topic") for monitor in monitors)


def _rates(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    known = analysis.known
    for rate in known.spec.benchmark.rates if known is not None else ():
        yield CompletionProposal(str(rate), "a rate of the benchmark", order=5)


def _datasets(_analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    try:
        datasets = known_datasets()
    except DataError:
        return
    for name in datasets:
        yield CompletionProposal(name, "dataset", kind=_Kind.Module, order=5)


def _reference_nodes(_analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    for name in reference_node_interfaces():
        yield CompletionProposal(name, "reference node", kind=_Kind.Class, order=5)


def _packages(_analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    return _installed_first(
        installed_packages.ament_packages(), catalogue_packages(), types.CompletionItemKind.Module
    )


def _plugins(_: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the composable nodes of the package that the node names."""
    package = _text_at(context, (*context.path[:-1], "package"))
    installed = installed_packages.package_plugins(package)
    return _installed_first(installed, catalogue_nodes(package), types.CompletionItemKind.Class)


def _executables(_: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the executables of the package that the node names."""
    package = _text_at(context, (*context.path[:-1], "package"))
    installed = installed_packages.package_executables(package)
    known = [node.executable for node in catalogue_nodes(package).values()]
    return _installed_first(installed, known, types.CompletionItemKind.File)


def _installed_first(
    installed: Collection[str], known: Iterable[str], kind: types.CompletionItemKind
) -> Iterator[CompletionProposal]:
    for name in sorted({*known, *installed} - {""}):
        is_installed = name in installed
        detail = "installed" if is_installed else "known"
        yield CompletionProposal(name, detail, kind=kind, order=5 if is_installed else 20)


_OPERATORS: Final = ("<", "<=", ">", ">=", "==", "!=")
_NUMBER: Final = re.compile(r"\d+(?:\.\d*)?\Z")
_BOUNDS: Final = {
    "time": ("50 ms", "100 us", "1 s", "105 % of baseline"),
    "rate": ("30 Hz", "95 % of offered", "95 % of baseline"),
    "share": ("1 %", "5 %"),
    "size": ("100 MiB", "1 GiB"),
    "power": ("15 W",),
    "energy": ("500 mJ",),
    "count": ("0", "1"),
}


def _requirements(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield metrics; after a metric, operators; after an operator, bounds of its dimension."""
    words = context.before.split()
    written = len(words) - (not context.before.endswith(" ")) if words else 0
    if written == 0:
        yield from _metrics(analysis, context)
        yield CompletionProposal("sustained", "the rate is sustained", kind=_Kind.Function)
    elif written == 1:
        for index, operator in enumerate(_OPERATORS):
            yield CompletionProposal(operator, kind=_Kind.Operator, order=index)
    elif written == len(words) == 2:
        dimension = _dimension(words[0])
        for text in _BOUNDS.get(dimension, ()):
            yield CompletionProposal(text, dimension, order=5)


def _metrics(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the metrics that this spec has."""
    subjects = analysis.known.subjects if analysis.known is not None else NO_SUBJECTS
    monitors = names_of(analysis, "monitor")
    for order, name in enumerate(names(subjects), 100):
        info = find_metric(name)
        about = f"{info.description}\n\nFor example: `{info.example}`"
        proposal = CompletionProposal(name, info.dimension, about, kind=_Kind.Function, order=order)
        yield proposal
        for monitor in monitors if info.scope is Scope.MONITOR and len(monitors) > 1 else ():
            yield replace(proposal, label=f"{monitor}.{name}", order=order + 200)


def _dimension(metric: str) -> str:
    for name in (metric, metric.partition(".")[2]):
        try:
            return find_metric(name).dimension
        except MetricError:
            continue
    return ""


def _declared_values(rule: ValueRule, context: CursorContext) -> Iterator[CompletionProposal]:
    quantity = rule.quantity
    if rule.is_parsed and quantity is not None and issubclass(quantity, Quantity):
        yield from _units(quantity, context.before)
    if rule.kinds == ("boolean",):
        yield from (CompletionProposal(text, order=10) for text in ("true", "false"))
    default = rule.shown_default
    if rule.const is not None:
        yield CompletionProposal(str(rule.const), order=10)
    for word in rule.words:
        detail = "default" if word == default else ""
        yield CompletionProposal(str(word), detail, kind=_Kind.EnumMember, order=10)
    if isinstance(default, str | int | float) and default != "" and not rule.is_choice:
        text = str(default).lower() if isinstance(default, bool) else str(default)
        yield CompletionProposal(text, "default", order=20)


def _units(kind: type[Quantity], before: str) -> Iterator[CompletionProposal]:
    """Yield the units after a number."""
    number = before.rstrip(" ")
    if not _NUMBER.match(number):
        return
    # With a space after it, the number is a word of its own, which a proposal does not replace.
    shown = "" if before.endswith(" ") else f"{number} "
    for order, unit in enumerate(kind.units, 1):
        yield CompletionProposal(f"{shown}{unit}", kind.kind, kind=_Kind.Unit, order=order)


def _examples(rule: ValueRule) -> Iterator[CompletionProposal]:
    for example in rule.about.examples:
        if isinstance(example, str) and rule.quantity is not Requirement:
            yield CompletionProposal(example, "example", order=800)


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


_VALUES: Final[Mapping[ProposalSource, tuple[str, ...]]] = {
    _rates: ("slos.*.at",),
    _datasets: ("data_loader.bag", "data_loader.bag.dataset"),
    _graph_topics: (
        *("data_loader.topics.*", "playback.inputs.*.from", "playback.calls.*.from"),
        *("monitors.*.topic", "**.remappings.*"),
    ),
    _inputs: ("monitors.*.answers.*",),
    _containers: ("**.container",),
    _metrics: ("tune.minimize",),
    _reference_nodes: ("**.python",),
    _packages: ("**.package",),
    _executables: ("**.executable",),
    _plugins: ("**.plugin",),
}
"""What can be written as the value at a path, besides what its declaration says."""

_KEYS: Final[Mapping[ProposalSource, tuple[str, ...]]] = {
    _bag_topics: ("data_loader.topics",),
    _input_topics: ("playback.inputs",),
    _own_topics: ("**.remappings",),
    _parameters: (
        *("graph.nodes.*.parameters", "graph.nodes.*.parameters.*"),
        *("preprocessors.*.parameters", "preprocessors.*.parameters.*"),
    ),
    _variables: ("slos.*.when", "matrix.cases.*", "matrix.axes", "matrix.exclude.*"),
}
"""What can be a key of the map at a path, besides what its declaration says."""
