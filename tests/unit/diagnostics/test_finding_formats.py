"""Findings as text, JSON, workflow commands, JUnit XML and SARIF."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

import sarif_log
from nightly import sampled
from r2bspec.check import check
from r2bspec.diagnostics import Certainty, Diagnostic, Edit, Related, Severity, Span
from r2bspec.language.load_spec import load_spec
from r2bspec.report.finding_formats import render
from r2bspec.report.findings_text import MAX_WIDTH, code_with_slug, excerpt, render_text, slug_of

# Findings as text, JSON and workflow commands.


SOURCES = {"a.yaml": "name: x\nrate: 30\n"}


def missing_unit(file: str, line: int = 2) -> Diagnostic:
    return Diagnostic(
        "R2B109",
        Severity.ERROR,
        "30 has no unit",
        Span(file, line, 7, line, 9),
        path=("rates", 0),
        help="write 30 Hz",
        related=(Related("said here", Span(file, 1, 1, 1, 5)),),
        edit=Edit(Span(file, line, 7, line, 9), "30 Hz"),
        certainty=Certainty.ENVIRONMENT,
    )


FOUND = missing_unit("a.yaml")


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


def test_text_without_the_source_or_findings() -> None:
    assert render_text([FOUND], {}) == (
        "a.yaml:2:7: error[R2B109 missing-unit]: 30 has no unit\n  = help: write 30 Hz\n"
        "  = a.yaml:1:1: said here\n"
    )
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


@pytest.mark.parametrize("start", [1, 50, 500, 995])
def test_long_lines_are_cut_around_the_place(start: int) -> None:
    line = "".join(str(index % 10) for index in range(1, 1001))
    found = excerpt(Span("f", 1, start, 1, start + 3), line)
    assert found is not None
    shown, carets = found
    assert len(shown) <= MAX_WIDTH
    marked = shown[len(carets) - 3 : len(carets)]
    assert marked == line[start - 1 : start + 2]


def test_json() -> None:
    report = json.loads(render("json", [FOUND], SOURCES))
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


def test_github_keeps_ten_and_errors_first() -> None:
    warning = Diagnostic("W", Severity.WARNING, "w", Span("f", 1, 1, 1, 2))
    lines = render("github", [warning] * 9 + [FOUND] * 3, {}).splitlines()
    assert [line.split(" ")[0] for line in lines[:10]] == ["::error"] * 3 + ["::warning"] * 7
    assert lines[10:] == ["2 more findings are not annotated; see the log"]


# Findings as JUnit XML: a case for each file.


def found(code: str, severity: Severity, message: str = "wrong") -> Diagnostic:
    return Diagnostic(code, severity, message, Span("a.yaml", 3, 5, 3, 6), help="put it right")


def cases(*diagnostics: Diagnostic, files: tuple[str, ...] = ()) -> list[ET.Element]:
    return [*ET.fromstring(render("junit", diagnostics, {}, files)).iter("testcase")]  # noqa: S314


def test_the_errors_of_a_file_are_one_failure() -> None:
    one, two = found("R2B204", Severity.ERROR), found("R2B207", Severity.ERROR, "also")
    (case,) = cases(one, two, files=("a.yaml",))
    (failure,) = case
    assert failure.attrib == {"message": f"{slug_of('R2B204')}: wrong", "type": "R2B204"}
    assert failure.text is not None
    assert failure.text.splitlines() == [
        f"a.yaml:3:5: error[{code_with_slug('R2B204')}]: wrong (put it right)",
        f"a.yaml:3:5: error[{code_with_slug('R2B207')}]: also (put it right)",
    ]


# SARIF: valid by the standard, and what code scanning needs is in it.


GOLDEN = Path(__file__).parents[2] / "golden"
BROKEN = sorted([*(GOLDEN / "language").glob("*.yaml"), *(GOLDEN / "check").glob("*.yaml")])

MISSING_UNIT = missing_unit("a b.yaml")


def log_of(*found: Diagnostic, names: tuple[str, ...] = ()) -> dict[str, Any]:
    """The log; it is as the standard demands."""
    text = render("sarif", found, {}, names)
    sarif_log.decode(text)
    log: dict[str, Any] = json.loads(text)
    return log


@pytest.mark.parametrize(
    "file", sampled(BROKEN, 5), ids=lambda file: f"{file.parent.name}/{file.stem}"
)
def test_valid_by_the_standard(file: Path) -> None:
    loaded = load_spec(file.read_bytes(), file=file.name, environ={})
    found = check(loaded, offline=True)
    assert len(log_of(*found, names=(file.name,))["runs"][0]["results"]) == len(found)


def test_a_result() -> None:
    run = log_of(MISSING_UNIT)["runs"][0]
    (result,) = run["results"]
    assert (result["ruleId"], result["level"]) == ("R2B109", "error")
    assert result["message"]["text"] == "30 has no unit; write 30 Hz"
    (place,) = result["locations"]
    physical = place["physicalLocation"]
    assert physical["artifactLocation"]["uri"] == "a%20b.yaml"
    assert physical["region"] == {"startLine": 2, "startColumn": 7, "endLine": 2, "endColumn": 9}
    assert result["relatedLocations"][0]["message"]["text"] == "said here"
    assert result["properties"] == {"certainty": "environment"}
    rule = run["tool"]["driver"]["rules"][result["ruleIndex"]]
    assert rule["id"] == "R2B109"
    assert rule["name"] == "missing-unit"
    assert rule["shortDescription"]["text"]


def test_a_fingerprint_does_not_change_with_the_line() -> None:
    lower = missing_unit("a b.yaml", 9)
    first, second = log_of(MISSING_UNIT, lower)["runs"][0]["results"]
    assert first["partialFingerprints"] == second["partialFingerprints"]


def test_a_place_outside_of_the_folder_is_an_address() -> None:
    away = Diagnostic("R2B001", Severity.WARNING, "x", Span("/tmp/a.yaml", 1, 1, 1, 1))  # noqa: S108
    (result,) = log_of(away)["runs"][0]["results"]
    place = result["locations"][0]["physicalLocation"]["artifactLocation"]
    assert place == {"uri": "file:///tmp/a.yaml"}
