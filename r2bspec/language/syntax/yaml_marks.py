"""Characters with a special meaning in YAML: tabs, quotes, brackets, reserved characters."""

from __future__ import annotations

import re

from r2bspec.diagnostics import Diagnostic, Edit, Related, Span
from r2bspec.language.syntax.scanner_report import ScannerReport


def tab_indentation(report: ScannerReport) -> Diagnostic | None:
    """A tab for indentation."""
    at_tab = report.rest.startswith("\t") and "start any token" in report.problem
    if not at_tab and "tab character" not in report.problem:
        return None
    indent = re.match(r"[ \t]*", report.line)
    width = len(indent[0]) if indent is not None else 0
    span = Span(
        report.problem_span.file, report.problem_span.line, 1, report.problem_span.line, width + 1
    )
    return report.error(
        "R2B011",
        "tab in the indentation",
        "indent with spaces, two per level",
        span=span if "\t" in report.line[:width] else None,
    )


def reserved_character(report: ScannerReport) -> Diagnostic | None:
    """A character with which unquoted text cannot begin."""
    if "start any token" not in report.problem:
        return None
    char = report.rest[:1]
    word = _word(report.rest)
    span = report.problem_span
    span = Span(span.file, span.line, span.column, span.line, span.column + max(len(word), 1))
    text = f'"{word}"'
    simple = word and not set(word) & {'"', "\\"}
    return report.error(
        "R2B013",
        f"unquoted text cannot begin with '{char}'",
        f"quote it: {text}" if simple else "quote it",
        span=span,
        edit=Edit(span, text) if simple else None,
    )


def unclosed_quote(report: ScannerReport) -> Diagnostic | None:
    """A quote that is not closed."""
    ended = "unexpected end of stream" in report.problem
    if not ended and "document indicator" not in report.problem:
        return None
    mark = report.source.line(report.context_span.line)[report.context_span.column - 1 :][:1]
    return report.error(
        "R2B012",
        "unclosed single quote" if mark == "'" else "unclosed double quote",
        f"close it with {mark}; in single quotes, write '' for an apostrophe"
        if mark == "'"
        else f"close it with {mark}",
        span=report.context_span,
    )


def unclosed_bracket(report: ScannerReport) -> Diagnostic | None:
    """A list or map in brackets that is not continued by a comma or closed."""
    if "flow" not in report.context:
        return None
    at_end = not report.rest.strip() or "stream end" in report.problem
    opener = report.source.line(report.context_span.line)[report.context_span.column - 1 :][:1]
    if opener not in ("[", "{"):
        if not at_end:
            return None
        return report.error(
            "R2B012",
            "the file ends inside brackets or braces",
            "close it with ']' or '}'",
        )
    closer = {"[": "]", "{": "}"}[opener]
    if report.rest[:1] in "]}" and report.rest[:1] and report.rest[:1] != closer:
        return report.error(
            "R2B012",
            f"'{report.rest[:1]}' does not match the opening '{opener}'",
            f"write '{closer}'",
            related=(Related("opened here", report.context_span),),
        )
    if at_end or report.problem_span.line != report.context_span.line:
        return report.error(
            "R2B012",
            f"unclosed '{opener}'",
            f"close it with '{closer}', and separate its items by commas",
            span=report.context_span,
            related=(Related("the error is noticed here", report.problem_span),),
        )
    return report.error(
        "R2B012",
        f"missing ',' or '{closer}' before this",
        f"separate the items by commas, and close with '{closer}'; quote a value that contains a "
        "bracket, a brace or a comma",
        related=(Related("opened here", report.context_span),),
    )


def stray_bracket(report: ScannerReport) -> Diagnostic | None:
    """A closing bracket or a comma outside of brackets."""
    if report.rest[:1] not in ("]", "}", ","):
        return None
    return report.error(
        "R2B012",
        f"unmatched '{report.rest[:1]}'"
        if report.rest[:1] != ","
        else "missing value before this comma",
        "remove it, or quote the value if it is part of the text",
    )


def invalid_escape(report: ScannerReport) -> Diagnostic | None:
    """An escape sequence that YAML does not have."""
    if "escape character" not in report.problem and "hexdecimal" not in report.problem:
        return None
    # libyaml points to the backslash, the Python scanner to the character after it.
    column = (
        report.problem_span.column
        if report.rest.startswith("\\")
        else report.problem_span.column - 1
    )
    span = Span(
        report.problem_span.file,
        report.problem_span.line,
        column,
        report.problem_span.line,
        column + 2,
    )
    shown = report.line[column - 1 : column + 1]
    return report.error(
        "R2B016",
        f"unknown escape sequence '{shown}'",
        "write a backslash as \\\\, or use single quotes, which have no escapes",
        span=span,
    )


def missing_anchor_name(report: ScannerReport) -> Diagnostic | None:
    """Unquoted text that begins with ``*`` or ``&``."""
    if "alphabetic or numeric" not in report.problem:
        return None
    char = "*" if "alias" in report.context else "&"
    return report.error(
        "R2B013",
        f"unquoted text cannot begin with '{char}', the mark of an "
        f"{'alias' if char == '*' else 'anchor'}",
        "quote it",
        span=report.context_span,
    )


def _word(text: str) -> str:
    """The text up to a colon, a comment, a comma or a closing bracket."""
    return re.split(r"\s+#|[,\]}]|:(?:\s|$)", text, maxsplit=1)[0].rstrip()
