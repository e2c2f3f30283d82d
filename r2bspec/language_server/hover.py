"""Hovers: the description of the word under the pointer, as Markdown."""

from __future__ import annotations

from collections.abc import Iterator

from lsprotocol import types

from r2bspec.check.check_context import KnownMetric, max_wrong_share
from r2bspec.diagnostics import Path, format_path
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.language.declaration import rule_at
from r2bspec.language.explain_violations import to_flow_yaml
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, lookup, to_plain
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.positions import DocumentPlace, TextPositions, place_at
from r2bspec.language_server.symbols import Occurrence, occurrence_at
from r2bspec.plan.wiring.wiring import WiredEndpoint


def hover(
    analysis: Analysis, positions: TextPositions, position: types.Position
) -> types.Hover | None:
    """Return the documentation of the word at a position; None if there is none."""
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
    """Yield the value after substitution, where it is not the text that is written."""
    tree = analysis.loaded.tree
    node = lookup(tree, place.path)
    elsewhere = node is not None and node.span.file != str(analysis.path)
    substituted = isinstance(node, ScalarNode) and node.origin is not None
    if isinstance(node, MapNode | ListNode) or not (substituted or elsewhere):
        return
    if node is not None:
        yield f"`{to_flow_yaml(to_plain(node))}`"
        if isinstance(node, ScalarNode) and node.origin is not None:
            yield f"- {node.origin.message} (line {node.origin.span.line})"


def _about_symbol(analysis: Analysis, occurrence: Occurrence) -> Iterator[str]:
    kind, name = occurrence.symbol.kind, occurrence.symbol.name
    yield f"{kind} `{name}`"
    context = analysis.context
    if kind != "topic" or context is None:
        return
    for phase in context.wiring.phases:
        ends = (*phase.publishers(name), *phase.subscriptions(name))
        if ends:
            type_names = ", ".join(sorted({f"`{end.type}`" for end in ends if end.type}))
            yield f"Type: {type_names or 'unknown'}"
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
    """Yield a requirement in words, with what its metric means and how many messages it needs."""
    context = analysis.context
    if context is None:
        return
    for metric in context.known_metrics:
        if metric.path != path:
            continue
        requirement = metric.requirement
        yield f"`{requirement.text.strip()}`: {metric.info.description}"
        about = metric.info.metric
        yield f"{about.text}\n\nFormula: {about.full_formula}"
        at, benchmark = metric.at, context.spec.benchmark
        if at is not None:
            played = round(at.hz * benchmark.duration.seconds) * benchmark.iterations
            yield (
                f"Judged at {at} from {played:,} steps "
                f"({benchmark.iterations} iterations of {benchmark.duration}), "
                f"at {metric.confidence:.0%} confidence."
            )
        yield from _about_sample(metric)


def _about_sample(metric: KnownMetric) -> Iterator[str]:
    share = max_wrong_share(metric)
    if share is None:
        return
    needed = min_sample_size(share, metric.confidence)
    if needed is None:
        yield "No number of messages can confirm it."
    else:
        yield f"A verdict needs at least {needed:,} messages."
