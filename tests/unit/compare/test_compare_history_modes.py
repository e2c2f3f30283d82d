"""Promise: a history that r2bspec creates is for its user alone."""

from __future__ import annotations

import os
from pathlib import Path

from r2bspec.compare.history import open_history


def test_no_other_user_may_read_a_new_history(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        file = tmp_path / "folder" / "history.sqlite"
        with open_history(file, create=True) as history:
            assert history.runs() == ()
            modes = {each.name: each.stat().st_mode & 0o777 for each in file.parent.iterdir()}
        assert os.umask(0o022) == 0o022, "the umask of the process is as it was"
    finally:
        os.umask(before)
    assert set(modes.values()) == {0o600}, modes
    assert "history.sqlite-wal" in modes
    assert file.parent.stat().st_mode & 0o777 == 0o700
