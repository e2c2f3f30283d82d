"""Promise: no folder outlives the processes that need it by more than the next call."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from r2bspec.safe_io.private_files import temporary_folder


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def holder(place: Path, function: str = "process_folder") -> tuple[subprocess.Popen[str], Path]:
    """A process that has a folder, and that folder."""
    words = (
        f"from r2bspec.safe_io.private_files import *; it = {function}('x'); "
        "print(it if isinstance(it, Path) else it.__enter__(), flush=True); input()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(place)},
    )
    assert process.stdout is not None
    folder = Path(process.stdout.readline().strip())
    (folder / "closed").mkdir(mode=0o500)
    return process, folder


def test_it_is_private_and_ends_with_its_block(place: Path) -> None:
    with temporary_folder("x") as folder:
        assert folder.parent == place
        assert folder.stat().st_mode & 0o777 == 0o700
        (folder / "closed").mkdir()
        (folder / "closed" / "file").touch()
        (folder / "closed").chmod(0o500)
    assert list(place.iterdir()) == []


@pytest.mark.parametrize("function", ["process_folder", "temporary_folder"])
def test_that_of_a_killed_process_is_removed_by_the_next_one(place: Path, function: str) -> None:
    process, folder = holder(place, function)
    with temporary_folder("y"):
        assert folder.is_dir()  # it is in use
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert folder.is_dir()
    with temporary_folder("y"):
        assert not folder.exists()


def test_that_of_a_process_ends_with_it(place: Path) -> None:
    process, folder = holder(place)
    process.communicate("\n")
    assert not folder.exists()


def test_what_is_no_abandoned_folder_stays(place: Path) -> None:
    target = place / "target"
    target.mkdir()
    (place / "r2bspec-link.held").symlink_to(target)
    (place / "r2bspec-file.held").touch()
    (place / "r2bspec-other").mkdir()
    before = sorted(place.iterdir())
    with temporary_folder("x"):
        pass
    assert sorted(place.iterdir()) == before


@pytest.mark.parametrize(
    ("name", "depth", "mode"),
    [("d", 1_100, 0o500), (250 * "d", 20, 0)],
    ids=["deeper than functions are called, not writable", "longer than a path, closed"],
)
def test_folders_of_any_depth_and_mode_are_removed(
    name: str, depth: int, mode: int, tmp_path: Path
) -> None:
    """Not by the superuser, whom no mode stops."""
    words = """if True:
        import os, shutil, sys  # that user may not read Python's own modules
        from pathlib import Path
        from r2bspec.safe_io.private_files import remove_folder
        if os.geteuid() == 0:
            os.setgid(65534)
            os.setuid(65534)
        folder, name, depth, mode = Path("left"), sys.argv[1], *map(int, sys.argv[2:])
        folder.mkdir()
        here = os.open(folder, os.O_RDONLY)
        for _ in range(depth):
            os.mkdir(name, dir_fd=here)
            os.close(os.open("file", os.O_CREAT, 0o400, dir_fd=here))
            os.symlink(os.getcwd(), "link", dir_fd=here)
            below = os.open(name, os.O_RDONLY, dir_fd=here)
            os.chmod(here, mode)
            os.close(here)
            here = below
        remove_folder(folder)
        Path("link").symlink_to("kept")
        remove_folder(Path("link"))
    """
    (tmp_path / "place" / "kept").mkdir(parents=True)
    (tmp_path / "place").chmod(0o777)
    # Pytest's folders are private: another user gets no further than where it stands.
    subprocess.run(
        [sys.executable, "-P", "-c", words, name, str(depth), str(mode)],
        cwd=tmp_path / "place",
        check=True,
    )
    assert sorted(path.name for path in (tmp_path / "place").iterdir()) == ["kept", "link"]
