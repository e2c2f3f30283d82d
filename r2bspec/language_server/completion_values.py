"""What can be written as a value, or as a key that is a name: from the spec, its bag, this machine.

Each source is a function of the analysis and the path; a table names the paths that it serves.
What is expensive, such as the message types, is looked up once.
"""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path as FilePath
from typing import Any, Final

from lsprotocol import types

from r2bspec.diagnostics import Path
from r2bspec.language.bag_formats import BAG_FORMATS
from r2bspec.language.located_tree import ScalarNode, lookup
from r2bspec.language.schema_validator import schema_at
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.cursor_context import CursorContext
from r2bspec.language_server.python_files import definitions_in
from r2bspec.language_server.symbols import names_of
from r2bspec.wiring.wiring import NodeWiring

_MAX_FILES: Final = 200


@dataclass(frozen=True, slots=True)
class Proposal:
    """One thing that can be written.

    Attributes:
        label: what is shown, and inserted if `insert` is empty.
        insert: what is inserted instead of the label.
        is_snippet: whether `insert` has placeholders.
        order: lower ones are shown first.
    """

    label: str
    detail: str = ""
    documentation: str = ""
    insert: str = ""
    kind: types.CompletionItemKind = types.CompletionItemKind.Value
    is_snippet: bool = False
    order: int = 500


def proposed_values(analysis: Analysis | None, context: CursorContext) -> Iterator[Proposal]:
    """The values that can be written at the path of a context."""
    if analysis is not None:
        for pattern, source in _VALUES:
            if _matches(context.path, pattern):
                yield from source(analysis, context)
    yield from _schema_values(context)


def names_as_keys(analysis: Analysis | None, context: CursorContext) -> Iterator[Proposal]:
    """The names that can be the keys of the map at the path of a context."""
    if analysis is not None:
        for pattern, source in _KEYS:
            if _matches(context.path, pattern):
                for each in source(analysis, context):
                    yield each if context.has_colon else _as_key(each)


def variable_value(analysis: Analysis, name: str) -> str:
    """The value of a variable as it is written; empty if it is unknown."""
    tree = analysis.loaded.tree
    node = lookup(tree, ("variables", name)) if tree is not None else None
    return node.text if isinstance(node, ScalarNode) else ""


def _as_key(each: Proposal) -> Proposal:
    return Proposal(
        each.label,
        each.detail,
        each.documentation,
        f"{each.insert or each.label}: ",
        each.kind,
        each.is_snippet,
        each.order,
    )


def _matches(path: Path, pattern: Sequence[str]) -> bool:
    """Whether a path fits a pattern: ``*`` is any part, ``**`` at first any beginning."""
    if pattern[0] == "**":
        tail = pattern[1:]
        return len(path) >= len(tail) and _matches(path[len(path) - len(tail) :], tail)
    return len(path) == len(pattern) and all(
        wanted in {"*", part} for part, wanted in zip(path, pattern, strict=True)
    )


def _schema_values(context: CursorContext) -> Iterator[Proposal]:
    part = schema_at(context.path) or {}
    if "type" in part and part["type"] == "boolean":
        yield from (Proposal(each, order=10) for each in ("true", "false"))
    default = part.get("default")
    for word in (*part.get("enum", ()), *part.get("r2b-words", ())):
        yield Proposal(
            str(word),
            detail="default" if word == default else "",
            kind=types.CompletionItemKind.EnumMember,
            order=10,
        )
    if isinstance(default, str | int | float) and default != "" and "enum" not in part:
        yield Proposal(
            str(default).lower() if isinstance(default, bool) else str(default), "default", order=20
        )
    for example in part.get("examples", ()):
        if isinstance(example, str) and part.get("r2b-kind") != "requirement":
            yield Proposal(example, "example", order=800)


def _metrics(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """Metrics with their units; after a metric and an operator, bounds."""
    from r2bspec.measure.errors import MetricError
    from r2bspec.measure.metric_catalogue import METRICS, names
    from r2bspec.measure.metric_reference import example_requirement, find_metric

    words = context.before.split()
    if len(words) >= 2 or (words and context.before.endswith(" ")):
        yield from _bounds(words)
        return
    spec_context = analysis.known
    processes = spec_context.processes if spec_context is not None else ()
    monitors = names_of(analysis, "monitor")
    listed = names(processes)
    for order, name in enumerate(listed):
        info = METRICS.get(name)
        if info is None:
            try:
                info = find_metric(name)
            except MetricError:
                continue
        proposal = Proposal(
            name,
            detail=info.dimension,
            documentation=f"{info.description}\n\nFor example: `{example_requirement(info)}`",
            kind=types.CompletionItemKind.Function,
            order=100 + order,
        )
        yield proposal
        if info.scope == "monitor" and len(monitors) > 1:
            for monitor in monitors:
                yield Proposal(
                    f"{monitor}.{name}",
                    proposal.detail,
                    proposal.documentation,
                    kind=proposal.kind,
                    order=300 + order,
                )
    yield Proposal("sustained", "the rate is sustained", kind=types.CompletionItemKind.Function)


def _bounds(words: Sequence[str]) -> Iterator[Proposal]:
    from r2bspec.measure.errors import MetricError
    from r2bspec.measure.metric_reference import find_metric

    operators = ("<", "<=", ">", ">=", "==", "!=")
    if len(words) == 1:
        yield from (
            Proposal(each, kind=types.CompletionItemKind.Operator, order=index)
            for index, each in enumerate(operators)
        )
        return
    if words[1] not in operators:
        return
    dimension = ""
    for name in (words[0], words[0].partition(".")[2]):
        try:
            dimension = find_metric(name).dimension
            break
        except MetricError:
            continue
    bounds = {
        "time": ("50 ms", "100 us", "1 s"),
        "rate": ("30 Hz", "95 % of offered", "95 % of baseline"),
        "share": ("1 %", "5 %"),
        "size": ("100 MiB", "1 GiB"),
        "count": ("0", "1"),
    }
    yield from (Proposal(each, dimension, order=5) for each in bounds.get(dimension, ()))


def _bag_topics(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    del context
    spec_context = analysis.known
    bag = spec_context.bag if spec_context is not None else None
    for name, info in (bag.topics if bag is not None else {}).items():
        yield Proposal(name, info.type, kind=types.CompletionItemKind.Field, order=5)


def _graph_topics(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The topics of the spec, relative to its namespace, with their types."""
    del context
    spec_context = analysis.known
    if spec_context is None:
        return
    for phase in reversed(spec_context.wiring.phases):
        for topic in phase.topics:
            ends = (*phase.publishers(topic), *phase.subscriptions(topic))
            known = next((each.type for each in ends if each.type), "")
            yield Proposal(
                spec_context.relative_name(topic),
                known,
                documentation="\n".join(_owners(topic, ends)),
                kind=types.CompletionItemKind.Field,
                order=5,
            )


def _owners(topic: str, ends: Iterable[Any]) -> Iterator[str]:
    yield f"`{topic}`"
    for each in ends:
        yield f"- {'published' if each.is_publisher else 'subscribed to'} by {each.owner}"


def _subscribed_topics(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The topics that the graph needs and that are not published in it."""
    del context
    spec_context = analysis.known
    if spec_context is None:
        return
    phase = spec_context.wiring.measure
    for topic in phase.topics:
        readers = [each for each in phase.subscriptions(topic) if each.is_node]
        publishers = [each for each in phase.publishers(topic) if each.is_node]
        if readers and not publishers:
            known = next((each.type for each in readers if each.type), "")
            yield Proposal(
                spec_context.relative_name(topic),
                known,
                kind=types.CompletionItemKind.Field,
                order=1,
            )


def _node_at(analysis: Analysis, path: Path) -> NodeWiring | None:
    spec_context = analysis.known
    if spec_context is None:
        return None
    return next(
        (node for _, node in spec_context.nodes if path[: len(node.path)] == node.path), None
    )


def _own_topics(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The topics of a node by their names in its code."""
    node = _node_at(analysis, context.path)
    if node is None:
        return
    found = {**(node.interface.publishes or {}), **(node.interface.subscribes or {})}
    for name, type_name in found.items():
        yield Proposal(name, type_name, kind=types.CompletionItemKind.Field, order=5)


def _parameters(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The declared parameters of a node, with their types and defaults."""
    node = _node_at(analysis, context.path)
    for name, info in ((node.interface.parameters or {}) if node is not None else {}).items():
        default = "" if info.default is None else f", default {info.default}"
        yield Proposal(
            name,
            f"{info.type or 'parameter'}{default}",
            kind=types.CompletionItemKind.Property,
            order=5,
        )


def _containers(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    del context
    for name in names_of(analysis, "container"):
        yield Proposal(name, "container", kind=types.CompletionItemKind.Module, order=5)


def _variables(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    del context
    for name in names_of(analysis, "variable"):
        value = variable_value(analysis, name)
        yield Proposal(name, value, kind=types.CompletionItemKind.Variable, order=5)


def _inputs(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    del context
    known = analysis.known
    for name in known.spec.playback.inputs if known is not None else ():
        yield Proposal(name, "input", kind=types.CompletionItemKind.Field, order=5)


def _rates(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    del context
    known = analysis.known
    for rate in known.spec.benchmark.rates if known is not None else ():
        yield Proposal(str(rate), "a rate of the benchmark", order=5)


def _types(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """Message types, those that the spec has first."""
    del context
    spec_context = analysis.known
    if spec_context is not None:
        ends = [each for phase in spec_context.wiring.phases for each in phase.endpoints]
        for used in dict.fromkeys(each.type for each in ends if each.type):
            yield Proposal(used, "used in this spec", kind=types.CompletionItemKind.Struct, order=5)
    for name in _common_types():
        yield Proposal(name, kind=types.CompletionItemKind.Struct, order=600)


@cache
def _common_types() -> tuple[str, ...]:
    from r2bspec.check.message_types import common_types

    return tuple(sorted(common_types()))


def _datasets(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    from r2bspec.bags.errors import DataError
    from r2bspec.datasets.locate_bag import known_datasets

    try:
        for name in known_datasets():
            yield Proposal(name, "dataset", kind=types.CompletionItemKind.Module, order=5)
    except DataError:
        pass
    suffixes = tuple(each.suffix for each in BAG_FORMATS)
    yield from _files(analysis, context, suffixes)


def _spec_files(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    yield from _files(analysis, context, (".yaml", ".yml"))


def _any_file(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    yield from _files(analysis, context, ())


def _files(
    analysis: Analysis, context: CursorContext, suffixes: Sequence[str]
) -> Iterator[Proposal]:
    """Files and folders below the folder of the spec; with suffixes, only files that have one."""
    written = context.before.rpartition("/")[0]
    home = analysis.path.parent
    folder = home / written
    try:
        if not folder.resolve().is_relative_to(home.resolve()):
            return
        entries = sorted(os.scandir(folder), key=lambda each: each.name)[:_MAX_FILES]
    except (OSError, ValueError):
        return
    for each in entries:
        if each.name.startswith((".", "__")) or each.name == analysis.path.name:
            continue
        is_folder = each.is_dir()
        if is_folder or not suffixes or FilePath(each.name).suffix in suffixes:
            kind = types.CompletionItemKind.Folder if is_folder else types.CompletionItemKind.File
            name = f"{written}/{each.name}" if written else each.name
            yield Proposal(name, kind=kind, order=400)


def _python_classes(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The reference nodes, and the classes in Python files next to the spec, without imports."""
    from r2bspec.wiring.node_interface import reference_node_interfaces

    del context
    for name in reference_node_interfaces():
        yield Proposal(name, "reference node", kind=types.CompletionItemKind.Class, order=300)
    home = analysis.path.parent
    files = [*sorted(home.glob("*.py")), *sorted(home.glob("nodes/*.py"))][:_MAX_FILES]
    for file in files:
        place = f"./{file.relative_to(home).as_posix()}"
        classes = (each for each in definitions_in(file) or () if isinstance(each, ast.ClassDef))
        for each in classes:
            yield Proposal(f"{place}:{each.name}", kind=types.CompletionItemKind.Class, order=5)


def _packages(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    from r2bspec.check.installed_packages import ament_packages
    from r2bspec.wiring.known_packages import catalogue_packages

    del analysis, context
    installed = ament_packages()
    for name in sorted(installed):
        yield Proposal(name, "installed", kind=types.CompletionItemKind.Module, order=10)
    for name in sorted(set(catalogue_packages()) - installed):
        yield Proposal(name, "known", kind=types.CompletionItemKind.Module, order=20)


def _of_package(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The executables or the plugins of the package that the node names."""
    from r2bspec.check.installed_packages import package_executables
    from r2bspec.wiring.known_packages import catalogue_nodes

    tree = analysis.loaded.tree
    package = lookup(tree, (*context.path[:-1], "package")) if tree is not None else None
    if not isinstance(package, ScalarNode):
        return
    if context.path[-1] == "plugin":
        yield from (Proposal(each, "plugin", order=5) for each in catalogue_nodes(package.text))
        return
    known = (each.executable for each in catalogue_nodes(package.text).values() if each.executable)
    for name in sorted({*known, *package_executables(package.text)}):
        yield Proposal(name, "executable", kind=types.CompletionItemKind.File, order=5)


_Source = Callable[[Analysis, CursorContext], Iterator[Proposal]]

_VALUES: Final[tuple[tuple[tuple[str, ...], _Source], ...]] = (
    (("slos", "*", "require"), _metrics),
    (("slos", "*", "require", "*"), _metrics),
    (("benchmark", "search", "holds"), _metrics),
    (("benchmark", "search", "holds", "*"), _metrics),
    (("slos", "*", "at"), _rates),
    (("data_loader", "bag"), _datasets),
    (("data_loader", "bag", "dataset"), _datasets),
    (("data_loader", "bag", "path"), _datasets),
    (("data_loader", "topics", "*"), _graph_topics),
    (("playback", "inputs", "*", "from"), _graph_topics),
    (("playback", "inputs", "*", "format"), _types),
    (("monitors", "*", "topic"), _graph_topics),
    (("monitors", "*", "format"), _types),
    (("monitors", "*", "answers", "*"), _inputs),
    (("**", "remappings", "*"), _graph_topics),
    (("**", "publishes", "*"), _types),
    (("**", "subscribes", "*"), _types),
    (("**", "container"), _containers),
    (("**", "python"), _python_classes),
    (("**", "package"), _packages),
    (("**", "executable"), _of_package),
    (("**", "plugin"), _of_package),
    (("extends",), _spec_files),
    (("extends", "*"), _spec_files),
    (("**", "launch", "path"), _any_file),
    (("**", "parameters", "*", "file"), _spec_files),
)

_KEYS: Final[tuple[tuple[tuple[str, ...], _Source], ...]] = (
    (("data_loader", "topics"), _bag_topics),
    (("playback", "inputs"), _subscribed_topics),
    (("**", "remappings"), _own_topics),
    (("graph", "nodes", "*", "parameters"), _parameters),
    (("preprocessors", "*", "parameters"), _parameters),
    (("slos", "*", "when"), _variables),
    (("matrix", "axes"), _variables),
)
