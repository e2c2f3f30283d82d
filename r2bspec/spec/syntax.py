"""Why a text is not YAML, in plain words.

PyYAML tells what its scanner expected; people want to know what they did. Each case below turns
the scanner's report, and the text around it, into a cause and a way out. The texts of libyaml and
of PyYAML's pure Python scanner differ, so that both are looked for.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import yaml

from r2bspec.diagnostics import Diagnostic, Edit, Related, Severity, Span
from r2bspec.spec.source import Source


@dataclass(frozen=True, slots=True)
class _Report:
    """The scanner's report: where it gave up, what it was reading, and the text there."""

    problem: str
    context: str
    place: Span
    began: Span
    source: Source

    @property
    def line(self) -> str:
        return self.source.line(self.place.line)

    @property
    def rest(self) -> str:
        """The text of the line from the place on."""
        return self.line[self.place.column - 1 :]

    @property
    def before(self) -> str:
        """The text of the line up to the place."""
        return self.line[: self.place.column - 1]

    def error(
        self,
        code: str,
        message: str,
        help_text: str,
        *,
        span: Span | None = None,
        related: tuple[Related, ...] = (),
        edit: Edit | None = None,
    ) -> Diagnostic:
        return Diagnostic(
            code,
            Severity.ERROR,
            message,
            span or self.place,
            help=help_text,
            related=related,
            edit=edit,
        )


def explain_syntax_error(error: yaml.YAMLError, source: Source) -> Diagnostic:
    """The diagnostic for an error of PyYAML's scanner or parser."""
    mark = getattr(error, "problem_mark", None)
    place = _span(source, mark.line, mark.column) if mark else Span.of_file(source.file)
    began_mark = getattr(error, "context_mark", None)
    began = _span(source, began_mark.line, began_mark.column) if began_mark else place
    report = _Report(
        problem=str(getattr(error, "problem", None) or error),
        context=str(getattr(error, "context", None) or ""),
        place=place,
        began=began,
        source=source,
    )
    for case in _CASES:
        found = case(report)
        if found is not None:
            return found
    return report.error("R2B010", f"this is not YAML: {report.problem}", "look at the lines above")


def _span(source: Source, line: int, column: int) -> Span:
    """One character; a place past the end of the text becomes the end of its last line."""
    last = len(source.lines)
    while last > 1 and not source.lines[last - 1].strip():
        last -= 1
    if line >= last:
        line, column = last - 1, len(source.lines[last - 1].rstrip())
    return Span(source.file, line + 1, column + 1, line + 1, column + 2)


def _tab(report: _Report) -> Diagnostic | None:
    at_tab = report.rest.startswith("\t") and "start any token" in report.problem
    if not at_tab and "tab character" not in report.problem:
        return None
    indent = re.match(r"[ \t]*", report.line)
    width = len(indent[0]) if indent is not None else 0
    span = Span(report.place.file, report.place.line, 1, report.place.line, width + 1)
    return report.error(
        "R2B011",
        "a tab stands where the indentation is counted",
        "indent with spaces, two for each level",
        span=span if "\t" in report.line[:width] else None,
    )


def _reserved(report: _Report) -> Diagnostic | None:
    if "start any token" not in report.problem:
        return None
    char = report.rest[:1]
    word = _word(report.rest)
    span = report.place
    span = Span(span.file, span.line, span.column, span.line, span.column + max(len(word), 1))
    text = f'"{word}"'
    simple = word and not set(word) & {'"', "\\"}
    return report.error(
        "R2B013",
        f"an unquoted value cannot begin with '{char}'",
        f"quote it: {text}" if simple else "quote the value",
        span=span,
        edit=Edit(span, text) if simple else None,
    )


def _unclosed_quote(report: _Report) -> Diagnostic | None:
    ended = "unexpected end of stream" in report.problem
    if not ended and "document indicator" not in report.problem:
        return None
    mark = report.source.line(report.began.line)[report.began.column - 1 :][:1]
    return report.error(
        "R2B012",
        f"the quote {mark} that opens here is never closed",
        f"close it with {mark}; inside single quotes, write '' for an apostrophe"
        if mark == "'"
        else f"close it with {mark}",
        span=report.began,
    )


def _unclosed_bracket(report: _Report) -> Diagnostic | None:
    """A flow list or map that meets something else than a comma or its own end."""
    if "flow" not in report.context:
        return None
    at_end = not report.rest.strip() or "stream end" in report.problem
    opener = report.source.line(report.began.line)[report.began.column - 1 :][:1]
    if opener not in ("[", "{"):
        if not at_end:
            return None
        return report.error(
            "R2B012",
            "the file ends inside a list or a map in brackets",
            "close it with ']' or '}'",
        )
    closer = {"[": "]", "{": "}"}[opener]
    if report.rest[:1] in "]}" and report.rest[:1] and report.rest[:1] != closer:
        return report.error(
            "R2B012",
            f"'{report.rest[:1]}' cannot close what '{opener}' opened",
            f"write '{closer}'",
            related=(Related("opened here", report.began),),
        )
    if at_end or report.place.line != report.began.line:
        return report.error(
            "R2B012",
            f"the '{opener}' that opens here is not closed before what follows",
            f"close it with '{closer}', and put a comma between its items",
            span=report.began,
            related=(Related("the text stops making sense here", report.place),),
        )
    return report.error(
        "R2B012",
        f"a ',' or '{closer}' is missing before this",
        f"put a comma between the items, and close with '{closer}'; quote a value that holds a "
        "bracket, a brace or a comma",
        related=(Related("opened here", report.began),),
    )


def _stray_bracket(report: _Report) -> Diagnostic | None:
    if report.rest[:1] not in ("]", "}", ","):
        return None
    return report.error(
        "R2B012",
        f"nothing is open that '{report.rest[:1]}' could close"
        if report.rest[:1] != ","
        else "a value is missing before this comma",
        "remove it, or quote the value if it belongs to the text",
    )


def _colon(report: _Report) -> Diagnostic | None:
    if "mapping values are not allowed" not in report.problem:
        return None
    key = re.match(r"\s*(?:- +)*([^\s:#'\"\[{][^:#]*?)\s*:(?:\s|$)", report.before)
    if key is not None and report.before[key.end() :].strip():
        start, value = key.end(), report.line[key.end() :].rstrip()
        start += len(value) - len(value.lstrip())
        value = value.strip()
        span = Span(
            report.place.file, report.place.line, start + 1, report.place.line, len(value) + start
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
    above = _line_above(report)
    no_space = re.match(r"\s*(?:- +)*([A-Za-z_]\w*):(\S.*)", above[1])
    if no_space is not None:
        number, text = above
        column = no_space.start(2) + 1
        return report.error(
            "R2B014",
            f"a space is missing after '{no_space[1]}:'",
            f"write '{no_space[1]}: {no_space[2].strip()}'",
            span=Span(report.place.file, number, column - 1, number, column),
            edit=Edit(Span(report.place.file, number, column, number, column), " "),
        )
    if _indent(report.line) > _indent(above[1]) and above[1].strip():
        return report.error(
            "R2B015",
            "this line is indented as if it belonged to the one above, which has a value already",
            "indent it like the line above, or move that line's value into a line of its own",
            span=_words(report),
            related=(Related("the line above", _content(report, above[0])),),
        )
    return report.error("R2B014", "a ':' is not expected here", "quote the value that holds it")


def _no_colon(report: _Report) -> Diagnostic | None:
    if "could not find expected ':'" not in report.problem:
        return None
    text = report.source.line(report.began.line)[report.began.column - 1 :].rstrip()
    span = Span(
        report.began.file,
        report.began.line,
        report.began.column,
        report.began.line,
        report.began.column + max(len(text), 1),
    )
    return report.error(
        "R2B014",
        "this line is neither a key with a ':' nor a part of the value above",
        "write 'key: value', or indent it to continue the value above",
        span=span,
    )


def _indentation(report: _Report) -> Diagnostic | None:
    expected = ("did not find expected key", "did not find expected '-'", "expected <block end>")
    if not report.problem.startswith(expected):
        return None
    quoted = re.search(r"(['\"])\s*$", report.before)
    if quoted is not None and report.before.strip():
        return report.error(
            "R2B012",
            "text follows the closing quote",
            "quote the whole value; inside single quotes, write '' for an apostrophe",
            span=_words(report),
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
            span=_words(report),
            related=(Related("the list begins here", report.began),),
        )
    return report.error(
        "R2B015",
        "the indentation of this line matches none of the levels above it",
        "indent it exactly like the other keys of its map",
        span=_words(report),
        related=(Related("the map around it begins here", report.began),),
    )


def _list_in_line(report: _Report) -> Diagnostic | None:
    if "sequence entries are not allowed" not in report.problem:
        return None
    return report.error(
        "R2B014",
        "a '- ' cannot follow a key on the same line",
        "put the list on the next lines, or write it as [a, b]; quote a value that begins with "
        "a dash",
    )


def _escape(report: _Report) -> Diagnostic | None:
    if "escape character" not in report.problem and "hexdecimal" not in report.problem:
        return None
    # libyaml points to the backslash, the Python scanner behind it.
    column = report.place.column if report.rest.startswith("\\") else report.place.column - 1
    span = Span(report.place.file, report.place.line, column, report.place.line, column + 2)
    shown = report.line[column - 1 : column + 1]
    return report.error(
        "R2B016",
        f"'{shown}' is no escape that YAML knows",
        "write a backslash as \\\\, or use single quotes, which know no escapes",
        span=span,
    )


def _name_missing(report: _Report) -> Diagnostic | None:
    if "alphabetic or numeric" not in report.problem:
        return None
    char = "*" if "alias" in report.context else "&"
    return report.error(
        "R2B013",
        f"an unquoted value cannot begin with '{char}', which marks an "
        f"{'alias' if char == '*' else 'anchor'}",
        "quote the value",
        span=report.began,
    )


def _document(report: _Report) -> Diagnostic | None:
    if "<document start>" in report.problem:
        return report.error(
            "R2B021",
            "text follows the end of the document",
            "a file holds one document; remove the '...' or '---' above",
            span=_words(report),
        )
    if "incompatible YAML" in report.problem:
        return report.error(
            "R2B010", "this version of YAML is not known", "remove the %YAML line"
        )
    if "tag" in report.context or "tag" in report.problem:
        return report.error(
            "R2B022",
            "tags, which begin with '!', are not part of the language",
            "remove it, or quote the value",
            span=report.began,
        )
    if "block scalar" in report.context:
        return report.error(
            "R2B010",
            "after '|' or '>' the text begins on the next line",
            "move the text to the next line, or quote the value",
        )
    return None


_CASES: tuple[Callable[[_Report], Diagnostic | None], ...] = (
    _tab,
    _reserved,
    _unclosed_quote,
    _unclosed_bracket,
    _stray_bracket,
    _colon,
    _no_colon,
    _indentation,
    _list_in_line,
    _escape,
    _name_missing,
    _document,
)


def _word(text: str) -> str:
    """The value that begins here, up to a comment, or within brackets up to the next mark."""
    return re.split(r"\s+#|[,\]}]", text, maxsplit=1)[0].rstrip()


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _line_above(report: _Report) -> tuple[int, str]:
    """The nearest line above that has content, and its number."""
    for number in range(report.place.line - 1, 0, -1):
        text = report.source.line(number)
        if text.strip() and not text.lstrip().startswith("#"):
            return number, text
    return report.place.line, ""


def _content(report: _Report, number: int) -> Span:
    text = report.source.line(number)
    return Span(report.place.file, number, _indent(text) + 1, number, len(text.rstrip()) + 1)


def _words(report: _Report) -> Span:
    """The content of the line from the place on."""
    start = report.place.column
    end = start + max(len(report.rest.rstrip()), 1)
    return Span(report.place.file, report.place.line, start, report.place.line, end)
