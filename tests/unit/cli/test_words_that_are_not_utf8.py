"""What is typed may be any bytes; Python has those that are not UTF-8 as lone surrogates."""

from __future__ import annotations

from pathlib import Path

import pytest

from command_line import Call


@pytest.mark.parametrize("path", ["-", "", "\udcff", "/dev/zero", "benchmark.\u202e"])
def test_a_path_of_a_value_that_no_document_has(path: str, tmp_path: Path, call: Call) -> None:
    (tmp_path / "x.r2b.yaml").write_text("r2bspec: 1\nname: x\n")
    ended = call("plan", str(tmp_path / "x.r2b.yaml"), "--explain", path)
    assert ended.status == 2
    assert "  help: " in ended.err
