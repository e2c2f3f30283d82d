"""Lines that do not fit together: colons, dashes, indentation, document marks."""

from __future__ import annotations

import re

from r2bspec.diagnostics import Diagnostic, Edit, Related, Span
from r2bspec.language.syntax.scanner_report import ScannerReport, indentation


def unexpected_colon(report: ScannerReport) -> Diagnostic | None:
    """A ``:`` where no map can begin."""
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
            f"the value of '{key[1]}' holds ': ', which would begin a map of its own",
            "quote the value, or put the inner keys on lines of their own",
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
            f"a space is missing after '{no_space[1]}:'",
            f"write '{no_space[1]}: {no_space[2].strip()}'",
            span=Span(report.problem_span.file, number, column - 1, number, column),
            edit=Edit(Span(report.problem_span.file, number, column, number, column), " "),
        )
    if indentation(report.line) > indentation(above[1]) and above[1].strip():
        return report.error(
            "R2B015",
            "this line is indented as if it belonged to the one above, which has a value already",
            "indent it like the line above, or move that line's value into a line of its own",
            span=report.line_span(report.problem_span.line),
            related=(Related("the line above", report.line_span(above[0])),),
        )
    return report.error("R2B014", "a ':' is not expected here", "quote the value that holds it")


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
            f"a space is missing after '{glued[0]}'",
            f"write '{glued[0]} {text[glued.end() :]}'",
            span=Span(span.file, span.line, column - 1, span.line, column),
            edit=Edit(Span(span.file, span.line, column, span.line, column), " "),
        )
    return report.error(
        "R2B014",
        "this line is neither a key with a ':' nor a part of the value above",
        "write 'key: value', or indent it to continue the value above",
        span=span,
    )


def wrong_indentation(report: ScannerReport) -> Diagnostic | None:
    """A line that belongs to no level above it."""
    expected = ("did not find expected key", "did not find expected '-'", "expected <block end>")
    if not report.problem.startswith(expected):
        return None
    quoted = re.search(r"(['\"])\s*$", report.before)
    if quoted is not None and report.before.strip():
        return report.error(
            "R2B012",
            "text follows the closing quote",
            "quote the whole value; inside single quotes, write '' for an apostrophe",
            span=report.rest_span(),
        )
    if report.before.strip():
        return report.error(
            "R2B010", "this does not belong to the value before it", "quote the whole value"
        )
    if "collection" in report.context and not report.rest.startswith("-"):
        return report.error(
            "R2B015",
            "a key stands where the list above would go on with '-'",
            "indent the key like the keys above the list, or begin the line with '- '",
            span=report.rest_span(),
            related=(Related("the list begins here", report.context_span),),
        )
    return report.error(
        "R2B015",
        "the indentation of this line matches none of the levels above it",
        "indent it exactly like the other keys of its map",
        span=report.rest_span(),
        related=(Related("the map around it begins here", report.context_span),),
    )


def inline_list(report: ScannerReport) -> Diagnostic | None:
    """A ``-`` behind a key."""
    if "sequence entries are not allowed" not in report.problem:
        return None
    return report.error(
        "R2B014",
        "a '- ' cannot follow a key on the same line",
        "put the list on the next lines, or write it as [a, b]; quote a value that begins with "
        "a dash",
    )


def document_marker(report: ScannerReport) -> Diagnostic | None:
    """What stands around a document, or in front of a value."""
    if "<document start>" in report.problem:
        return report.error(
            "R2B021",
            "text follows the end of the document",
            "a file holds one document; remove the '...' or '---' above",
            span=report.rest_span(),
        )
    if "incompatible YAML" in report.problem:
        return report.error("R2B010", "this version of YAML is not known", "remove the %YAML line")
    if "tag" in report.context or "tag" in report.problem:
        return report.error(
            "R2B022",
            "tags, which begin with '!', are not part of the language",
            "remove it, or quote the value",
            span=report.context_span,
        )
    if "block scalar" in report.context:
        return report.error(
            "R2B010",
            "after '|' or '>' the text begins on the next line",
            "move the text to the next line, or quote the value",
        )
    return None
