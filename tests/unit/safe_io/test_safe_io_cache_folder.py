"""A cache is believed where nobody else can have filled it, and passed over anywhere else."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from r2bspec.bags.recording import TimeWindow
from r2bspec.cli.main import main
from r2bspec.datasets.catalogue import CACHE_KIND
from r2bspec.datasets.synthesis import make
from r2bspec.safe_io.cache_folder import (
    UnusableCacheError,
    cache_folder,
    cache_or_temporary_folder,
    passed_over,
)

NOBODY = 65534


@pytest.fixture(autouse=True)
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of one kind, four folders below that of the test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home/cache"))
    passed_over.clear()
    return tmp_path / "home/cache/r2bspec/kind"


def refused(reason: str) -> None:
    with pytest.raises(UnusableCacheError, match=reason):
        cache_folder("kind")


def test_a_new_cache_is_private(kept: Path) -> None:
    assert cache_folder("kind") == kept
    assert all(stat.S_IMODE(each.stat().st_mode) == 0o700 for each in (kept, *kept.parents[:3]))


def all_may_write(folder: Path) -> None:
    folder.chmod(0o757)


def a_group_may_write(folder: Path) -> None:
    if os.geteuid():
        pytest.skip("only root can give a folder to any group")
    os.chown(folder, -1, NOBODY)
    folder.chmod(0o2770)


def belongs_to_another_user(folder: Path) -> None:
    if os.geteuid():
        pytest.skip("only root can give a folder away")
    os.chown(folder, NOBODY, -1)


@pytest.mark.parametrize("above", range(5))
@pytest.mark.parametrize("change", [all_may_write, a_group_may_write, belongs_to_another_user])
def test_no_folder_on_the_way_may_be_another_users(
    change: Callable[[Path], None], above: int, kept: Path
) -> None:
    cache_folder("kind")
    place = (kept, *kept.parents)[above]
    change(place)
    refused(f"{place} belongs to another|write to {place}$")


def test_a_sticky_folder_above_protects_what_is_in_it(kept: Path) -> None:
    cache_folder("kind")
    kept.parents[2].chmod(0o1777)
    assert cache_folder("kind") == kept
    kept.chmod(0o1777)
    refused("other users can write")


def test_a_group_of_this_user_alone_may_write(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the umask is 002; an access control list can name others."""
    if os.geteuid():
        pytest.skip("the group of root is its own everywhere")
    cache_folder("kind")
    kept.parent.chmod(0o770)
    assert cache_folder("kind") == kept
    monkeypatch.setattr(os, "listxattr", lambda _: ["system.posix_acl_access"])
    refused("other users can write")


def test_a_link_counts_for_what_it_leads_to(kept: Path, tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir(mode=0o700)
    kept.parent.mkdir(parents=True, mode=0o700)
    kept.symlink_to(disk)
    assert cache_folder("kind") == disk
    disk.chmod(0o777)
    refused(f"write to {disk}")


@pytest.mark.parametrize("mark", [Path.mkdir, Path.touch], ids=["clone", "linked work tree"])
def test_no_commit_can_fill_it(mark: Callable[[Path], None], kept: Path, tmp_path: Path) -> None:
    mark(tmp_path / ".git")
    refused(f"{tmp_path} is a work tree of git")


@pytest.mark.parametrize("named", ["relative", ""])
def test_a_path_that_is_not_absolute_names_no_cache(
    named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", named)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder("kind") == tmp_path / ".cache/r2bspec/kind"
    monkeypatch.setattr(os.path, "expanduser", str)
    refused("no home")


def test_in_place_of_a_cache_that_cannot_be_made_there_is_one_for_this_process(
    tmp_path: Path,
) -> None:
    (tmp_path / "home").touch()
    folder = cache_or_temporary_folder("kind")
    assert cache_or_temporary_folder("kind") == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    (note,) = passed_over
    assert "is not used: Not a directory" in note


def test_a_dataset_of_a_commit_is_not_believed(
    kept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is rendered again; 'data make', whose dataset would be gone after the call, refuses."""
    dataset = ("r2b_storage", ["/d455_1_imu"], TimeWindow(end_ns=20_000_000))
    committed = make(*dataset)
    assert committed.path.parent == kept.with_name(CACHE_KIND)
    (tmp_path / ".git").mkdir()
    again = make(*dataset)
    assert (again.made, again.content_sha256) == (True, committed.content_sha256)
    assert again.path.parent != committed.path.parent
    assert not make(*dataset).made
    (note,) = passed_over
    assert note.startswith(f"note: the cache {committed.path.parent} is not used: {tmp_path} is a")
    assert main(["data", "make", dataset[0], "--topics", dataset[1][0], "--end", "20 ms"]) == 2
    said = capsys.readouterr()
    why = f"the cache {committed.path.parent} cannot keep a dataset: {tmp_path} is a work tree"
    assert (said.out, why in said.err) == ("", True)
