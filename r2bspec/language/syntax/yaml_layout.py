"""Errors in the structure of lines: colons, dashes, indentation, document marks."""

from __future__ import annotations

import re

from r2bspec.diagnostics import Diagnostic, Edit, Related, Span
from r2bspec.language.syntax.scanner_report import ScannerReport, indentation


def unexpected_colon(report: ScannerReport) -> Diagnostic | None:
    """A ``:`` where a map cannot begin."""
    if "mapping values are not allowed" not in report.problem:
        return None
    key = re.match(r"\s*(?:- +)*([^\s:#'\"\[{][^:#]*?)\s*:(?:\s|$)", report.before)
    if key is not None and report.before[key.end() :].strip():
        start, value = key.end(), report.line[key.end() :].rstrip()
        start += len(value) - len(value.lstrip())
        value = value.strip()
        span = Span(
            report.problem_span.file,
            report.problem_span.line,
            start + 1,
            report.problem_span.line,
            len(value) + start,
        )
        quotable = '"' not in value and "\\" not in value and " #" not in value
        return report.error(
            "R2B014",
            f"the value of '{key[1]}' contains ': ', which starts another map",
            "quote the value, or write the inner keys on lines of their own",
            edit=Edit(
                Span(span.file, span.line, start + 1, span.line, start + 1 + len(value)),
                f'"{value}"',
            )
            if quotable
            else None,
        )
    above = report.line_above()
    no_space = re.match(r"\s*(?:- +)*([A-Za-z_]\w*):(\S.*)", above[1])
    if no_space is not None:
        number, _ = above
        column = no_space.start(2) + 1
        return report.error(
            "R2B014",
            f"missing space after '{no_space[1]}:'",
            f"write '{no_space[1]}: {no_space[2].strip()}'",
            span=Span(report.problem_span.file, number, column - 1, number, column),
            edit=Edit(Span(report.problem_span.file, number, column, number, column), " "),
        )
    if indentation(report.line) > indentation(above[1]) and above[1].strip():
        return report.error(
            "R2B015",
            "this line is indented below a key that already has a value",
            "indent it like the line above, or move the value of that line to a line of its own",
            span=report.line_span(report.problem_span.line),
            related=(Related("the line above", report.line_span(above[0])),),
        )
    return report.error("R2B014", "unexpected ':'", "quote the value that contains it")


def missing_colon(report: ScannerReport) -> Diagnostic | None:
    """A line that should be a key."""
    if "could not find expected ':'" not in report.problem:
        return None
    text = report.source.line(report.context_span.line)[report.context_span.column - 1 :].rstrip()
    span = Span(
        report.context_span.file,
        report.context_span.line,
        report.context_span.column,
        report.context_span.line,
        report.context_span.column + max(len(text), 1),
    )
    glued = re.match(r"[A-Za-z_][A-Za-z0-9_]*:(?=[^\s:/])", text)
    if glued is not None:
        column = span.column + glued.end()
        return report.error(
            "R2B014",
            f"missing space after '{glued[0]}'",
            f"write '{glued[0]} {text[glued.end() :]}'",
            span=Span(span.file, span.line, column - 1, span.line, column),
            edit=Edit(Span(span.file, span.line, column, span.line, column), " "),
        )
    return report.error(
        "R2B014",
        "this line is neither a key nor part of the value above",
        "write 'key: value', or indent the line to continue the value above",
        span=span,
    )


def wrong_indentation(report: ScannerReport) -> Diagnostic | None:
    """A line whose indentation matches no level above it."""
    expected = ("did not find expected key", "did not find expected '-'", "expected <block end>")
    if not report.problem.startswith(expected):
        return None
    quoted = re.search(r"(['\"])\s*$", report.before)
    if quoted is not None and report.before.strip():
        return report.error(
            "R2B012",
            "text after the closing quote",
            "quote the whole value; in single quotes, write '' for an apostrophe",
            span=report.rest_span(),
        )
    if report.before.strip():
        return report.error("R2B010", "unexpected text after a value", "quote the whole value")
    if "collection" in report.context and not report.rest.startswith("-"):
        return report.error(
            "R2B015",
            "expected another item of the list above, found a key",
            "indent the key like the keys above the list, or start the line with '- '",
            span=report.rest_span(),
            related=(Related("the list starts here", report.context_span),),
        )
    return report.error(
        "R2B015",
        "the indentation of this line matches no level above",
        "indent it exactly like the other keys of its map",
        span=report.rest_span(),
        related=(Related("the enclosing map starts here", report.context_span),),
    )


def inline_list(report: ScannerReport) -> Diagnostic | None:
    """A ``-`` after a key."""
    if "sequence entries are not allowed" not in report.problem:
        return None
    return report.error(
        "R2B014",
        "a list item cannot follow a key on the same line",
        "move the list to the next line, or write it as [a, b]; quote a value that begins with a "
        "dash",
    )


def document_marker(report: ScannerReport) -> Diagnostic | None:
    """Document marks, directives, tags, and the header of a block scalar."""
    if "<document start>" in report.problem:
        return report.error(
            "R2B021",
            "text after the end of the document",
            "a file contains one document; remove the '...' or '---' above",
            span=report.rest_span(),
        )
    if "incompatible YAML" in report.problem:
        return report.error("R2B010", "unsupported YAML version", "remove the %YAML line")
    if "tag" in report.context or "tag" in report.problem:
        return report.error(
            "R2B022",
            "YAML tags (text that begins with '!') are not supported",
            "remove the tag, or quote the value",
            span=report.context_span,
        )
    if "block scalar" in report.context:
        return report.error(
            "R2B010",
            "text on the same line as '|' or '>'",
            "move the text to the next line, or quote the value",
        )
    return None
