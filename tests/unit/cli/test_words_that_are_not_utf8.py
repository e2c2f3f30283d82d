"""What is typed may be any bytes; Python has those that are not UTF-8 as lone surrogates."""

from __future__ import annotations

from pathlib import Path

import pytest

from command_line import Call
from r2bspec.compare.history import open_history


@pytest.mark.parametrize(
    "words",
    [
        ("history", "accept", "\udcff"),
        ("history", "prune", "--run", "\udcff"),
        ("history", "list", "--name", "\udcff"),
    ],
)
def test_a_name_of_a_run_that_is_not_utf8(
    words: tuple[str, ...], tmp_path: Path, call: Call
) -> None:
    file = tmp_path / "history.sqlite"
    with open_history(file, create=True):
        pass
    ended = call(*words, "--file", str(file))
    assert ended.status == 2
    assert "it is not UTF-8" in ended.err
    assert "  help: " in ended.err


@pytest.mark.parametrize("path", ["-", "", "\udcff", "/dev/zero", "benchmark.\u202e"])
def test_a_path_of_a_value_that_no_document_has(path: str, tmp_path: Path, call: Call) -> None:
    (tmp_path / "x.r2b.yaml").write_text("r2bspec: 1\nname: x\n")
    ended = call("plan", str(tmp_path / "x.r2b.yaml"), "--explain", path)
    assert ended.status == 2
    assert "  help: " in ended.err
