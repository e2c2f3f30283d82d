"""Explanations of YAML syntax errors.

PyYAML reports what its scanner expected, which rarely names the mistake. Each explainer below turns
the scanner's report, and the text around it, into a cause and a fix. The messages of libyaml and of
PyYAML's pure Python scanner differ; both are recognised.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Unpack

import msgspec
import yaml

from r2bspec.diagnostics import Diagnostic, Edit, Related, Span
from r2bspec.diagnostics.diagnostic import DiagnosticParts
from r2bspec.language.document import Source
from r2bspec.safe_io.limits import MAX_YAML_DEPTH
from r2bspec.safe_io.safe_yaml import SCANNER_TOO_DEEP, too_deep

TOO_DEEP = too_deep(MAX_YAML_DEPTH)
TOO_DEEP_HELP = "look for an unclosed bracket or brace"


class ScannerReport(msgspec.Struct, frozen=True):
    """The scanner's report: where it failed, what it was reading, and the text there."""

    problem: str
    context: str
    problem_span: Span
    context_span: Span
    source: Source

    @property
    def line(self) -> str:
        """The line where the scanner failed."""
        return self.source.line(self.problem_span.line)

    @property
    def rest(self) -> str:
        """The text of the line from the failing column on."""
        return self.line[self.problem_span.column - 1 :]

    @property
    def before(self) -> str:
        """The text of the line before the failing column."""
        return self.line[: self.problem_span.column - 1]

    def error(
        self,
        code: str,
        message: str,
        help_text: str,
        *,
        span: Span | None = None,
        **parts: Unpack[DiagnosticParts],
    ) -> Diagnostic:
        """A diagnostic at the failing column, or at `span`."""
        return Diagnostic.error(code, message, span or self.problem_span, help_text, **parts)

    def span(self, start: int, end: int, line: int = 0) -> Span:
        """The span from a column to another in a line, by default in the failing one."""
        line = line or self.problem_span.line
        return Span(self.problem_span.file, line, start, line, end)

    def rest_span(self) -> Span:
        """The span of the line's content from the failing column on."""
        start = self.problem_span.column
        return self.span(start, start + max(len(self.rest.rstrip()), 1))

    def line_span(self, number: int) -> Span:
        """The span of one line's content, without its indentation."""
        text = self.source.line(number)
        return self.span(indentation(text) + 1, len(text.rstrip()) + 1, number)

    def opening(self) -> str:
        """The first character of what the scanner was reading."""
        return self.source.line(self.context_span.line)[self.context_span.column - 1 :][:1]

    def line_above(self) -> tuple[int, str]:
        """The nearest line above that has content: its number, and its text."""
        for number in range(self.problem_span.line - 1, 0, -1):
            text = self.source.line(number)
            if text.strip() and not text.lstrip().startswith("#"):
                return number, text
        return self.problem_span.line, ""


def indentation(line: str) -> int:
    """The number of spaces at the beginning of a line."""
    return len(line) - len(line.lstrip(" "))


def tab_indentation(report: ScannerReport) -> Diagnostic | None:
    """A tab for indentation."""
    at_tab = report.rest.startswith("\t") and "start any token" in report.problem
    if not at_tab and "tab character" not in report.problem:
        return None
    indent = re.match(r"[ \t]*", report.line)
    width = len(indent[0]) if indent is not None else 0
    return report.error(
        "R2B011",
        "tab in the indentation",
        "indent with spaces, two per level",
        span=report.span(1, width + 1) if "\t" in report.line[:width] else None,
    )


def reserved_character(report: ScannerReport) -> Diagnostic | None:
    """A character with which unquoted text cannot begin."""
    if "start any token" not in report.problem:
        return None
    char = report.rest[:1]
    word = _word(report.rest)
    start = report.problem_span.column
    span = report.span(start, start + max(len(word), 1))
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
    mark = report.opening()
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
    opener = report.opening()
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
    column = report.problem_span.column - (not report.rest.startswith("\\"))
    return report.error(
        "R2B016",
        f"unknown escape sequence '{report.line[column - 1 : column + 1]}'",
        "write a backslash as \\\\, or use single quotes, which have no escapes",
        span=report.span(column, column + 2),
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


def unexpected_colon(report: ScannerReport) -> Diagnostic | None:
    """A ``:`` where a map cannot begin."""
    if "mapping values are not allowed" not in report.problem:
        return None
    key = re.match(r"\s*(?:- +)*([^\s:#'\"\[{][^:#]*?)\s*:(?:\s|$)", report.before)
    if key is not None and report.before[key.end() :].strip():
        rest = report.line[key.end() :].rstrip()
        value = rest.strip()
        start = key.end() + len(rest) - len(value) + 1
        quotable = '"' not in value and "\\" not in value and " #" not in value
        return report.error(
            "R2B014",
            f"the value of '{key[1]}' contains ': ', which starts another map",
            "quote the value, or write the inner keys on lines of their own",
            edit=Edit(report.span(start, start + len(value)), f'"{value}"') if quotable else None,
        )
    number, above = report.line_above()
    no_space = re.match(r"\s*(?:- +)*([A-Za-z_]\w*):(\S.*)", above)
    if no_space is not None:
        column = no_space.start(2) + 1
        return _missing_space(report, number, column, f"{no_space[1]}:", no_space[2].strip())
    if indentation(report.line) > indentation(above) and above.strip():
        return report.error(
            "R2B015",
            "this line is indented below a key that already has a value",
            "indent it like the line above, or move the value of that line to a line of its own",
            span=report.line_span(report.problem_span.line),
            related=(Related("the line above", report.line_span(number)),),
        )
    return report.error("R2B014", "unexpected ':'", "quote the value that contains it")


def missing_colon(report: ScannerReport) -> Diagnostic | None:
    """A line that should be a key."""
    if "could not find expected ':'" not in report.problem:
        return None
    line, start = report.context_span.line, report.context_span.column
    text = report.source.line(line)[start - 1 :].rstrip()
    glued = re.match(r"[A-Za-z_][A-Za-z0-9_]*:(?=[^\s:/])", text)
    if glued is not None:
        return _missing_space(report, line, start + glued.end(), glued[0], text[glued.end() :])
    return report.error(
        "R2B014",
        "this line is neither a key nor part of the value above",
        "write 'key: value', or indent the line to continue the value above",
        span=report.span(start, start + max(len(text), 1), line),
    )


def _missing_space(
    report: ScannerReport, line: int, column: int, key: str, value: str
) -> Diagnostic:
    return report.error(
        "R2B014",
        f"missing space after '{key}'",
        f"write '{key} {value}'",
        span=report.span(column - 1, column, line),
        edit=Edit(report.span(column, column, line), " "),
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


def nested_too_deep(report: ScannerReport) -> Diagnostic | None:
    """More levels than the scanner reads, before they are counted."""
    if report.problem != SCANNER_TOO_DEEP:
        return None
    return report.error("R2B025", TOO_DEEP, TOO_DEEP_HELP)


_EXPLAINERS: tuple[Callable[[ScannerReport], Diagnostic | None], ...] = (
    nested_too_deep,
    tab_indentation,
    reserved_character,
    unclosed_quote,
    unclosed_bracket,
    stray_bracket,
    unexpected_colon,
    missing_colon,
    wrong_indentation,
    inline_list,
    invalid_escape,
    missing_anchor_name,
    document_marker,
)
"""Tried in this order; the first that recognises the report explains it."""


def explain_syntax_error(error: yaml.YAMLError, source: Source) -> Diagnostic:
    """The diagnostic for an error of PyYAML's scanner or parser."""
    mark = getattr(error, "problem_mark", None)
    problem_span = _span(source, mark.line, mark.column) if mark else Span.of_file(source.file)
    began_mark = getattr(error, "context_mark", None)
    context_span = _span(source, began_mark.line, began_mark.column) if began_mark else problem_span
    report = ScannerReport(
        problem=str(getattr(error, "problem", None) or error),
        context=str(getattr(error, "context", None) or ""),
        problem_span=problem_span,
        context_span=context_span,
        source=source,
    )
    for case in _EXPLAINERS:
        explanation = case(report)
        if explanation is not None:
            return explanation
    return report.error("R2B010", f"invalid YAML: {report.problem}", "check the lines above")


def _span(source: Source, line: int, column: int) -> Span:
    """The span of one character; a place past the end of the text is moved to its last line."""
    last = len(source.lines)
    while last > 1 and not source.lines[last - 1].strip():
        last -= 1
    if line >= last:
        line, column = last - 1, len(source.lines[last - 1].rstrip())
    return Span(source.file, line + 1, column + 1, line + 1, column + 2)
