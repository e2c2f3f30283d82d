"""Promise: the queue of a host is that of all its users, and a run that ends has no place in it."""

from __future__ import annotations

import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from test_fault_other_user import _other_uid, as_other_user, open_to_traverse

from queue_members import Join, leave, other_members, said
from r2bspec.execute.host_queue import HostBusyError, host_to_itself, queue_folder

ROOT = Path(__file__).parents[2]


@pytest.fixture
def join(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Join]:
    with other_members(tmp_path, monkeypatch) as join:
        yield join


def attempt() -> dict[str, Any]:
    """Return what a run gets that does not wait, and which tickets its user can remove."""
    removed = []
    for ticket in queue_folder().iterdir() if queue_folder().exists() else ():
        try:
            ticket.unlink()
            removed.append(ticket.name)
        except OSError:
            pass
    try:
        with host_to_itself("of another user", wait_s=0, on_wait=print):
            return {"runs": True, "removed": removed}
    except HostBusyError as error:
        return {"runs": False, "removed": removed, "said": str(error)}


def test_users_wait_for_each_other_and_remove_no_ticket_of_another(
    join: Join, tmp_path: Path
) -> None:
    uid = _other_uid()
    open_to_traverse(tmp_path)
    tmp_path.chmod(0o1777)
    first = join("first")
    refused = as_other_user(uid, attempt)
    assert (refused["runs"], refused["removed"]) == (False, [])
    assert f"first (process {first.pid})" in refused["said"]
    first.kill()
    first.wait()
    assert as_other_user(uid, attempt) == {"runs": True, "removed": []}


def test_a_queue_that_another_user_has_made_is_the_queue_of_all(join: Join, tmp_path: Path) -> None:
    uid = _other_uid()
    open_to_traverse(tmp_path)
    tmp_path.chmod(0o1777)
    assert as_other_user(uid, attempt)["runs"]
    assert queue_folder().stat().st_uid == uid
    first, second = join("first"), join("second")
    leave(first)
    assert said(second) == "runs"


def test_no_room_for_a_ticket_is_an_error_that_names_the_queue(join: Join, tmp_path: Path) -> None:
    leave(join())
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "r2bspec",
            "run",
            str(ROOT / "specs/relay.r2b.yaml"),
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)),
    )
    assert done.returncode == 4, done.stderr
    assert (
        f"R2B651 run-folder-not-writable]: the queue of this host, {queue_folder()}" in done.stderr
    )
    assert list(queue_folder().iterdir()) == []
