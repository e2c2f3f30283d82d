"""What findings propose: edits, waivers, names that were meant."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from example_spec import example
from r2bspec.check import check
from r2bspec.diagnostics import Diagnostic, Edit, Severity, Span, format_path
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.diagnostics.edits import apply_edits, fix, unified_diff
from r2bspec.diagnostics.waivers import apply_waivers, waivers_in
from r2bspec.language.load_spec import load_spec

# Edits: only the characters that they name change, and rounds end.


TEXT = "a: 1  # one\r\nb: '2'\r\n\r\nc: 3"


def edit(line: int, start: int, end: int, text: str, file: str = "f") -> Edit:
    return Edit(Span(file, line, start, line, end), text)


def found(one: Edit, code: str = "R2B109") -> Diagnostic:
    return Diagnostic(code, Severity.ERROR, "wrong", one.span, edit=one)


def test_comments_and_line_ends_stay() -> None:
    edits = [edit(4, 4, 5, "30"), edit(1, 4, 5, "10")]
    assert apply_edits(TEXT, edits) == "a: 10  # one\r\nb: '2'\r\n\r\nc: 30"


def test_of_edits_that_overlap_only_the_first_is_made() -> None:
    assert apply_edits("abcdef", [edit(1, 1, 4, "X"), edit(1, 3, 6, "Y")]) == "Xdef"
    assert apply_edits("abcdef", [edit(1, 2, 2, "X"), edit(1, 2, 2, "Y")]) == "aXbcdef"


@given(st.text("ab\n\r\u2028é", max_size=30), st.data())
def test_what_is_outside_of_an_edit_stays(text: str, data: st.DataObject) -> None:
    from r2bspec.diagnostics.diagnostic import split_lines

    lines = split_lines(text)
    number = data.draw(st.integers(1, len(lines)))
    width = len(lines[number - 1])
    start = data.draw(st.integers(1, width + 1))
    end = data.draw(st.integers(start, width + 1))
    after = split_lines(apply_edits(text, [edit(number, start, end, "X")]))
    line = lines[number - 1]
    assert after == [
        *lines[: number - 1], line[: start - 1] + "X" + line[end - 1 :], *lines[number:]
    ]  # fmt: skip


def test_overlapping_repairs_take_turns() -> None:
    """Each round looks again, so what did not fit is repaired in the next."""

    def look(text: str) -> list[Diagnostic]:
        return [found(edit(1, at + 1, at + 2, "b")) for at, char in enumerate(text) if char == "a"]

    fixed = fix("aaaa", "f", look)
    assert (fixed.text, len(fixed.applied)) == ("bbbb", 4)


def test_repairs_that_undo_each_other_end() -> None:
    def look(text: str) -> list[Diagnostic]:
        return [found(edit(1, 1, 2, "b" if text == "a" else "a"))]

    assert fix("a", "f", look).text == "b"


def test_no_repair_makes_a_document_unreadable() -> None:
    def look(text: str) -> list[Diagnostic]:
        if text == "[":
            return [Diagnostic("R2B012", Severity.ERROR, "open", Span("f", 1, 1, 1, 2))]
        return [found(edit(1, 1, 2, "["))]

    assert fix("a", "f", look).text == "a"


def test_a_difference_says_where_a_last_line_has_no_end() -> None:
    assert unified_diff("a\nb", "a\nc", "/x/f").splitlines() == [
        "--- a/x/f",
        "+++ b/x/f",
        "@@ -1,2 +1,2 @@",
        " a",
        "-b",
        "\\ No newline at end of file",
        "+c",
        "\\ No newline at end of file",
    ]
    assert unified_diff("a", "a", "f") == ""


# Waivers in comments: what they waive, and what is wrong with them.


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
    document = example(
        playback="{inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}, buffer: 1}"
    )
    assert [one.code for one in check(load_spec(document))] == ["R2B323"]
    waived = document.replace("buffer: 1}", "buffer: 1} # r2bspec: ignore[R2B323] on purpose")
    assert check(load_spec(waived)) == []
    by_slug = waived.replace("R2B323", all_pages()["R2B323"].slug)
    assert check(load_spec(by_slug)) == []
    assert check(load_spec(waived), offline=True) == []


def test_a_waiver_hides_no_other_file() -> None:
    other = Diagnostic("R2B204", Severity.ERROR, "wrong", Span("g", 1, 3, 1, 4))
    text = "a: 1 # r2bspec: ignore[R2B204] because"
    judged = apply_waivers([other], {"f": text, "g": "a: 1"}, known=lambda: SLUGS, complete=False)
    assert judged == [other]


# Small helpers of diagnostics.


def test_paths_read_as_they_are_addressed() -> None:
    path = ("data_loader", "topics", "/a/b", 0, "my-key")
    assert format_path(path) == "data_loader.topics['/a/b'][0].my-key"
