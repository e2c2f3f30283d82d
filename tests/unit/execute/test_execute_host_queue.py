"""One run at a time on a host, in the order of arrival, and what those who wait are told."""

from __future__ import annotations

import errno
import itertools
import os
import signal
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from queue_members import Join, leave, other_members, said
from r2bspec.errors import ExitStatus
from r2bspec.execute.errors import InterruptedRunError, UnwritableRunError
from r2bspec.execute.host_queue import (
    DISABLED_BY,
    Holder,
    HostBusyError,
    Place,
    host_to_itself,
    queue_folder,
)


@pytest.fixture
def join(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Join]:
    """Let one more process join the queue."""
    with other_members(tmp_path, monkeypatch) as join:
        yield join


def never(place: Place) -> None:
    pytest.fail(str(place))


def test_who_does_not_wait_is_told_who_runs(join: Join) -> None:
    other = join()
    with (
        pytest.raises(HostBusyError, match=rf"the other one \(process {other.pid}\)") as caught,
        host_to_itself("mine", wait_s=0, on_wait=never),
    ):
        pytest.fail("the other one runs")
    assert "--wait" in caught.value.hint
    assert caught.value.exit_code == ExitStatus.RUN_FAILED
    leave(other)
    with host_to_itself("mine", wait_s=0, on_wait=never):
        pass


def test_who_waits_long_enough_goes_and_leaves_its_place(join: Join) -> None:
    first = join("first")
    with (
        pytest.raises(HostBusyError, match="after 1 s of waiting"),
        host_to_itself("mine", wait_s=0.5, on_wait=lambda _: None),
    ):
        pytest.fail("the first one runs")
    third = join("third")
    leave(first)
    assert said(third) == "runs"


def test_runs_are_made_in_the_order_in_which_they_came(join: Join) -> None:
    members = [join(str(number)) for number in range(5)]
    for before, after in itertools.pairwise(members):
        leave(before)
        assert said(after) == "runs"
    assert len(list(queue_folder().iterdir())) == 1


def test_a_killed_run_has_no_place(join: Join) -> None:
    runs, killed, waits = join("runs"), join("killed"), join("waits")
    killed.kill()
    killed.wait()
    runs.kill()
    assert said(waits) == "runs"
    assert len(list(queue_folder().iterdir())) == 3
    leave(waits)
    with host_to_itself("mine", wait_s=0, on_wait=never):
        assert len(list(queue_folder().iterdir())) == 1, "abandoned tickets are removed"


def test_who_waits_sees_its_place_and_the_time_change(join: Join) -> None:
    first, second = join("first", "1000"), join("second", "530")
    places: list[tuple[str, str]] = []

    def on_wait(place: Place) -> None:
        shown = str(place), place.left()
        if shown[0] not in (text for text, _ in places):
            places.append(shown)
            leave(first if len(places) == 1 else second)

    with host_to_itself("mine", on_wait=on_wait):
        pass
    assert places == [
        (
            (
                "waiting in place 3 of the queue of this host, behind first "
                f"(process {first.pid}) and 1 other"
            ),
            "about 26 min",
        ),
        (
            f"waiting in place 2 of the queue of this host, behind second (process {second.pid})",
            "about 9 min",
        ),
    ]


@pytest.mark.parametrize(
    ("ahead", "left"),
    [
        ([(30.0, 10.0)], "about 20 s"),
        ([(30.0, 10.0), (60.0, None)], "about 80 s"),
        ([(30.0, 40.0)], "for an unknown time"),
        ([(None, 40.0)], "for an unknown time"),
        ([(30.0, 40.0), (60.0, None)], "60 s or more"),
        ([(30.0, 30.0 - 1e-3)], "about 1 s"),
    ],
)
def test_the_time_is_that_of_all_before_as_far_as_it_is_known(
    ahead: list[tuple[float | None, float | None]], left: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time, "monotonic", lambda: 1000.0)
    holders = (
        Holder("one", 1, seconds, None if ran_s is None else 1000.0 - ran_s)
        for seconds, ran_s in ahead
    )
    assert Place(tuple(holders)).left() == left


def test_a_signal_ends_the_wait(join: Join) -> None:
    join()
    timer = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with (
        pytest.raises(InterruptedRunError, match="while it waited for the other one"),
        host_to_itself("mine", on_wait=lambda _: None),
    ):
        pytest.fail("the other one runs")
    timer.join()


def test_the_variable_switches_it_off(join: Join, monkeypatch: pytest.MonkeyPatch) -> None:
    other = join()
    monkeypatch.setenv(DISABLED_BY, "1")
    with host_to_itself("mine", on_wait=never):
        assert other.poll() is None


@pytest.mark.usefixtures("join")
def test_all_users_may_join_and_remove_only_their_own() -> None:
    with host_to_itself("mine\n", wait_s=0, on_wait=never):
        assert stat.S_IMODE(queue_folder().stat().st_mode) == 0o1777
        (ticket,) = queue_folder().iterdir()
        assert stat.S_IMODE(ticket.stat().st_mode) == 0o644
        assert "\n" not in ticket.read_text()


@pytest.mark.usefixtures("join")
def test_a_link_in_place_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "precious").mkdir()
    queue_folder().symlink_to(tmp_path / "precious")
    with host_to_itself("mine", on_wait=never):
        assert list((tmp_path / "precious").iterdir()) == []


@pytest.mark.usefixtures("join")
def test_what_is_no_ticket_is_no_place(tmp_path: Path) -> None:
    queue_folder().mkdir()
    (queue_folder() / "1").write_text("abandoned, and no JSON")
    (queue_folder() / "2").symlink_to(tmp_path)
    os.mkfifo(queue_folder() / "3")
    (queue_folder() / "four").touch()
    with host_to_itself("mine", wait_s=0, on_wait=never):
        pass


@pytest.mark.usefixtures("join")
@pytest.mark.parametrize("call", ["mkdir", "open", "pwrite"])
def test_a_full_disk_is_named(call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    if call != "mkdir":
        queue_folder().mkdir()
        original = os.open
        if call == "open":
            monkeypatch.setattr(
                os, "open", lambda *a, **k: full() if k.get("dir_fd") else original(*a, **k)
            )
    if call != "open":
        monkeypatch.setattr(os, call, full)
    # With the variable that is undone below, too.
    folder = queue_folder()
    with (
        pytest.raises(UnwritableRunError, match="No space left on device") as caught,
        host_to_itself("mine", on_wait=never),
    ):
        pytest.fail("there is no queue")
    assert str(folder) in str(caught.value)
    assert "--no-lock" in caught.value.hint
    monkeypatch.undo()
    assert not folder.is_dir() or list(folder.iterdir()) == []
