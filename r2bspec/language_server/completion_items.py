"""Completion: keys of the language, names of the spec, of its bag and of what is installed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

from lsprotocol import types

from r2bspec.language.schema_validator import schema_at
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.completion_values import (
    Proposal,
    names_as_keys,
    proposed_values,
    variable_value,
)
from r2bspec.language_server.cursor_context import CursorContext, cursor_context
from r2bspec.language_server.snippets import snippet_text
from r2bspec.language_server.symbols import names_of
from r2bspec.language_server.text_positions import TextPositions

TRIGGERS: Final = (" ", ".", "/", "(", "[", ":", "-")
"""Characters after which an editor asks by itself."""

_REFERENCE: Final = re.compile(r"\$\(\s*(?P<kind>var|env)?\s*(?P<name>\w*)\Z")
_WAIVER: Final = re.compile(r"#\s*r2bspec\s*:\s*ignore\s*\[(?:[^\]]*,)?\s*(?P<code>[\w-]*)\Z")


def complete(
    analysis: Analysis | None,
    positions: TextPositions,
    position: types.Position,
    *,
    snippets: bool = True,
) -> list[types.CompletionItem]:
    """What can be written at a position.

    Args:
        analysis: of the latest version that was valid; it may be older than the text.
        positions: of the text.
        position: of the cursor.
        snippets: whether the editor understands placeholders.
    """
    offset = positions.offset(position)
    line_start, _ = positions.line_at(offset)
    before = positions.text[line_start:offset]
    waiver = _WAIVER.search(before)
    if waiver is not None:
        return _items(_codes(), positions, offset - len(waiver["code"]), offset)
    context = cursor_context(positions.text, offset)
    if context is None:
        return []
    reference = _REFERENCE.search(before)
    if reference is not None:
        start = offset - len(
            reference["name"] if reference["kind"] else before[reference.start() :]
        )
        proposals = _references(analysis, has_kind=bool(reference["kind"]))
        return _items(proposals, positions, start, offset)
    if context.is_key:
        return [*_key_items(analysis, context, positions, snippets=snippets)]
    values = _items(
        proposed_values(analysis, context),
        positions,
        context.start,
        max(context.end, offset),
        snippets=snippets,
    )
    part = schema_at(context.path) or {}
    if "object" in _kinds(part) and not context.before.strip():
        # A map that has no key yet: the word will be its first key.
        values += _key_items(analysis, context, positions, snippets=snippets)
    return values


def _kinds(part: dict[str, Any]) -> Sequence[str]:
    kind = part.get("type", ())
    return (kind,) if isinstance(kind, str) else kind


def _key_items(
    analysis: Analysis | None, context: CursorContext, positions: TextPositions, *, snippets: bool
) -> Iterator[types.CompletionItem]:
    proposals = [*_schema_keys(context), *names_as_keys(analysis, context)]
    if snippets and not context.has_colon:
        proposals += _schema_snippets(context, _indent(positions, context))
    known = {each.label for each in proposals if each.label in context.siblings}
    kept = [each for each in proposals if each.label not in known]
    start, end = context.start, context.end
    yield from _items(kept, positions, start, end, snippets=snippets)


def _indent(positions: TextPositions, context: CursorContext) -> str:
    line_start, _ = positions.line_at(context.start)
    return " " * (context.start - line_start)


def _schema_keys(context: CursorContext) -> Iterator[Proposal]:
    part = schema_at(context.path) or {}
    required = part.get("required", ())
    for order, (key, below) in enumerate(part.get("properties", {}).items()):
        yield Proposal(
            key,
            detail=_type_text(below) + (", required" if key in required else ""),
            documentation=str(below.get("description", "")),
            insert="" if context.has_colon else f"{key}: ",
            kind=types.CompletionItemKind.Property,
            order=order + (0 if key in required else 100),
        )


def _type_text(part: dict[str, Any]) -> str:
    kind = part.get("r2b-kind") or " or ".join(_kinds(part))
    default = part.get("default")
    return kind if default in (None, {}, [], "") else f"{kind}, default {default}"


def _schema_snippets(context: CursorContext, indent: str) -> Iterator[Proposal]:
    part = schema_at(context.path) or {}
    for each in part.get("defaultSnippets", ()):
        if isinstance(each.get("body"), dict):
            yield Proposal(
                each["label"],
                detail="snippet",
                insert=snippet_text(each["body"], indent),
                kind=types.CompletionItemKind.Snippet,
                is_snippet=True,
                order=900,
            )


def _references(analysis: Analysis | None, *, has_kind: bool) -> Iterator[Proposal]:
    if analysis is None:
        return
    for name in names_of(analysis, "variable"):
        yield Proposal(
            name if has_kind else f"$(var {name})",
            detail=variable_value(analysis, name),
            kind=types.CompletionItemKind.Variable,
        )


def _codes() -> Iterator[Proposal]:
    from r2bspec.check.pages import all_pages

    for code, page in all_pages().items():
        yield Proposal(page.slug, detail=code, documentation=page.why)
        yield Proposal(code, detail=page.slug, documentation=page.why)


def _items(
    proposals: Iterable[Proposal],
    positions: TextPositions,
    start: int,
    end: int,
    *,
    snippets: bool = True,
) -> list[types.CompletionItem]:
    found: dict[str, types.CompletionItem] = {}
    replaced = positions.range_of_offsets(start, end)
    for each in proposals:
        if each.label in found or (each.is_snippet and not snippets):
            continue
        found[each.label] = types.CompletionItem(
            label=each.label,
            kind=each.kind,
            detail=each.detail or None,
            documentation=types.MarkupContent(types.MarkupKind.Markdown, each.documentation)
            if each.documentation
            else None,
            sort_text=f"{each.order:05d}{each.label}",
            filter_text=each.label,
            text_edit=types.TextEdit(replaced, each.insert or each.label),
            insert_text_format=types.InsertTextFormat.Snippet
            if each.is_snippet
            else types.InsertTextFormat.PlainText,
        )
    return list(found.values())
