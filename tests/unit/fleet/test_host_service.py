"""What a host answers, and what a client makes of it, without Dask between them."""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("distributed")

from direct_hosts import FACTS, DirectClient, Service, run_of, service_in
from r2bspec.fleet.bundle import Job
from r2bspec.fleet.errors import (
    HostFullError,
    HostLostError,
    HostRefusesError,
    NotAllowedError,
    TransferError,
)
from r2bspec.fleet.fleet_runs import EndedRun, FleetLimits, FleetRuns
from r2bspec.fleet.host_service import HostService
from r2bspec.fleet.host_store import HostStore, remove
from r2bspec.fleet.journal import Journal, read_journal
from r2bspec.fleet.messages import Problem, RunEnded, read_request


@pytest.fixture
def service(tmp_path: Path) -> Service:
    return service_in(tmp_path / "host")


def play(
    folder: Path,
    service: Service,
    before: Callable[..., None],
    limits: FleetLimits = FleetLimits(),  # noqa: B008 - immutable
    **node: Any,
) -> EndedRun:
    """Have the only host of a fleet make a run; `before` is told of each call first."""

    def answer(request: bytes) -> bytes:
        method, args = read_request(request)
        before(method, *args)
        return service.answer(request)

    root = folder / "out"
    root.mkdir()
    journal = Journal(root)
    client: Any = DirectClient({"here": answer})
    runs = FleetRuns(client, root, journal, limits, lambda _: None, lambda _, __: None)
    (ended,) = runs.play([run_of(folder, **node)])
    journal.close()
    return ended


def states(folder: Path) -> list[str]:
    """How the attempts went, by the journal."""
    return [event.state for event in read_journal(folder / "out") if event.state]


def test_files_that_made_room_for_those_of_another_client_are_sent_again(
    service: Service, tmp_path: Path
) -> None:
    asked: list[str] = []

    def before(what: str, *_: Any) -> None:
        asked.append(what)
        if what == "play" and asked.count("play") == 1:
            remove(service.store.root / "objects")
            service.store.open()

    ended = play(tmp_path, service, before)
    assert ended.error is None
    assert (service.plays, asked.count("play")) == (1, 2)
    assert (tmp_path / "out" / "relay" / "record.json").is_file()
    assert states(tmp_path) == ["sent", "sent", "done"]


def test_a_host_that_never_keeps_files_ends_a_run_with_the_reason(
    service: Service, tmp_path: Path
) -> None:
    def before(what: str, *_: Any) -> None:
        if what == "play":
            remove(service.store.root / "objects")
            service.store.open()

    ended = play(tmp_path, service, before)
    assert isinstance(ended.error, TransferError)
    assert "has removed files of relay" in str(ended.error)
    assert "--cache-limit" in ended.error.hint
    assert service.plays == 0


def test_what_a_worker_finds_in_its_folder_is_not_believed(
    service: Service, tmp_path: Path
) -> None:
    """As where the folder came with an archive: other files, trees, and links out of it."""
    own = tmp_path / "mine"
    own.mkdir()
    root = service.store.root

    def before(what: str, *args: Any) -> None:
        if what == "prepare" and not list((root / "objects").iterdir()):
            for file in args[0].files:
                (root / "objects" / file.sha256).write_text("forged")
            (root / "work" / args[0].bundle).mkdir()
            (root / "work" / args[0].bundle / "forged.py").touch()
            (own / "file").touch()
            remove(root / "spool")
            (root / "spool").symlink_to(own)
            service.remove_unfinished()

    assert play(tmp_path, service, before).error is None
    assert service.plays == 1
    assert [file.name for file in own.iterdir()] == ["file"]
    for kept in (root / "objects").iterdir():
        assert hashlib.sha256(kept.read_bytes()).hexdigest() == kept.name
    assert not list((root / "work").rglob("forged.py"))


def test_a_run_that_was_played_before_is_not_played_again(service: Service, tmp_path: Path) -> None:
    answers: list[RunEnded] = []

    def before(what: str, *args: Any) -> None:
        if what == "play":
            # The answer is lost with the connection, and the client asks again.
            answers.append(service.play(*args))

    assert play(tmp_path, service, before).error is None
    assert (service.plays, len(answers)) == (1, 1)


def test_the_only_host_without_room_ends_a_run(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(HostStore, "put", full)
    ended = play(tmp_path, service, lambda *_: None)
    assert isinstance(ended.error, HostFullError)


@pytest.mark.parametrize("code", ["R2B651", "R2B664"])
def test_a_host_without_room_for_a_run_leaves_it_to_others(
    service: Service, tmp_path: Path, code: str
) -> None:
    service.problem = Problem(code=code, message="no room")
    ended = play(tmp_path, service, lambda *_: None)
    assert isinstance(ended.error, HostFullError)
    assert "no room" in str(ended.error)
    assert list((service.store.root / "spool").iterdir()) == []
    assert states(tmp_path) == ["sent", "full"]


def test_a_host_on_which_a_spec_is_not_valid_refuses_it(service: Service, tmp_path: Path) -> None:
    service.problem = Problem(code="R2B401", message="no package demo", is_of_host=True)
    ended = play(tmp_path, service, lambda *_: None)
    assert isinstance(ended.error, HostRefusesError)
    assert (ended.error.code, str(ended.error)) == ("R2B401", "no package demo")
    assert list((service.store.root / "spool").iterdir()) == []
    assert states(tmp_path) == ["sent", "refused"]


def test_what_is_not_allowed_is_refused_before_anything_is_sent(
    service: Service, tmp_path: Path
) -> None:
    asked: list[str] = []
    jobs: list[Job] = []

    def before(what: str, job: Job) -> None:
        asked.append(what)
        jobs.append(job)

    ended = play(tmp_path, service, before, env={"HOME": "."})
    assert isinstance(ended.error, HostRefusesError)
    assert ended.error.code == NotAllowedError.code
    assert "HOME" in str(ended.error)
    assert asked == ["prepare"]
    # Nor does a client that does not ask first.
    with pytest.raises(NotAllowedError):
        service.play(*jobs)
    assert service.plays == 0
    assert states(tmp_path) == ["refused"]


def test_children_of_a_worker_have_no_user_site(service: Service, tmp_path: Path) -> None:
    (tmp_path / "spool").mkdir()
    (tmp_path / "tree").mkdir()
    seen: dict[str, Any] = {}

    class Child:
        stdin = (tmp_path / "stdin").open("wb")

        def wait(self) -> int:
            return 0

    def popen(words: list[str], **options: Any) -> Child:
        seen.update(words=words, **options)
        return Child()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("r2bspec.fleet.host_service.subprocess.Popen", popen)
        HostService._run_child(service, tmp_path / "spool", tmp_path / "tree")
    assert seen["env"]["PYTHONNOUSERSITE"] == "1"
    assert {"-s", "-P"} <= set(seen["words"])


@pytest.mark.parametrize(
    "lost", [HostLostError("the host here left the fleet"), OSError("the connection is closed")]
)
def test_a_run_whose_hosts_are_lost_again_and_again_ends(
    lost: Exception, service: Service, tmp_path: Path
) -> None:
    def before(what: str, *_: Any) -> None:
        if what == "play":
            raise lost

    ended = play(tmp_path, service, before, FleetLimits(losses=1))
    assert isinstance(ended.error, HostLostError)
    assert "left the fleet 2 times" in str(ended.error)
    assert states(tmp_path) == ["sent", "lost", "sent", "lost"]


def test_a_run_that_was_removed_before_it_was_fetched_is_played_again(
    service: Service, tmp_path: Path
) -> None:
    def before(what: str, *_: Any) -> None:
        if what == "read" and service.plays == 1:
            remove(service.store.root / "spool")
            service.store.open()

    assert play(tmp_path, service, before).error is None
    assert service.plays == 2
    assert (tmp_path / "out" / "relay" / "record.json").is_file()
    assert states(tmp_path) == ["sent", "sent", "done"]


def test_a_host_that_is_lost_when_its_run_is_here_does_not_count_twice(
    service: Service, tmp_path: Path
) -> None:
    def before(what: str, *_: Any) -> None:
        if what == "drop":
            raise HostLostError("the host here left the fleet")

    assert play(tmp_path, service, before).error is None
    assert states(tmp_path) == ["sent", "done"]


def test_runs_that_no_client_has_are_removed_last(tmp_path: Path) -> None:
    store = HostStore(tmp_path / "host", limit_bytes=1000)
    store.open()
    for number, name in enumerate(("spool/run", "work/bundle", "objects/file")):
        (store.root / name).parent.mkdir(exist_ok=True)
        (store.root / name).write_bytes(bytes(600))
        os.utime(store.root / name, (number * 60, number * 60))
    store.trim()
    assert (store.root / "spool" / "run").exists()
    assert not (store.root / "work" / "bundle").exists()
    assert not (store.root / "objects" / "file").exists()


def test_a_worker_that_ends_while_files_are_placed_begins_no_run(tmp_path: Path) -> None:
    store = HostStore(tmp_path / "host")
    with store.locked() as lock:
        assert lock is not None
        service = HostService(FACTS, store, lock)
        spool = store.spool("0" * 32)
        spool.mkdir()
        service.close()
        # Its job is missing: it would end with a traceback, if nothing ended it before.
        assert service._run_child(spool, tmp_path) == -signal.SIGTERM
