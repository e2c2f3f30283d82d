"""What an editor shows of a document while it is read.

Hovers explain the word under the pointer, as Markdown. Inlay hints are figures that follow from the
spec, shown where they are decided. The structure of the document is its symbols, what can be
folded, and the selections that grow around a position.
"""

from __future__ import annotations

from collections.abc import Iterator

from lsprotocol import types

from r2bspec.check.check_context import Context, KnownMetric, max_wrong_share
from r2bspec.diagnostics import Path, Span, format_path
from r2bspec.errors import R2bspecError
from r2bspec.judge.measure.metric_catalogue import definition
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.language.declaration import rule_at
from r2bspec.language.located_tree import (
    ListNode,
    MapNode,
    ScalarNode,
    TreeNode,
    lookup,
    scalars_with_paths,
)
from r2bspec.language.value_trace import UnknownPathError, provenance
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.positions import DocumentPlace, TextPositions, place_at, walk
from r2bspec.language_server.protocol import Position
from r2bspec.language_server.symbols import Occurrence, occurrence_at
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.time_estimate import estimate_time
from r2bspec.plan.wiring.wiring import WiredEndpoint


def hover(analysis: Analysis, positions: TextPositions, position: Position) -> types.Hover | None:
    """The documentation of what is at a position; None if there is nothing to say."""
    tree = analysis.loaded.tree
    if tree is None:
        return None
    pointer = positions.place(position)
    place = place_at(tree, str(analysis.path), pointer)
    occurrence = occurrence_at(analysis, pointer)
    parts: list[str] = []
    span = occurrence.span if occurrence is not None else place.span if place is not None else None
    if occurrence is not None:
        parts += _about_symbol(analysis, occurrence)
    if place is not None:
        parts += _about_requirement(analysis, place.path)
        parts += _about_value(analysis, place)
        parts += _about_key(place.path)
    if not parts or span is None:
        return None
    content = types.MarkupContent(types.MarkupKind.Markdown, "\n\n".join(parts))
    return types.Hover(content, positions.range(span))


def _about_key(path: Path) -> Iterator[str]:
    rule = rule_at(path)
    if rule is None or not rule.description:
        return
    yield f"**{format_path(path)}**: {rule.description}"
    default = rule.shown_default
    if default not in (None, {}, [], ""):
        yield f"Default: `{default}`"


def _about_value(analysis: Analysis, place: DocumentPlace) -> Iterator[str]:
    """The value after substitution, where it is not the text that is written."""
    tree = analysis.loaded.tree
    node = lookup(tree, place.path)
    elsewhere = node is not None and node.span.file != str(analysis.path)
    substituted = isinstance(node, ScalarNode) and node.origin is not None
    if isinstance(node, MapNode | ListNode) or not (substituted or elsewhere):
        return
    if isinstance(node, ScalarNode) and node.secret:
        return
    try:
        trace = provenance(analysis.loaded, format_path(place.path))
    except UnknownPathError:
        return
    steps = [
        f"- {step.message}" + (f" (line {step.span.line})" if step.span is not None else "")
        for step in trace.steps
    ]
    yield "\n".join([f"`{trace.value}`", "", *steps])


def _about_symbol(analysis: Analysis, occurrence: Occurrence) -> Iterator[str]:
    kind, name = occurrence.symbol.kind, occurrence.symbol.name
    yield f"{kind} `{name}`"
    context = analysis.context
    if kind != "topic" or context is None:
        return
    for phase in context.wiring.phases:
        ends = (*phase.publishers(name), *phase.subscriptions(name))
        if ends:
            known = ", ".join(sorted({f"`{end.type}`" for end in ends if end.type}))
            yield f"Type: {known or 'unknown'}"
            yield "\n".join(f"- {_endpoint(end)}" for end in ends)


def _endpoint(end: WiredEndpoint) -> str:
    verb = "published by" if end.is_publisher else "subscribed to by"
    text = f"{verb} {end.owner}"
    if end.own_name and end.is_node:
        text += f" as `{end.own_name}`"
    if end.qos is not None:
        text += f" ({end.qos.reliability}, {end.qos.durability}, depth {end.qos.depth})"
    return text


def _about_requirement(analysis: Analysis, path: Path) -> Iterator[str]:
    """A requirement in words, with what its metric means and how many messages it needs."""
    context = analysis.context
    if context is None:
        return
    for metric in context.known_metrics:
        if metric.path != path:
            continue
        requirement = metric.requirement
        yield f"`{requirement.text.strip()}`: {metric.info.description}"
        about = definition(metric.info)
        yield f"{about.text}\n\nFormula: {about.formula}"
        at, benchmark = metric.at, context.spec.benchmark
        if at is not None:
            played = round(at.hz * benchmark.duration.seconds) * benchmark.iterations
            yield (
                f"Judged at {at} from {played:,} steps "
                f"({benchmark.iterations} iterations of {benchmark.duration}), "
                f"at {metric.confidence:.0%} confidence."
            )
        yield from _about_sample(metric)


def _about_sample(each: KnownMetric) -> Iterator[str]:
    share = max_wrong_share(each)
    if share is None:
        return
    needed = min_sample_size(share, each.confidence)
    if needed is None:
        yield "No number of messages can confirm it."
    else:
        yield f"A verdict needs at least {needed:,} messages."


def inlay_hints(analysis: Analysis, positions: TextPositions) -> Iterator[types.InlayHint]:
    """The time of a run, the steps of an iteration, and the values of variables."""
    context = analysis.context
    if context is None:
        return
    benchmark = context.spec.benchmark
    hints: list[tuple[Path, bool, str]] = [(("benchmark",), True, _time_of_run(context))]
    for index, rate in enumerate(benchmark.rates):
        steps = round(rate.hz * benchmark.duration.seconds)
        hints.append(
            (("benchmark", "rates", index), False, f"{steps:,} steps x {benchmark.iterations}")
        )
    for path, is_key, text in hints:
        span = analysis.loaded.span(path, key=is_key)
        if text and span.file == str(analysis.path):
            yield _after(positions, positions.offsets(span)[1] + int(is_key), text)
    yield from _values(analysis, positions)


def _time_of_run(context: Context) -> str:
    if any(diagnostic.severity == "error" for diagnostic in context.loaded.diagnostics):
        return ""
    try:
        plan = compile_plan(
            context.spec,
            context.require_bags(),
            companion_files=context.companion_files,
            wiring=context.wiring,
        )
    except (R2bspecError, ValueError, KeyError):
        # A spec with findings may have no plan; the findings are shown.
        return ""
    return f"a run takes {estimate_time(plan).text()}"


def _values(analysis: Analysis, positions: TextPositions) -> Iterator[types.InlayHint]:
    """The values of what is written with a reference."""
    for path, written in scalars_with_paths(analysis.tree) if analysis.tree is not None else ():
        if "$(" not in written.text:
            continue
        value = lookup(analysis.loaded.tree, path)
        if isinstance(value, ScalarNode) and value.text != written.text and not value.secret:
            end = positions.offsets(written.span)[1]
            yield _after(positions, end, f"= {value.text[:40]}")


def _after(positions: TextPositions, offset: int, text: str) -> types.InlayHint:
    return types.InlayHint(positions.position(offset), text, padding_left=True)


_MAX_DEPTH = 5
_KINDS: dict[Path, types.SymbolKind] = {
    ("variables",): types.SymbolKind.Variable,
    ("graph", "nodes"): types.SymbolKind.Class,
    ("preprocessors",): types.SymbolKind.Class,
    ("containers",): types.SymbolKind.Module,
    ("monitors",): types.SymbolKind.Event,
    ("slos",): types.SymbolKind.Interface,
    ("playback", "inputs"): types.SymbolKind.Event,
    ("playback", "calls"): types.SymbolKind.Method,
}
"""Kinds of the entries of a map of names."""


def document_symbols(analysis: Analysis, positions: TextPositions) -> list[types.DocumentSymbol]:
    """The keys of a document, nested as they are."""
    return list(_symbols(analysis.tree, (), positions))


def _symbols(
    node: TreeNode | None, path: Path, positions: TextPositions
) -> Iterator[types.DocumentSymbol]:
    if not isinstance(node, MapNode) or len(path) >= _MAX_DEPTH:
        return
    for key, entry in node.entries.items():
        value = entry.value
        own = entry.key_span
        if not _is_after(value.span, own):
            # The value of an alias is written elsewhere.
            whole = own
        else:
            whole = Span(own.file, own.line, own.column, value.span.end_line, value.span.end_column)
        yield types.DocumentSymbol(
            name=key or "''",
            detail=value.text[:60] if isinstance(value, ScalarNode) else None,
            kind=_KINDS.get(path, _kind(value)),
            range=positions.range(whole),
            selection_range=positions.range(own),
            children=list(_symbols(value, (*path, key), positions)),
        )


def _kind(value: TreeNode) -> types.SymbolKind:
    if isinstance(value, MapNode):
        return types.SymbolKind.Object
    return types.SymbolKind.Array if isinstance(value, ListNode) else types.SymbolKind.Property


def _is_after(span: Span, other: Span) -> bool:
    return span.file == other.file and (span.line, span.column) >= (other.line, other.column)


def folding_ranges(analysis: Analysis, positions: TextPositions) -> list[types.FoldingRange]:
    """Every key whose value has several lines, and every block of comments."""
    folds = [*_folds(analysis.tree, positions), *_comment_folds(positions.text)]
    return [fold for fold in folds if fold.end_line > fold.start_line]


def _folds(tree: TreeNode | None, positions: TextPositions) -> Iterator[types.FoldingRange]:
    for _, key_span, node in walk(tree) if tree is not None else ():
        if key_span is None or _is_after(node.span, key_span):
            start = positions.range(key_span or node.span).start.line
            yield types.FoldingRange(start, positions.range(node.span).end.line)


def _comment_folds(text: str) -> Iterator[types.FoldingRange]:
    start: int | None = None
    lines = text.split("\n")
    for number, line in enumerate([*lines, ""]):
        if line.lstrip().startswith("#"):
            start = number if start is None else start
        elif start is not None:
            yield types.FoldingRange(start, number - 1, kind=types.FoldingRangeKind.Comment)
            start = None


def selection_range(
    analysis: Analysis, positions: TextPositions, position: Position
) -> types.SelectionRange:
    """The innermost value at a position, in what contains it, up to the whole document."""
    selection = types.SelectionRange(positions.range_of_offsets(0, len(positions.text)))
    tree = analysis.tree
    place = None
    if tree is not None:
        place = place_at(tree, str(analysis.path), positions.place(position))
    if place is None:
        return selection
    around = (lookup(tree, place.path[:depth]) for depth in range(len(place.path)))
    for span in (*(node.span for node in around if node is not None), place.span):
        inner = positions.range(span)
        if inner != selection.range:
            selection = types.SelectionRange(inner, selection)
    return selection
