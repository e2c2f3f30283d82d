"""Files from outside: only regular ones, from allowed folders, up to a size."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from r2bspec.safe_io.safe_file import (
    OutsideFolderError,
    RefusedFileError,
    TooLargeError,
    open_regular,
    read_bytes,
    read_text,
)


def test_a_regular_file_is_read_up_to_the_limit(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_bytes(b"x" * 10)
    assert read_bytes(file, max_bytes=10) == b"x" * 10
    with pytest.raises(TooLargeError, match="larger than 9 bytes"):
        read_bytes(file, max_bytes=9)


def test_a_sparse_file_is_refused_before_it_fills_memory(tmp_path: Path) -> None:
    file = tmp_path / "a"
    with file.open("wb") as stream:
        stream.truncate(10**12)
    with pytest.raises(TooLargeError):
        read_bytes(file, max_bytes=1000)


def test_a_pipe_without_a_writer_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RefusedFileError, match="pipe"):
        open_regular(tmp_path / "pipe")


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null", "/dev/ptmx", "/dev/urandom"])
def test_a_device_is_refused_also_through_a_link(device: str, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(device)
    for path in (Path(device), tmp_path / "link"):
        with pytest.raises(RefusedFileError, match="device"):
            open_regular(path)


@pytest.mark.parametrize("file", ["/proc/self/environ", "/proc/self/cmdline", "/proc/version"])
def test_files_of_the_kernel_are_refused(file: str, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(file)
    for path in (Path(file), tmp_path / "link"):
        with pytest.raises(OutsideFolderError, match="kernel"):
            open_regular(path)


def test_a_folder_a_missing_file_and_impossible_names(tmp_path: Path) -> None:
    with pytest.raises(RefusedFileError, match="folder"):
        open_regular(tmp_path)
    with pytest.raises(FileNotFoundError):
        open_regular(tmp_path / "none")
    with pytest.raises(RefusedFileError, match="NUL"):
        open_regular(tmp_path / "a\0b")
    with pytest.raises(OSError, match="name too long"):
        open_regular(tmp_path / ("x" * 300))


def test_a_link_to_itself_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "a")
    with pytest.raises(OSError, match="symbolic links"):
        open_regular(tmp_path / "a")


def test_links_are_followed_inside_of_the_allowed_folders_only(tmp_path: Path) -> None:
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    (inside / "below").mkdir(parents=True)
    outside.mkdir()
    (inside / "below/a").write_text("a", encoding="utf-8")
    (outside / "secret").write_text("s", encoding="utf-8")
    (inside / "near").symlink_to("below/a")
    (inside / "far").symlink_to("../outside/secret")
    (inside / "folder").symlink_to("../outside")
    assert read_text(inside / "near", max_bytes=9, folders=(inside,)) == "a"
    for name in ("far", "folder/secret", "../outside/secret"):
        with pytest.raises(OutsideFolderError) as refused:
            read_text(inside / name, max_bytes=9, folders=(inside,))
        assert "secret" not in str(refused.value)
        assert read_text(inside / name, max_bytes=9, folders=(inside, outside)) == "s"
        assert read_text(inside / name, max_bytes=9) == "s"


def test_the_file_that_was_examined_is_the_one_that_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, secret = tmp_path / "in/a", tmp_path / "secret"
    file.parent.mkdir()
    file.write_text("harmless", encoding="utf-8")
    secret.write_text("secret", encoding="utf-8")
    examine = os.fstat

    def exchange(descriptor: int) -> os.stat_result:
        found = examine(descriptor)
        if not file.is_symlink():
            file.unlink()
            file.symlink_to(secret)
        return found

    monkeypatch.setattr(os, "fstat", exchange)
    try:
        text = read_text(file, max_bytes=99, folders=(file.parent,))
    except RefusedFileError:
        text = "refused"
    assert text in ("harmless", "refused")


def test_text_that_is_not_utf8_is_named_by_its_line_and_not_quoted(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"one\ntoken=\xff\n")
    with pytest.raises(RefusedFileError) as refused:
        read_text(tmp_path / "a", max_bytes=99)
    assert str(refused.value) == "it is not UTF-8 (line 2)"
