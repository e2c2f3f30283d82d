"""Waivers in comments: what they waive, and what is wrong with them."""

from __future__ import annotations

import pytest

from example_spec import example
from r2bspec.check import check
from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.diagnostics.waivers import apply_waivers, waivers_in
from r2bspec.language.load_spec import load_spec

SLUGS = {
    "R2B204": "remapping-matches-nothing",
    "R2B207": "topic-without-publisher",
    "R2B302": "bag-metadata-unreadable",
    "R2B101": "unknown-key",
}


def finding(line: int, code: str = "R2B204", severity: Severity = Severity.ERROR) -> Diagnostic:
    return Diagnostic(code, severity, "wrong", Span("f", line, 3, line, 4))


def left(text: str, *found: Diagnostic, complete: bool = True) -> list[str]:
    judged = apply_waivers(found, {"f": text}, known=lambda: SLUGS, complete=complete)
    return [f"{one.span.line} {one.code}" for one in judged]


@pytest.mark.parametrize(
    "text",
    [
        "a: 1 # r2bspec: ignore[R2B204] because",
        "a: 1 #r2bspec:ignore[ r2b204 ]: because",
        "a: 1 # r2bspec: ignore[R2B207, R2B204] because",
    ],
)
def test_a_finding_of_the_line_is_waived(text: str) -> None:
    assert left(text, finding(1), complete=False) == []


def test_a_comment_above_speaks_of_the_next_line_with_content() -> None:
    text = "x: 0\n# r2bspec: ignore[R2B204] because\n# more about it\na: 1\nb: 1\n"
    assert left(text, finding(4)) == []
    assert left(text, finding(5)) == ["5 R2B204", "2 R2B042"]
    assert left(text, finding(1)) == ["1 R2B204", "2 R2B042"]


def test_a_comment_behind_a_value_speaks_of_its_own_line_only() -> None:
    text = "x: 0 # r2bspec: ignore[R2B204] because\na: 1\n"
    assert left(text, finding(2)) == ["2 R2B204", "1 R2B042"]


@pytest.mark.parametrize(
    "comment",
    ["ignore[R2B204]", "ignore[R2B204]   ", "ignore R2B204 because", "ignore", "ignore[]"],
)
def test_without_code_or_reason_nothing_is_waived(comment: str) -> None:
    assert left(f"a: 1 # r2bspec: {comment}", finding(1)) == ["1 R2B204", "1 R2B040"]


def test_an_unknown_code_is_reported_with_the_close_one() -> None:
    (found,) = apply_waivers(
        [], {"f": "# r2bspec: ignore[R2B2004] x"}, known=lambda: SLUGS, complete=True
    )
    assert (found.code, found.span.column, found.span.end_column) == ("R2B041", 19, 26)
    assert "did you mean R2B204?" in found.help


def test_a_slug_waives_what_its_code_does() -> None:
    text = "a: 1 # r2bspec: ignore[Topic-Without-Publisher, remapping-matches-nothing] because"
    assert left(text, finding(1, "R2B207"), finding(1, "R2B204"), complete=False) == []
    assert left(text, finding(1, "R2B207")) == ["1 R2B042"]


def test_an_unknown_slug_is_reported_with_the_close_one() -> None:
    (found,) = apply_waivers(
        [], {"f": "# r2bspec: ignore[topic-without-publsher] x"}, known=lambda: SLUGS, complete=True
    )
    assert (found.code, found.span.column, found.span.end_column) == ("R2B041", 19, 41)
    assert "'topic-without-publsher'" in found.message
    assert "did you mean topic-without-publisher?" in found.help


def test_a_slug_without_a_reason_waives_nothing() -> None:
    text = "a: 1 # r2bspec: ignore[topic-without-publisher]"
    assert left(text, finding(1, "R2B207")) == ["1 R2B207", "1 R2B040"]


def test_a_slug_of_what_cannot_be_waived_waives_nothing() -> None:
    text = "a: 1 # r2bspec: ignore[unknown-key] because"
    assert left(text, finding(1, "R2B101")) == ["1 R2B101", "1 R2B043"]


def test_an_unused_waiver_is_reported_if_all_was_looked_at() -> None:
    text = "a: 1 # r2bspec: ignore[R2B204] because"
    assert left(text) == ["1 R2B042"]
    assert left(text, complete=False) == []


def test_what_depends_on_the_machine_is_never_unused() -> None:
    assert left("a: 1 # r2bspec: ignore[R2B302] the bag is on the robot") == []


def test_errors_that_make_the_document_unusable_cannot_be_waived() -> None:
    text = "a: 1 # r2bspec: ignore[R2B101] because"
    assert left(text, finding(1, "R2B101")) == ["1 R2B101", "1 R2B043"]
    assert left(text, finding(1, "R2B101", Severity.WARNING)) == []


@pytest.mark.parametrize(
    "text",
    [
        "a: '# r2bspec: ignore[R2B204] x'",
        'a: "b\n  # r2bspec: ignore[R2B204] x"',
        "a: |\n  # r2bspec: ignore[R2B204] x\n",
        "a: >-\n  text\n  # r2bspec: ignore[R2B204] x\nb: 1\n",
        "a: b# r2bspec: ignore[R2B204] x",
        "# r2bspec: ignored[R2B204] x",
    ],
)
def test_text_that_is_no_comment_is_no_waiver(text: str) -> None:
    assert list(waivers_in(text, "f")) == []


def test_a_comment_behind_a_block_of_text_is_a_waiver() -> None:
    text = "a: |\n  text\n# r2bspec: ignore[R2B204] x\nb: 1\n"
    assert [one.line for one in waivers_in(text, "f")] == [4]


def test_in_a_spec() -> None:
    document = example(benchmark="{rates: [30 Hz, 30 Hz]}")
    assert [one.code for one in check(load_spec(document))] == ["R2B512"]
    waived = f"{document.rstrip()} # r2bspec: ignore[R2B512] on purpose\n"
    assert check(load_spec(waived)) == []
    by_slug = waived.replace("R2B512", all_pages()["R2B512"].slug)
    assert check(load_spec(by_slug)) == []
    assert check(load_spec(waived), offline=True) == []


def test_a_waiver_hides_no_other_file() -> None:
    other = Diagnostic("R2B204", Severity.ERROR, "wrong", Span("g", 1, 3, 1, 4))
    text = "a: 1 # r2bspec: ignore[R2B204] because"
    judged = apply_waivers([other], {"f": text, "g": "a: 1"}, known=lambda: SLUGS, complete=False)
    assert judged == [other]
