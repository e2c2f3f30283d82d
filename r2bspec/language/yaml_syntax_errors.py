"""YAML syntax errors: the parser's message at its place, with hints for the four usual mistakes.

The messages of libyaml and of PyYAML's pure Python scanner differ; both are recognised.
"""

from __future__ import annotations

import re

import yaml

from r2bspec.diagnostics import Diagnostic, Edit, Related, Span
from r2bspec.diagnostics.quote import clip
from r2bspec.language.document import Source
from r2bspec.safe_io.limits import MAX_YAML_DEPTH
from r2bspec.safe_io.safe_yaml import SCANNER_TOO_DEEP, too_deep

TOO_DEEP = too_deep(MAX_YAML_DEPTH)
TOO_DEEP_HELP = "look for an unclosed bracket or brace"

_GLUED = re.compile(r"(?P<indent>\s*(?:- +)*)(?P<key>[A-Za-z_]\w*:)(?P<value>[^\s:/].*)")
"""A key, a colon, and a value without a space between them."""


def explain_syntax_error(error: yaml.YAMLError, source: Source) -> Diagnostic:
    """Return the diagnostic for an error of PyYAML's scanner or parser."""
    problem = str(getattr(error, "problem", None) or error)
    context = str(getattr(error, "context", None) or "")
    span = _span(source, getattr(error, "problem_mark", None))
    began = _span(source, getattr(error, "context_mark", None), span)
    if problem == SCANNER_TOO_DEEP:
        return Diagnostic.error("R2B025", TOO_DEEP, span, TOO_DEEP_HELP)
    return (
        _tab(problem, span, source)
        or _unclosed(problem, context, span, began, source)
        or _missing_space(problem, span, began, source)
        or _missing_dash(problem, context, span, began, source)
        or Diagnostic.error(
            "R2B010",
            f"invalid YAML: {', '.join(filter(None, (context, problem)))}",
            span,
            "check this line and those above; quote text that contains ': ', or begins with a "
            "special character",
        )
    )


def _tab(problem: str, span: Span, source: Source) -> Diagnostic | None:
    at_tab = source.line(span.line)[span.column - 1 :].startswith("\t")
    if "tab character" in problem or ("start any token" in problem and at_tab):
        help_text = "indent with spaces, two per level"
        return Diagnostic.error("R2B011", "tab in the indentation", span, help_text)
    return None


def _unclosed(
    problem: str, context: str, span: Span, began: Span, source: Source
) -> Diagnostic | None:
    """Return a quote or a bracket without its end; the place is that of its beginning."""
    in_quotes = "unexpected end of stream" in problem or "document indicator" in problem
    if not in_quotes and "flow" not in context:
        return None
    opener = source.line(began.line)[began.column - 1 :][:1]
    if in_quotes:
        noun = "single quote" if opener == "'" else "double quote"
        return Diagnostic.error("R2B012", f"unclosed {noun}", began, f"close it with a {noun}")
    closer = "]" if opener == "[" else "}"
    return Diagnostic.error(
        "R2B012",
        f"unclosed '{opener}'",
        began,
        f"close it with '{closer}', and separate items by commas",
        related=(Related("the error is noticed here", span),),
    )


def _missing_space(problem: str, span: Span, began: Span, source: Source) -> Diagnostic | None:
    if "mapping values are not allowed" in problem:
        numbers = [span.line - 1]
    elif "could not find expected ':'" in problem:
        numbers = [began.line]
    else:
        return None
    for number in numbers:
        glued = _GLUED.match(source.line(number))
        if glued is not None:
            column = glued.start("value") + 1
            return Diagnostic.error(
                "R2B014",
                f"missing space after '{glued['key']}'",
                Span(span.file, number, column - 1, number, column),
                f"write '{glued['key']} {glued['value'].strip()}'",
                edit=Edit(Span(span.file, number, column, number, column), " "),
            )
    return None


def _missing_dash(
    problem: str, context: str, span: Span, began: Span, source: Source
) -> Diagnostic | None:
    above = source.line(began.line - 1) if began.line > 1 else ""
    if "could not find expected ':'" in problem and above.lstrip().startswith("- "):
        return Diagnostic.error(
            "R2B014",
            "expected another item of the list above",
            began,
            f"begin the line with '- ': '- {clip(source.line(began.line).strip().lstrip('-'))}'",
        )
    expected = ("did not find expected '-'", "expected <block end>")
    if not problem.startswith(expected) or "collection" not in context:
        return None
    return Diagnostic.error(
        "R2B014",
        "expected another item of the list above",
        span,
        "begin the line with '- ', or indent it like the keys above the list",
        related=(Related("the list starts here", began),),
    )


def _span(source: Source, mark: yaml.Mark | None, default: Span | None = None) -> Span:
    """Return the span of the character at a mark.

    One past the end of the text is moved to its end.
    """
    if mark is None:
        return default or Span.of_file(source.file)
    line, column = mark.line, mark.column
    last = len(source.lines)
    while last > 1 and not source.lines[last - 1].strip():
        last -= 1
    if line >= last:
        line, column = last - 1, len(source.lines[last - 1].rstrip())
    return Span(source.file, line + 1, column + 1, line + 1, column + 2)
