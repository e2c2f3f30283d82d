"""``r2bspec explain``: what a code means."""

from __future__ import annotations

import pytest

from r2bspec.cli.main import main
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.report.findings_text import code_with_slug


def test_a_page_has_title_reason_and_both_examples(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "R2B204"]) == 0
    said = capsys.readouterr().out
    assert said.startswith(
        f"{code_with_slug('R2B204')}: remapping matches no topic of the node (error)\n"
    )
    assert "ROS ignores a remapping that matches no topic" in said
    assert "remappings: {inptu: image}" in said
    assert f"example.r2b.yaml:9:20: error[{code_with_slug('R2B204')}]" in said
    assert "remappings: {input: image}" in said
    assert "\x1b" not in said


@pytest.mark.parametrize("code", ["r2b204", "204", "R2B204"])
def test_a_code_may_be_written_in_short(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", code]) == 0
    assert capsys.readouterr().out.startswith("R2B204")


@pytest.mark.parametrize("slug", ["unknown-key", "Unknown_Key"])
def test_a_slug_is_as_good_as_its_code(slug: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", slug]) == 0
    by_slug = capsys.readouterr().out
    assert main(["explain", "R2B101"]) == 0
    assert by_slug == capsys.readouterr().out
    assert by_slug.startswith("R2B101 unknown-key: ")


def test_every_slug_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    for code, page in all_pages().items():
        if not page.failing:
            assert main(["explain", page.slug]) == 0
            assert capsys.readouterr().out.startswith(f"{code} {page.slug}: ")


def test_without_a_code_all_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain"]) == 0
    said = capsys.readouterr().out
    for code, page in all_pages().items():
        assert f"  {code}  " in said
        assert f"  {page.slug}  " in said
        assert page.title in said


def test_an_unknown_code_is_answered_with_a_close_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "R2B2044"]) == 2
    said = capsys.readouterr().err
    assert "error[R2B601 wrong-usage]: unknown code 'R2B2044'" in said
    assert "did you mean R2B204?" in said


def test_an_unknown_slug_is_answered_with_a_close_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "unknown-kye"]) == 2
    said = capsys.readouterr().err
    assert "error[R2B601 wrong-usage]: unknown code 'unknown-kye'" in said
    assert "did you mean unknown-key?" in said


@pytest.mark.parametrize("code", [code for code, page in all_pages().items()])
def test_every_page_can_be_shown(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", code]) == 0
    said = capsys.readouterr().out
    assert code in said
    assert all(char.isprintable() or char == "\n" for char in said)


@pytest.mark.parametrize("code", ["R2B999", "R2B299", "R2B658x9"])
def test_a_code_that_is_not_near_any_other_has_no_suggestion(
    code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", code]) == 2
    assert "did you mean" not in capsys.readouterr().err
