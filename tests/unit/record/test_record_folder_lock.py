"""Promise: a run folder belongs to one run, from its creation to its end."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from nightly import size
from r2bspec.record.comparison_folder import ComparisonFolder
from r2bspec.record.files import LOCK_FILE, RUN_UNWRITABLE, FolderTakenError, RecordError
from r2bspec.record.run_folder import RunFolder
from r2bspec.safe_io.private_files import private_files, user_umask

HOLDER = """
import sys, time
from pathlib import Path
from r2bspec.record.run_folder import RunFolder
folder = RunFolder.create(Path(sys.argv[1]))
print("mine", flush=True)
time.sleep(600)
"""


def test_an_empty_folder_of_a_run_in_progress_is_refused(tmp_path: Path) -> None:
    with RunFolder.create(tmp_path / "run") as folder:
        with pytest.raises(FolderTakenError, match="run that is in progress") as raised:
            ComparisonFolder.create(folder.path)
        assert raised.value.code == RUN_UNWRITABLE
        assert "--output" in raised.value.hint
    assert list(folder.path.iterdir()) == []
    RunFolder.create(folder.path).release()


def test_of_many_that_begin_at_once_one_gets_the_folder(tmp_path: Path) -> None:
    def take(_: int) -> RunFolder | None:
        try:
            return RunFolder.create(tmp_path / "run")
        except FolderTakenError:
            return None

    for _ in range(size(5, 20)):
        with ThreadPoolExecutor(16) as pool:
            got = [each for each in pool.map(take, range(16)) if each is not None]
        assert len(got) == 1
        got[0].release()


def test_a_killed_run_gives_its_folder_up(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-P", "-c", HOLDER, str(tmp_path / "run")], stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"mine\n"
        with pytest.raises(FolderTakenError):
            RunFolder.create(tmp_path / "run")
        holder.send_signal(signal.SIGKILL)
        holder.wait(30.0)
    RunFolder.create(tmp_path / "run").release()


def test_a_lock_that_is_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / LOCK_FILE).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RecordError, match="cannot be created"):
        RunFolder.create(tmp_path / "run")
    assert not (tmp_path / "elsewhere").exists()


def test_no_other_user_may_look_into_a_run_folder(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        with private_files(), RunFolder.create(tmp_path / "run") as folder:
            assert user_umask() == 0o022
            folder.write_spec("r2bspec: 1\n")
            log = folder.log_path("node")
        assert user_umask() == -1
        modes = {each.name: stat.S_IMODE(each.stat().st_mode) for each in folder.path.iterdir()}
    finally:
        assert os.umask(before) == 0o022
    assert stat.S_IMODE(folder.path.stat().st_mode) == 0o700
    assert modes == {"spec.yaml": 0o600, log.parent.name: 0o700}
