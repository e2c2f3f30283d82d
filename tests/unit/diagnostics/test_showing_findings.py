"""Where findings go, and when they are coloured."""

from __future__ import annotations

import io

import pytest

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.report.findings_text import MAX_SHOWN, render_text, wants_colour
from r2bspec.report.findings_text import print_findings as show

FOUND = Diagnostic("R2B101", Severity.ERROR, "wrong", Span("f", 1, 1, 1, 2))


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("NO_COLOR", "CI", "TERM"):
        monkeypatch.delenv(name, raising=False)


def test_standard_error_by_default(capsys: pytest.CaptureFixture[str]) -> None:
    show([FOUND], {})
    out, err = capsys.readouterr()
    assert (out, err) == ("", "f:1:1: error[R2B101 unknown-key]: wrong\n")


def test_colour_on_a_terminal_only() -> None:
    terminal, file = Terminal(), io.StringIO()
    show([FOUND], {}, terminal)
    show([FOUND], {}, file)
    assert "\x1b" in terminal.getvalue()
    assert "\x1b" not in file.getvalue()


@pytest.mark.parametrize(("name", "value"), [("NO_COLOR", "1"), ("CI", "true"), ("TERM", "dumb")])
def test_the_environment_may_forbid_it(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    monkeypatch.setenv(name, value)
    assert not wants_colour(Terminal())


def test_of_very_many_findings_the_errors_are_shown() -> None:
    def at(line: int, severity: Severity, file: str = "f") -> Diagnostic:
        return Diagnostic("R2B101", severity, "wrong", Span(file, line, 1, line, 2))

    warnings = [at(line, Severity.WARNING) for line in range(1, 2 * MAX_SHOWN)]
    errors = [at(line, Severity.ERROR) for line in range(1000, 1003)]
    text = render_text([*warnings, *errors, at(1, Severity.ERROR, "g")], {})
    places = [line.partition(": ")[0] for line in text.splitlines() if ": " in line]
    shown = [f"f:{line}:1" for line in [*range(1, MAX_SHOWN - 2), 1000, 1001, 1002]]
    assert places == [*shown, "f", "g:1:1"]
    assert f"f: {MAX_SHOWN + 2} warnings more; 'r2bspec validate --format json' lists" in text
    many = [at(line, Severity.ERROR) for line in range(MAX_SHOWN)]
    assert "more;" not in render_text(many, {})
    assert "1 error and 1 warning more" in render_text([warnings[0], *many, errors[0]], {})
