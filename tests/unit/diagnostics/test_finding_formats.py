"""Findings as text, JSON and workflow commands."""

from __future__ import annotations

import json as standard_json

import pytest

from r2bspec.diagnostics import Certainty, Diagnostic, Edit, Related, Severity, Span
from r2bspec.report.finding_formats import render
from r2bspec.report.findings_text import MAX_WIDTH, excerpt, render_text

SOURCES = {"a.yaml": "name: x\nrate: 30\n"}
FOUND = Diagnostic(
    "R2B109",
    Severity.ERROR,
    "30 has no unit",
    Span("a.yaml", 2, 7, 2, 9),
    path=("rates", 0),
    help="write 30 Hz",
    related=(Related("said here", Span("a.yaml", 1, 1, 1, 5)),),
    edit=Edit(Span("a.yaml", 2, 7, 2, 9), "30 Hz"),
    certainty=Certainty.ENVIRONMENT,
)


def test_text() -> None:
    assert render_text([FOUND, FOUND], SOURCES) == (
        """\
a.yaml:2:7: error[R2B109 missing-unit]: 30 has no unit
  |
2 | rate: 30
  |       ^^
  = help: write 30 Hz
  = a.yaml:1:1: said here
1 | name: x
  | ^^^^

"""
        * 2
    ).removesuffix("\n")


def test_text_without_the_source() -> None:
    assert render_text([FOUND], {}) == (
        "a.yaml:2:7: error[R2B109 missing-unit]: 30 has no unit\n  = help: write 30 Hz\n"
        "  = a.yaml:1:1: said here\n"
    )


def test_nothing_found() -> None:
    assert render_text([], SOURCES) == ""


def test_colour_only_when_asked() -> None:
    assert "\x1b" not in render_text([FOUND], SOURCES)
    coloured = render_text([FOUND], SOURCES, colour=True)
    assert "\x1b[31;1merror[R2B109 missing-unit]\x1b[0m" in coloured


def test_nothing_reaches_the_terminal_unescaped() -> None:
    nasty = Diagnostic("R", Severity.ERROR, "a\x1b[31mb", Span("f\x07", 1, 1, 1, 2), help="\x9b")
    shown = render_text([nasty], {"f\x07": "x\x1b]0;y\x07z"})
    assert all(char.isprintable() or char == "\n" for char in shown)


@pytest.mark.parametrize(
    ("line", "columns", "carets"),
    [
        ("abc", (2, 3), " ^"),
        ("abc", (2, 2), " ^"),  # a place without extent
        ("abc", (4, 4), "   ^"),  # behind the end
        ("abc", (9, 12), "   ^"),
        ("\tab", (2, 4), " ^^"),
        ("画像: x", (5, 6), "      ^"),
        ("画像: x", (1, 3), "^^^^"),
        ("e\u0301x", (3, 4), " ^"),
    ],
)
def test_carets(line: str, columns: tuple[int, int], carets: str) -> None:
    found = excerpt(Span("f", 1, columns[0], 1, columns[1]), line)
    assert found is not None
    assert found[1] == carets


def test_a_span_of_several_lines_is_marked_on_its_first() -> None:
    assert excerpt(Span("f", 1, 3, 2, 2), "a: b\nc") == ("a: b", "  ^^")


@pytest.mark.parametrize("start", [1, 50, 500, 995])
def test_long_lines_are_cut_around_the_place(start: int) -> None:
    line = "".join(str(index % 10) for index in range(1, 1001))
    found = excerpt(Span("f", 1, start, 1, start + 3), line)
    assert found is not None
    shown, carets = found
    assert len(shown) <= MAX_WIDTH
    marked = shown[len(carets) - 3 : len(carets)]
    assert marked == line[start - 1 : start + 2]


def test_a_line_that_is_not_there() -> None:
    assert excerpt(Span("f", 7, 1, 7, 2), "a") is None


def test_json() -> None:
    report = standard_json.loads(render("json", [FOUND], SOURCES))
    assert (report["version"], report["errors"], report["warnings"]) == (1, 1, 0)
    (finding,) = report["findings"]
    assert (finding["code"], finding["slug"]) == ("R2B109", "missing-unit")
    assert finding["path"] == ["rates", 0]
    assert finding["edit"]["text"] == "30 Hz"
    assert finding["certainty"] == "environment"
    assert (finding["line"], finding["column"], finding["end_column"]) == (2, 7, 9)
    assert finding["related"][0]["line"] == 1


def test_github_escapes() -> None:
    found = Diagnostic(
        "R2B1", Severity.WARNING, "100 %, a: b\nc", Span("a,b:c.yaml", 1, 2, 1, 3), help="do it"
    )
    assert render("github", [found], {}) == (
        "::warning file=a%2Cb%3Ac.yaml,line=1,endLine=1,col=2,endColumn=3,title=R2B1::"
        "100 %25, a: b%0Ac%0Ado it\n"
    )


def test_github_shows_the_slug_in_the_title() -> None:
    assert ",title=R2B109 missing-unit::30 has no unit%0A" in render("github", [FOUND], SOURCES)


def test_github_keeps_ten_and_errors_first() -> None:
    warning = Diagnostic("W", Severity.WARNING, "w", Span("f", 1, 1, 1, 2))
    lines = render("github", [warning] * 9 + [FOUND] * 3, {}).splitlines()
    assert [line.split(" ")[0] for line in lines[:10]] == ["::error"] * 3 + ["::warning"] * 7
    assert lines[10:] == ["2 more findings are not annotated; see the log"]
