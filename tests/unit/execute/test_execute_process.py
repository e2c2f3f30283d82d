"""No log fills the disk; processors, priorities and time slices are set from outside."""

from __future__ import annotations

import os
import stat
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from r2bspec.execute.processes import process
from r2bspec.execute.processes.process import (
    SLICE_NS,
    LogLimiter,
    open_log,
    shorten_slice,
    slice_of,
)

LIMIT, HEAD, TAIL = 4000, 500, 1000


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = {"MAX_LOG_BYTES": LIMIT, "KEPT_HEAD_BYTES": HEAD, "KEPT_TAIL_BYTES": TAIL}
    for name, value in sizes.items():
        monkeypatch.setattr(process, name, value)


def limited(*folders: Path) -> LogLimiter:
    limiter = LogLimiter()
    for folder in folders:
        limiter.watch(folder)
    return limiter


def lines(first: int, last: int) -> bytes:
    return b"".join(b"%06d\n" % number for number in range(first, last))


def test_the_head_and_the_tail_of_a_long_log_are_kept_and_its_writer_goes_on(
    tmp_path: Path,
) -> None:
    log = tmp_path / "node.log"
    kept = limited(tmp_path)
    whole = lines(0, 2000)
    with log.open("ab", buffering=0) as writer:
        writer.write(whole)
        kept.truncate_large(now=True)
        writer.write(b"went on\n")
    head, note, tail = log.read_bytes().partition(b"\n[r2bspec removed 0.0 MiB of this log here]\n")
    assert note
    assert head == whole[:HEAD]
    assert tail == whole[-TAIL:] + b"went on\n"
    assert kept.truncated == [log]


def test_a_log_is_cut_again_and_again(tmp_path: Path) -> None:
    log = tmp_path / "node.log"
    kept = limited(tmp_path)
    with log.open("ab", buffering=0) as writer:
        for begin in range(0, 20_000, 1000):
            writer.write(lines(begin, begin + 1000))
            kept.truncate_large(now=True)
            assert log.stat().st_size <= LIMIT
    found = log.read_bytes()
    assert found.startswith(lines(0, 70))
    assert found.endswith(lines(19_900, 20_000))
    assert found.count(b"[r2bspec removed 0.1 MiB of this log here]") == 1


@pytest.mark.parametrize("kind", ["symlink", "hard link", "folder"])
def test_a_link_to_a_file_elsewhere_does_not_get_it_cut(tmp_path: Path, kind: str) -> None:
    elsewhere = tmp_path / "elsewhere" / "data.bin"
    elsewhere.parent.mkdir()
    elsewhere.write_bytes(lines(0, 2000))
    logs = tmp_path / "logs"
    logs.mkdir()
    if kind == "folder":
        (logs / "ros").symlink_to(elsewhere.parent)
    elif kind == "symlink":
        (logs / "node.log").symlink_to(elsewhere)
    else:
        (logs / "node.log").hardlink_to(elsewhere)
    kept = limited(logs)
    kept.truncate_large()
    assert elsewhere.read_bytes() == lines(0, 2000)
    assert kept.truncated == []


def test_a_log_is_not_opened_through_a_link_and_is_not_for_others(tmp_path: Path) -> None:
    log = tmp_path / "node.log"
    log.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="symbolic links"):
        open_log(log)
    assert not (tmp_path / "elsewhere").exists()
    log.unlink()
    open_log(log).close()
    assert stat.S_IMODE(log.stat().st_mode) == 0o600


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(["/bin/sleep", "60"]) as process:
        yield process
        process.kill()


@pytest.mark.skipif(slice_of(0) == 0, reason="this kernel has no time slices for each process")
def test_a_process_gets_a_shorter_slice_and_keeps_the_rest(
    sleeper: subprocess.Popen[bytes],
) -> None:
    own = slice_of(0)
    os.setpriority(os.PRIO_PROCESS, sleeper.pid, 19)
    assert shorten_slice(sleeper.pid)
    assert slice_of(sleeper.pid) == SLICE_NS
    assert os.getpriority(os.PRIO_PROCESS, sleeper.pid) == 19
    assert slice_of(0) == own
