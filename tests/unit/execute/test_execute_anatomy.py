"""Where the processes of a run write what they do, and what is left of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from r2bspec.execute import anatomy
from run_simulation import Simulation


def test_a_later_start_removes_the_files_of_the_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(anatomy, "build_preload", lambda: tmp_path / "preload.so")
    plan = Simulation(segments=[]).plan()
    with anatomy.events_folder(plan, tmp_path) as folder:
        first = anatomy.AnatomyObservation.begin(plan, 1, folder)
        (first.files / "node.1.rows").write_bytes(b"rows")
        second = anatomy.AnatomyObservation.begin(plan, 2, folder)
        assert [each.name for each in folder.iterdir() if each.name.startswith("anatomy-")] == [
            second.files.name
        ]
    assert folder == tmp_path or not folder.exists()
