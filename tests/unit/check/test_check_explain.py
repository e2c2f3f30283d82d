"""``r2bspec explain``: what a code means."""

from __future__ import annotations

import pytest

from r2bspec.check.pages import all_pages
from r2bspec.cli.main import main


def test_a_page_has_title_reason_and_both_examples(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "R2B204"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("R2B204: remapping matches no topic of the node (error)\n")
    assert "ROS ignores a remapping that matches no topic" in said
    assert "remappings: {inptu: image}" in said
    assert "example.r2b.yaml:9:20: error[R2B204]" in said
    assert "remappings: {input: image}" in said
    assert "\x1b" not in said


@pytest.mark.parametrize("code", ["r2b204", "204", "R2B204"])
def test_a_code_may_be_written_in_short(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", code]) == 0
    assert capsys.readouterr().out.startswith("R2B204")


def test_without_a_code_all_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain"]) == 0
    said = capsys.readouterr().out
    for code, page in all_pages().items():
        assert f"  {code}  " in said
        assert page.title in said


def test_an_unknown_code_is_answered_with_a_close_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "R2B2044"]) == 2
    said = capsys.readouterr().err
    assert "error[R2B601]: there is no code 'R2B2044'" in said
    assert "did you mean R2B204?" in said


@pytest.mark.parametrize("code", [code for code, page in all_pages().items()])
def test_every_page_can_be_shown(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", code]) == 0
    said = capsys.readouterr().out
    assert code in said
    assert all(char.isprintable() or char == "\n" for char in said)
