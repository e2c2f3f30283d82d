"""Where findings go, and when they are coloured."""

from __future__ import annotations

import io

import pytest

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.report.findings_text import print_findings as show
from r2bspec.report.findings_text import wants_colour

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
