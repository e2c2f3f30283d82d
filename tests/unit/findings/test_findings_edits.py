"""Edits: only the characters that they name change, and rounds end."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from r2bspec.diagnostics import Diagnostic, Edit, Severity, Span
from r2bspec.diagnostics.edits import MAX_ROUNDS, apply_edits, fix, unified_diff

TEXT = "a: 1  # one\r\nb: '2'\r\n\r\nc: 3"


def edit(line: int, start: int, end: int, text: str, file: str = "f") -> Edit:
    return Edit(Span(file, line, start, line, end), text)


def found(one: Edit, code: str = "R2B109") -> Diagnostic:
    return Diagnostic(code, Severity.ERROR, "wrong", one.span, edit=one)


def test_comments_and_line_ends_stay() -> None:
    edits = [edit(4, 4, 5, "30"), edit(1, 4, 5, "10")]
    assert apply_edits(TEXT, edits) == "a: 10  # one\r\nb: '2'\r\n\r\nc: 30"


def test_an_insertion_and_a_deletion() -> None:
    assert apply_edits(TEXT, [edit(1, 2, 2, "x"), edit(2, 4, 5, "")]).startswith(
        "ax: 1  # one\r\nb: 2'\r\n"
    )


def test_of_edits_that_overlap_only_the_first_is_made() -> None:
    assert apply_edits("abcdef", [edit(1, 1, 4, "X"), edit(1, 3, 6, "Y")]) == "Xdef"
    assert apply_edits("abcdef", [edit(1, 2, 2, "X"), edit(1, 2, 2, "Y")]) == "aXbcdef"


def test_the_same_edit_twice_is_made_once() -> None:
    assert apply_edits("abc", [edit(1, 1, 2, "X")] * 2) == "Xbc"


def test_places_that_the_text_does_not_have_are_left_alone() -> None:
    edits = [edit(0, 1, 1, "X"), edit(9, 1, 1, "X"), edit(1, 9, 12, "X"), edit(1, 3, 2, "X")]
    assert apply_edits("abc", edits) == "abc"


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
    assert (fixed.text, len(fixed.applied), fixed.remaining) == ("bbbb", 4, ())


def test_repairs_that_undo_each_other_end() -> None:
    def look(text: str) -> list[Diagnostic]:
        return [found(edit(1, 1, 2, "b" if text == "a" else "a"))]

    assert fix("a", "f", look).text == "b"


def test_repairs_that_never_end_are_cut_off() -> None:
    fixed = fix("a", "f", lambda _: [found(edit(1, 1, 1, "a"))])
    assert fixed.text == "a" * (MAX_ROUNDS + 1)


def test_other_files_are_left_alone() -> None:
    fixed = fix("a", "f", lambda _: [found(edit(1, 1, 2, "b", file="g"))])
    assert (fixed.text, fixed.applied, len(fixed.remaining)) == ("a", (), 1)


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
