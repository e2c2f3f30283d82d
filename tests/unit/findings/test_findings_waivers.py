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


ABOVE = "x: 0\n# r2bspec: ignore[R2B204] because\n# more about it\na: 1\nb: 1\n"
BEHIND = "x: 0 # r2bspec: ignore[R2B204] because\na: 1\n"
NOTHING_WAIVED = ["1 R2B204", "1 R2B040"]


@pytest.mark.parametrize(
    ("text", "found", "expected"),
    [
        ("a: 1 # r2bspec: ignore[R2B204] because", [finding(1)], []),
        ("a: 1 #r2bspec:ignore[ r2b204 ]: because", [finding(1)], []),
        # A comment above speaks of the next line with content, one behind a value of its own.
        (ABOVE, [finding(4)], []),
        (ABOVE, [finding(5)], ["5 R2B204", "2 R2B042"]),
        (ABOVE, [finding(1)], ["1 R2B204", "2 R2B042"]),
        (BEHIND, [finding(2)], ["2 R2B204", "1 R2B042"]),
        *(
            (f"a: 1 # r2bspec: {comment}", [finding(1)], NOTHING_WAIVED)
            for comment in ("ignore[R2B204]  ", "ignore R2B204 because", "ignore", "ignore[]")
        ),
        # A slug is as good as a code.
        (
            "a: 1 # r2bspec: ignore[Topic-Without-Publisher, remapping-matches-nothing] because",
            [finding(1, "R2B207"), finding(1, "R2B204")],
            [],
        ),
        ("a: 1 # r2bspec: ignore[topic-without-publisher] x", [finding(1, "R2B207")], []),
        (
            "a: 1 # r2bspec: ignore[topic-without-publisher]",
            [finding(1, "R2B207")],
            ["1 R2B207", "1 R2B040"],
        ),
        # Errors that make the document unusable cannot be waived.
        ("a: 1 # r2bspec: ignore[unknown-key] x", [finding(1, "R2B101")], ["1 R2B101", "1 R2B043"]),
        ("a: 1 # r2bspec: ignore[R2B101] x", [finding(1, "R2B101")], ["1 R2B101", "1 R2B043"]),
        ("a: 1 # r2bspec: ignore[R2B101] x", [finding(1, "R2B101", Severity.WARNING)], []),
        # What is unused, unless it depends on the machine.
        ("a: 1 # r2bspec: ignore[R2B204] because", [], ["1 R2B042"]),
        ("a: 1 # r2bspec: ignore[R2B302] the bag is on the robot", [], []),
    ],
)
def test_what_is_left(text: str, found: list[Diagnostic], expected: list[str]) -> None:
    assert left(text, *found) == expected


def test_nothing_is_unused_where_not_all_was_looked_at() -> None:
    text = "a: 1 # r2bspec: ignore[R2B207, R2B204] because"
    assert left(text, finding(1), complete=False) == []


@pytest.mark.parametrize(
    ("written", "meant"),
    [("R2B2004", "R2B204"), ("topic-without-publsher", "topic-without-publisher")],
)
def test_an_unknown_code_is_reported_with_the_close_one(written: str, meant: str) -> None:
    (found,) = apply_waivers(
        [], {"f": f"# r2bspec: ignore[{written}] x"}, known=lambda: SLUGS, complete=True
    )
    assert (found.code, found.span.column) == ("R2B041", 19)
    assert found.span.end_column == 19 + len(written)
    assert f"'{written}'" in found.message
    assert f"did you mean {meant}?" in found.help


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
