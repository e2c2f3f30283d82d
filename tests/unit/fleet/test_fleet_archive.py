"""What travels arrives whole, and nowhere else."""

from __future__ import annotations

import io
import os
import stat
import zipfile
from pathlib import Path

import pytest

from r2bspec.fleet import archive
from r2bspec.fleet.archive import ArchiveError


def test_a_folder_arrives_with_its_files_and_without_links(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    (folder / "samples").mkdir(parents=True)
    (folder / "samples" / "a.npy").write_bytes(b"\0" * 100)
    (folder / "tool").write_text("#!/bin/sh\n")
    (folder / "tool").chmod(0o755)
    (folder / "secret").symlink_to("/etc/hostname")
    archive.unpack(archive.pack_folder(folder), tmp_path / "here")
    arrived = {str(path.relative_to(tmp_path / "here")) for path in (tmp_path / "here").rglob("*")}
    assert arrived == {"samples", "samples/a.npy", "tool"}
    assert (tmp_path / "here/samples/a.npy").read_bytes() == b"\0" * 100
    assert os.access(tmp_path / "here/tool", os.X_OK)
    assert not os.access(tmp_path / "here/samples/a.npy", os.X_OK)


@pytest.mark.parametrize("name", ["../out", "/out", "a/../../out"])
def test_an_archive_writes_regular_files_below_its_folder_only(tmp_path: Path, name: str) -> None:
    with pytest.raises(ArchiveError, match="leads out"):
        archive.unpack(archive.pack({name: b"x"}), tmp_path / "in" / "here")
    assert not list(tmp_path.rglob("out"))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as content:
        link = zipfile.ZipInfo("link")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        content.writestr(link, "/etc/hostname")
    archive.unpack(stream.getvalue(), tmp_path / "links")
    assert not (tmp_path / "links/link").is_symlink()


def test_a_damaged_archive_and_one_that_is_too_large_are_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = archive.pack({"a": b"x" * 1000, "b": b"y"})
    for damaged in (b"", whole[:-30], whole[:40] + b"\0\0\0" + whole[43:]):
        with pytest.raises(ArchiveError, match="damaged"):
            archive.unpack(damaged, tmp_path / str(len(damaged)))
    monkeypatch.setattr(archive, "MAX_FLEET_ARCHIVE_BYTES", 1000)
    with pytest.raises(ArchiveError, match="the largest is a"):
        archive.pack({"a": b"x" * 1000, "b": b"y"})
    with pytest.raises(ArchiveError, match="the largest is a"):
        archive.unpack(whole, tmp_path / "large")
