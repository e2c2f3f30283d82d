"""``r2bspec explain``: what a code means."""

from __future__ import annotations

import pytest

from command_line import Call
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.report.findings_text import code_with_slug


def test_a_page_has_title_reason_and_both_examples(call: Call) -> None:
    said = call("explain", "R2B204", status=0).out
    assert said.startswith(
        f"{code_with_slug('R2B204')}: remapping matches no topic of the node (error)\n"
    )
    assert "ROS ignores a remapping that matches no topic" in said
    assert "remappings: {inptu: image}" in said
    assert f"example.r2b.yaml:9:20: error[{code_with_slug('R2B204')}]" in said
    assert "remappings: {input: image}" in said
    assert "\x1b" not in said


@pytest.mark.parametrize(
    ("written", "code"),
    [("r2b204", "R2B204"), ("204", "R2B204"), ("unknown-key", "R2B101"), ("Unknown_Key", "R2B101")],
)
def test_a_code_may_be_written_in_short_and_a_slug_is_as_good(
    written: str, code: str, call: Call
) -> None:
    explained = call("explain", written, status=0).out
    assert explained == call("explain", code, status=0).out
    assert explained.startswith(code_with_slug(code))


def test_every_page_is_shown_by_its_slug(call: Call) -> None:
    for code, page in all_pages().items():
        said = call("explain", page.slug, status=0).out
        assert said.startswith(f"{code} {page.slug}: ")
        assert all(char.isprintable() or char == "\n" for char in said)


def test_without_a_code_all_are_listed(call: Call) -> None:
    said = call("explain", status=0).out
    for code, page in all_pages().items():
        assert f"  {code}  " in said
        assert f"  {page.slug}  " in said
        assert page.title in said


@pytest.mark.parametrize(
    ("written", "meant"),
    [("R2B2044", "R2B204"), ("unknown-kye", "unknown-key"), ("R2B999", ""), ("R2B658x9", "")],
)
def test_an_unknown_word_is_answered_with_a_close_one(written: str, meant: str, call: Call) -> None:
    said = call("explain", written, status=2).err
    assert f"error[R2B601 wrong-usage]: unknown code '{written}'" in said
    assert (f"did you mean {meant}?" in said) if meant else ("did you mean" not in said)
