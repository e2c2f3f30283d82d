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
    (tmp_path / "a").touch()
    os.truncate(tmp_path / "a", 10**12)
    with pytest.raises(TooLargeError):
        read_bytes(tmp_path / "a", max_bytes=1000)


@pytest.mark.parametrize(
    ("file", "error", "words"),
    [
        ("/dev/zero", RefusedFileError, "device"),
        ("/dev/ptmx", RefusedFileError, "device"),
        ("/proc/self/environ", OutsideFolderError, "kernel"),
        ("/proc/version", OutsideFolderError, "kernel"),
    ],
)
def test_devices_and_files_of_the_kernel_are_refused_also_through_a_link(
    file: str, error: type[OSError], words: str, tmp_path: Path
) -> None:
    (tmp_path / "link").symlink_to(file)
    for path in (Path(file), tmp_path / "link"):
        with pytest.raises(error, match=words):
            open_regular(path)


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        (".", RefusedFileError, "folder"),
        # Nobody writes to it: whoever opens it waits.
        ("pipe", RefusedFileError, "pipe"),
        ("a\0b", RefusedFileError, "NUL"),
        ("none", FileNotFoundError, "none"),
        ("x" * 300, OSError, "name too long"),
        ("itself", OSError, "symbolic links"),
    ],
)
def test_what_is_no_regular_file_is_an_error_at_once(
    name: str, error: type[OSError], words: str, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "itself").symlink_to(tmp_path / "itself")
    with pytest.raises(error, match=words):
        open_regular(tmp_path / name)


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


def test_without_proc_the_cause_is_named_and_no_file_is_called_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a").write_text("x")
    monkeypatch.setattr("r2bspec.safe_io.safe_file._DESCRIPTORS", str(tmp_path / "none"))
    with pytest.raises(RefusedFileError, match="by which files are opened") as refused:
        read_bytes(tmp_path / "a", max_bytes=9)
    assert not isinstance(refused.value, FileNotFoundError)
    assert "Mount /proc" in refused.value.hint
