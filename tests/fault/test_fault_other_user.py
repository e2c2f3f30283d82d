"""Promise: a user of this machine who is not the one of the run can read and change nothing of it.

Where the tests run as root, a child process becomes another user, for real.
"""

from __future__ import annotations

import importlib
import json
import os
import pwd
import stat
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import Bench, relay_spec

SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - where the middleware keeps its segments


def _other_uid() -> int:
    if os.geteuid():
        pytest.skip("only root can become another user")
    try:
        return pwd.getpwnam("nobody").pw_uid
    except KeyError:
        pytest.skip("this machine has no second user")


def as_other_user(uid: int, action: Callable[[], Any]) -> Any:
    """What an action gives in a process of another user, as JSON."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        code = 1
        try:
            os.close(reading)
            os.setgroups([])
            os.setgid(uid)
            os.setuid(uid)
            os.write(writing, json.dumps(action()).encode())
            code = 0
        except BaseException:
            traceback.print_exc()
            raise
        finally:
            os._exit(code)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        said = pipe.read()
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0
    return json.loads(said)


def accessible(paths: list[str]) -> list[str]:
    """The paths of which this process can read or change something, or list a folder."""
    found = []
    for path in paths:
        for flags in (os.O_RDONLY, os.O_WRONLY):
            try:
                os.close(os.open(path, flags | os.O_NONBLOCK))
            except OSError:
                continue
            found.append(path)
    return found


def open_to_traverse(folder: Path) -> None:
    """Let other users come as far as the folder, so that its own mode is what keeps them out."""
    for each in (folder, *folder.parents):
        if each != Path("/") and not each.stat().st_mode & stat.S_IXOTH:
            each.chmod(each.stat().st_mode | 0o055)


@only_nightly()
def test_another_user_reads_and_changes_nothing_of_a_run(tmp_path: Path) -> None:
    uid = _other_uid()
    bench = Bench(tmp_path / "bench")
    open_to_traverse(bench.folder)
    before = {each.name for each in SHARED_MEMORY.iterdir()}
    spec = relay_spec()
    spec["benchmark"] |= {"iterations": 30}
    with bench.start(spec) as running:
        running.wait_for_messages("out", 5)
        files = [str(path) for path in running.folder.rglob("*")]
        segments = [str(each) for each in SHARED_MEMORY.iterdir() if each.name not in before]
        # Locks and ports of Fast DDS are for all programs; what they carry is in the segments.
        segments = [
            segment
            for segment in segments
            if "_port" not in segment and not segment.endswith("_el")
        ]
        assert len(files) > 10
        seen = as_other_user(uid, lambda: accessible([str(running.folder), *files, *segments]))
        visible = as_other_user(uid, lambda: accessible([str(bench.folder)]))
        running.process.terminate()
        running.finish()
    assert seen == []
    assert visible == [str(bench.folder)], "the user did come as far as the run folder"


def test_a_run_into_the_folder_of_another_user_is_refused(tmp_path: Path) -> None:
    uid = _other_uid()
    bench = Bench(tmp_path / "bench")
    open_to_traverse(bench.folder)
    theirs = bench.folder / "theirs"
    theirs.mkdir(mode=0o700)
    bench.write(relay_spec())
    other = bench.folder / "other"
    other.mkdir()
    os.chown(other, uid, uid)

    def run() -> tuple[int, str]:
        import contextlib
        import io

        from r2bspec.cli.main import main

        os.chdir(other)
        os.environ.update({"HOME": str(other), "XDG_CACHE_HOME": str(other), "TMPDIR": str(other)})
        said = io.StringIO()
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            code = main(["run", str(bench.folder / "spec.r2b.yaml"), "--output", str(theirs)])
        return int(code), said.getvalue()

    # The other user may not be able to read the files of this package.
    importlib.import_module("r2bspec.cli.run")
    code, said = as_other_user(uid, run)
    assert code == 2, said
    assert f"{theirs}' is not readable" in said
    assert list(theirs.iterdir()) == []
