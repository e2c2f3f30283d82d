"""The place in the file of a part of a value."""

from __future__ import annotations

from r2bspec.diagnostics.diagnostic import Span
from r2bspec.language.source_text import Source


def inner_span(source: Source | None, span: Span, text: str, offset: int, length: int) -> Span:
    """The span of ``text[offset : offset + length]``, where `text` is the value at `span`.

    Quotes, escapes and folded lines make the characters of the file differ from those of the
    value. Therefore the part is searched for in the file, as the occurrence of the same rank. If
    that fails, or if `source` is None, the result is the whole span.
    """
    if source is None:
        return span
    raw = _source_text(source, span)
    piece = text[offset : offset + length]
    if not piece:
        end = len(raw.rstrip())
        end -= 1 if raw[:1] in ("'", '"') and end > 1 else 0
        return _span_at_offset(span, raw, end, 1)
    rank = text.count(piece, 0, offset)
    found = -1
    for _ in range(rank + 1):
        found = raw.find(piece, found + 1)
        if found < 0:
            return span
    return _span_at_offset(span, raw, found, len(piece))


def _source_text(source: Source, span: Span) -> str:
    lines = source.lines[span.line - 1 : span.end_line]
    if not lines:
        return ""
    if span.line == span.end_line:
        return lines[0][span.column - 1 : span.end_column - 1]
    if len(lines) == span.end_line - span.line + 1:
        lines[-1] = lines[-1][: span.end_column - 1]
    lines[0] = lines[0][span.column - 1 :]
    return "\n".join(lines)


def _span_at_offset(span: Span, raw: str, start: int, length: int) -> Span:
    before = raw[:start]
    line = span.line + before.count("\n")
    column = start + span.column if line == span.line else start - before.rfind("\n")
    return Span(span.file, line, column, line, column + length)
