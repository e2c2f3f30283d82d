"""Promise: folders are private, and end with their block, with their process, or a week later."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from r2bspec.safe_io.private_files import remove_folder, temporary_folder


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_it_is_private_and_ends_with_its_block(place: Path) -> None:
    with temporary_folder("x") as folder:
        assert folder.parent == place
        assert folder.stat().st_mode & 0o777 == 0o700
        (folder / "closed").mkdir()
        (folder / "closed" / "file").touch()
        (folder / "closed").chmod(0o500)
    assert list(place.iterdir()) == []


def test_that_of_a_process_ends_with_it(place: Path) -> None:
    words = "from r2bspec.safe_io.private_files import *; print(process_folder('x').is_dir())"
    environment = {**os.environ, "TMPDIR": str(place)}
    done = subprocess.run(
        [sys.executable, "-c", words], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "True"
    assert list(place.iterdir()) == []


def test_only_folders_of_processes_that_were_killed_long_ago_are_removed(place: Path) -> None:
    names = ("r2bspec-new.tmp", "r2bspec-other", "r2bspec-old.tmp")
    for name in names:
        (place / name).mkdir()
    long_ago = time.time() - 8 * 24 * 3600
    os.utime(place / "r2bspec-other", (long_ago, long_ago))
    (place / "r2bspec-link.tmp").symlink_to(place / "r2bspec-other")
    os.utime(place / "r2bspec-link.tmp", (long_ago, long_ago), follow_symlinks=False)
    os.utime(place / "r2bspec-old.tmp", (long_ago, long_ago))
    with temporary_folder("x"):
        pass
    assert {each.name for each in place.iterdir()} == {*names[:2], "r2bspec-link.tmp"}


def test_a_link_to_a_folder_stays(place: Path) -> None:
    (place / "kept" / "below").mkdir(parents=True)
    (place / "link").symlink_to("kept")
    remove_folder(place / "link")
    assert (place / "link" / "below").is_dir()


def test_folders_of_any_mode_are_removed(tmp_path: Path) -> None:
    """Not by the superuser, whom no mode stops."""
    words = """if True:
        import os, shutil  # that user may not read Python's own modules
        from pathlib import Path
        from r2bspec.safe_io.private_files import remove_folder
        if os.geteuid() == 0:
            os.setgid(65534)
            os.setuid(65534)
        (Path("left") / "closed" / "empty").mkdir(parents=True)
        (Path("left") / "closed" / "file").touch()
        Path("left", "closed").chmod(0)
        remove_folder(Path("left"))
    """
    (tmp_path / "place").mkdir()
    (tmp_path / "place").chmod(0o777)
    # Pytest's folders are private: another user gets no further than where it stands.
    subprocess.run([sys.executable, "-P", "-c", words], cwd=tmp_path / "place", check=True)
    assert list((tmp_path / "place").iterdir()) == []
