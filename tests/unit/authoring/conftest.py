"""Every first spec is made in a folder of its own."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    # In no wheel: nodes that read transforms find it beside them.
    (tmp_path / "tf2_ros.py").touch()
    monkeypatch.setenv("CELL_PORT", "3")
