"""Completion: keys of the language, names of the spec, of its bag and of what is installed.

Keys and their snippets come from the schema; snippets are values with placeholders, written as YAML
in block style.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import yaml
from lsprotocol import types

from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.language.declaration import ValueRule, rule_at
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.positions import CursorContext, TextPositions, cursor_context
from r2bspec.language_server.proposals import (
    CompletionProposal,
    proposed_keys,
    proposed_values,
    references,
)

_STEP: Final = "  "
_PLACEHOLDER = re.compile(r"(?<=[ ])'?\$\{(\d+):[^}\n]*\}'?$", re.MULTILINE)


class _BlockDumper(yaml.SafeDumper):
    """Lists are indented below their keys."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:  # noqa: ARG002
        super().increase_indent(flow, indentless=False)


def snippet_text(body: Mapping[str, Any]) -> str:
    """Return the lines of a snippet, not indented.

    A value that is only a placeholder is left empty: an editor proposes what begins with the text
    before the cursor, and the text of a placeholder would be the beginning of nothing.

    Args:
        body: the map that is inserted, with placeholders as ``${1:name}``.
    """
    text = yaml.dump(body, Dumper=_BlockDumper, sort_keys=False, allow_unicode=True)
    return _PLACEHOLDER.sub(r"$\1", text.rstrip("\n"))


TRIGGERS: Final = (" ", ".", "/", "(", "[", ":", "-")
"""Characters after which an editor asks by itself."""

_REFERENCE: Final = re.compile(r"\$\(\s*(?P<kind>var|env)?\s*(?P<name>\w*)\Z")
_WAIVER: Final = re.compile(r"#\s*r2bspec\s*:\s*ignore\s*\[(?:[^\]]*,)?\s*(?P<code>[\w-]*)\Z")
_BLOCK: Final = re.compile(r"(?P<indent>\s*)(?P<items>(?:-\s+)*)\Z")


def complete(
    analysis: Analysis | None,
    positions: TextPositions,
    position: types.Position,
    snippets: bool,
) -> list[types.CompletionItem]:
    """Return the completions at a position.

    Args:
        analysis: the analysis of the latest version that could be parsed; it may be older than the
            text.
        positions: the positions of the text.
        position: the position of the cursor.
        snippets: whether the editor understands placeholders.
    """
    offset = positions.offset(position)
    line_start, _ = positions.line_at(offset)
    before = positions.text[line_start:offset]
    waiver = _WAIVER.search(before)
    if waiver is not None:
        return _items(_codes(), _Insertion(positions, offset - len(waiver["code"]), offset))
    context = cursor_context(positions.text, offset)
    if context is None:
        return []
    reference = _REFERENCE.search(before)
    if reference is not None:
        written = reference["name"] if reference["kind"] else before[reference.start() :]
        proposals = references(analysis, reference["kind"] or "")
        return _items(proposals, _Insertion(positions, offset - len(written), offset))
    written = positions.text[line_start : context.start]
    where = _Insertion(positions, context.start, max(context.end, offset), written, snippets)
    if context.is_key:
        return _items(_keys(analysis, context, where), where)
    values = _items(proposed_values(analysis, context), where)
    rule = rule_at(context.path)
    is_map = rule is not None and "object" in rule.kinds
    if is_map and where.is_block and not context.before.strip():
        # A map that has no key yet: the word will be its first key.
        values += _items(_keys(analysis, context, where), where)
    return values


@dataclass(frozen=True, slots=True)
class _Insertion:
    """Where something is inserted.

    Attributes:
        start: the offset at which the word begins that is replaced.
        end: the offset at which it ends.
        before: the line before the word.
    """

    positions: TextPositions
    start: int
    end: int
    before: str = ""
    snippets: bool = False

    @property
    def is_block(self) -> bool:
        """Whether the word begins an entry on a line of its own."""
        return _BLOCK.match(self.before) is not None

    def indented(self, text: str) -> str:
        """Return a text with its further lines inside the items of a list.

        The editor indents them like the first.
        """
        match = _BLOCK.match(self.before)
        if match is None:
            return text
        return text.replace("\n", f"\n{' ' * len(match['items'])}")


def _keys(
    analysis: Analysis | None, context: CursorContext, where: _Insertion
) -> Iterator[CompletionProposal]:
    items = [*_schema_keys(context), *proposed_keys(analysis, context)]
    if not context.has_colon:
        items += _schema_snippets(context)
    is_block = where.snippets and where.is_block and not context.has_colon
    for key in items:
        if key.label not in context.siblings:
            yield _with_room(key, context) if is_block else key


def _with_room(each: CompletionProposal, context: CursorContext) -> CompletionProposal:
    """Return a key with room for its map below it."""
    rule = rule_at((*context.path, each.label))
    if each.is_snippet or rule is None or rule.kinds != ("object",):
        return each
    return replace(each, insert=f"{each.label}:\n{_STEP}$0", is_snippet=True)


def _schema_keys(context: CursorContext) -> Iterator[CompletionProposal]:
    owner = rule_at(context.path)
    if owner is None or owner.keys is None:
        return
    required = owner.required
    for order, (key, below) in enumerate(owner.keys.items()):
        yield CompletionProposal(
            key,
            detail=_type_text(below) + (", required" if key in required else ""),
            documentation=below.description,
            insert="" if context.has_colon else f"{key}: ",
            kind=types.CompletionItemKind.Property,
            order=order + (0 if key in required else 100),
        )


def _type_text(rule: ValueRule) -> str:
    kind = " or ".join(rule.kinds)
    if rule.is_parsed and rule.quantity is not None:
        kind = rule.quantity.kind
    default = rule.shown_default
    return kind if default in (None, {}, [], "") else f"{kind}, default {default}"


def _schema_snippets(context: CursorContext) -> Iterator[CompletionProposal]:
    rule = rule_at(context.path)
    for snippet in rule.snippets if rule is not None else ():
        if isinstance(snippet.get("body"), dict):
            label = snippet["label"]
            is_key = rule is not None and label in (rule.keys or ())
            yield CompletionProposal(
                f"{label} with its keys" if is_key else label,
                detail="snippet",
                insert=snippet_text(snippet["body"]),
                kind=types.CompletionItemKind.Snippet,
                is_snippet=True,
                order=900,
            )


def _codes() -> Iterator[CompletionProposal]:
    for code, page in all_pages().items():
        yield CompletionProposal(page.slug, detail=code, documentation=page.why)
        yield CompletionProposal(code, detail=page.slug, documentation=page.why)


def _items(
    proposals: Iterable[CompletionProposal], where: _Insertion
) -> list[types.CompletionItem]:
    items: dict[str, types.CompletionItem] = {}
    replaced = where.positions.range_of_offsets(where.start, where.end)
    for proposal in proposals:
        if proposal.label in items or (proposal.is_snippet and not where.snippets):
            continue
        items[proposal.label] = types.CompletionItem(
            label=proposal.label,
            kind=proposal.kind,
            detail=proposal.detail or None,
            documentation=types.MarkupContent(types.MarkupKind.Markdown, proposal.documentation)
            if proposal.documentation
            else None,
            sort_text=f"{proposal.order:05d}{proposal.label}",
            filter_text=proposal.label,
            text_edit=types.TextEdit(replaced, where.indented(proposal.insert or proposal.label)),
            insert_text_format=types.InsertTextFormat.Snippet
            if proposal.is_snippet
            else types.InsertTextFormat.PlainText,
            insert_text_mode=types.InsertTextMode.AdjustIndentation
            if "\n" in proposal.insert
            else None,
        )
    return list(items.values())
