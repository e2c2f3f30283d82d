"""A cache is believed where nobody else can have filled it, and passed over anywhere else."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from r2bspec.cli.main import main
from r2bspec.datasets.catalogue import CACHE_KIND
from r2bspec.safe_io.cache_folder import (
    UnusableCacheError,
    cache_folder,
    cache_or_temporary_folder,
    passed_over,
)


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


@pytest.mark.parametrize("place", ["kind", "r2bspec"])
def test_a_cache_to_which_others_can_write_is_not_used(place: str, kept: Path) -> None:
    cache_folder("kind")
    exposed = kept if place == "kind" else kept.parent
    exposed.chmod(0o770)
    refused(f"other users can write to {exposed}")


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


def test_a_dataset_is_not_made_where_it_would_be_gone_after_the_call(
    kept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cache = kept.with_name(CACHE_KIND)
    cache.mkdir(parents=True)
    cache.chmod(0o777)
    words = ["--topics", "/d455_1_imu", "--window", "0 s:20 ms"]
    assert main(["data", "make", "r2b_storage", *words]) == 2
    said = capsys.readouterr()
    assert f"the cache {cache} cannot keep a dataset: other users can write to {cache}" in said.err
