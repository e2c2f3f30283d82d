"""A host that lies: nothing of it is counted, the user is told, and another host makes the run."""

from __future__ import annotations

import dataclasses
import gzip
import hashlib
import sys
import tarfile
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import msgspec
import pytest

pytest.importorskip("distributed")

from direct_hosts import Answering, DirectClient, Service, run_of, service_in, write_run
from r2bspec.fleet import fleet_runs, host_store
from r2bspec.fleet.bundle import Job, digest_of
from r2bspec.fleet.client import _host
from r2bspec.fleet.errors import FalseAnswerError, HostLostError, TransferError
from r2bspec.fleet.fleet_runs import EndedRun, FleetLimits, FleetRun, FleetRuns
from r2bspec.fleet.host_store import pack_run, unpack_run
from r2bspec.fleet.hosts import Host, HostFacts
from r2bspec.fleet.journal import Journal, read_journal
from r2bspec.fleet.messages import (
    FACTS,
    Call,
    HostState,
    RunEnded,
    answer_of,
    read_answer,
    read_request,
    request_of,
)
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.safe_io.limits import MAX_RUN_FOLDER_LEVELS

Packing = Callable[[Path], object]
"""Writes the archive of a run."""


class Liar(Service):
    """A host whose archives are made by `packed`."""

    packed: Packing

    def play(self, job: Job) -> RunEnded:
        """Play, and exchange what was played."""
        played = super().play(job)
        archive = self.store.spool(job.identity) / "run.tar.gz"
        if played.problem is None:
            archive.unlink()
            self.packed(archive)
        return msgspec.structs.replace(
            played, size=archive.stat().st_size, sha256=digest_of(archive)
        )


def packing(folder: Path, packed: Packing) -> Answering:
    """A host whose archives are made by `packed`."""
    liar = service_in(folder / "host-liar", "liar", Liar)
    assert isinstance(liar, Liar)
    liar.packed = packed
    return liar.answer


def lying(folder: Path, method: str, value: Any) -> Answering:
    """A host that is honest, but for its answers to one method."""
    honest = service_in(folder / "host-liar", "liar")

    def answer(request: bytes) -> bytes:
        is_lie = read_request(request)[0] == method
        return answer_of(request, value) if is_lie else honest.answer(request)

    return answer


class Suite:
    """A run that several hosts may make, one after the other."""

    def __init__(
        self, folder: Path, limits: FleetLimits | None = None, run: FleetRun | None = None
    ) -> None:
        self.root = folder / "out"
        self.root.mkdir(exist_ok=True)
        self.run = dataclasses.replace(run or run_of(folder), folder=self.root / "relay")
        self.limits = limits or FleetLimits()
        self.notes: list[str] = []

    def play(self, answering: dict[str, Answering], *more: FleetRun) -> list[EndedRun]:
        """Play on these hosts; the first has its turn first."""
        journal = Journal(self.root)
        client: Any = DirectClient(answering)
        runs = FleetRuns(
            client, self.root, journal, self.limits, self.notes.append, lambda *_: None
        )
        any_host = dataclasses.replace(self.run, hosts=frozenset(answering))
        try:
            return list(runs.play([any_host, *more]))
        finally:
            journal.close()

    def states(self) -> list[tuple[str, str]]:
        return [(event.host, event.state) for event in read_journal(self.root) if event.state]


def is_found_out(folder: Path, liar: Answering, match: str) -> None:
    """See that a lie is refused with the name of the host, and another host makes the run."""
    suite = Suite(folder)
    (ended,) = suite.play({"liar": liar, "true": service_in(folder / "host-true", "true").answer})
    assert (ended.host, ended.error) == ("true", None)
    assert (ended.run.folder / "record.json").is_file()
    (note,) = suite.notes
    assert note.startswith("liar: ")
    assert "the host liar" in note or "archive" in note or "did not arrive" in note
    assert match in note
    assert ("liar", "refused") in suite.states()
    assert [state for state in suite.states() if state[1] == "done"] == [("true", "done")]
    assert not list(suite.root.rglob("*.tar.gz"))
    assert sorted(path.name for path in suite.root.iterdir()) == ["fleet.jsonl", "relay"]
    # Where there is no other one, the run counts as not made, with the cause and a way out.
    (folder / "alone").mkdir()
    alone = Suite(folder / "alone", run=suite.run)
    (ended,) = alone.play({"liar": liar})
    assert ended.error is not None
    assert ended.error.code == "R2B686"
    assert match in str(ended.error)
    assert not ended.run.folder.exists()


def test_an_answer_to_another_request_is_refused(tmp_path: Path) -> None:
    honest = service_in(tmp_path / "host-liar", "liar")
    answers: list[bytes] = []

    def replayed(request: bytes) -> bytes:
        answers.append(honest.answer(request))
        return answers[0]

    with pytest.raises(FalseAnswerError, match="another request") as refused:
        for _ in range(2):
            request = request_of(Call("drop", ("0" * 32,)))
            read_answer("liar", "drop", request, replayed(request))
    assert refused.value.hint
    is_found_out(tmp_path, lambda request: answer_of(request + b" ", {}), "another request")


@pytest.mark.parametrize(
    "content",
    [
        *(b"", b"\xc1", b"hello", 7, "text", {"value": 1}, b"\x80" * 100_000),
        msgspec.msgpack.encode([[[[]]]]),
    ],
)
def test_what_is_no_answer_is_refused(content: Any, tmp_path: Path) -> None:
    is_found_out(tmp_path, lambda _: content, "its answer is none")


@pytest.mark.parametrize(
    ("method", "value"),
    [
        *product(["prepare"], [[], {"x": 1}, {"0" * 64: -1}, "x", None]),
        *product(["play"], [None, {"size": -1}, {"size": 1 << 60}, {"outcome": 7}]),
        ("play", {"problem": {"code": "\x1b[31m", "message": "no"}}),
    ],
)
def test_an_answer_of_another_type_is_refused(method: str, value: Any, tmp_path: Path) -> None:
    is_found_out(tmp_path, lying(tmp_path, method, value), "its answer is none")


def test_a_file_that_is_not_of_the_spec_is_not_sent(tmp_path: Path) -> None:
    secret = hashlib.sha256(b"a file of the client").hexdigest()
    is_found_out(tmp_path, lambda request: answer_of(request, {secret: 0}), "not of the spec")


def test_a_result_without_a_run_is_refused(tmp_path: Path) -> None:
    played = RunEnded(outcome="pass")
    is_found_out(tmp_path, lying(tmp_path, "play", played), "nothing of the run")


@pytest.mark.parametrize("piece", [b"", b"x", bytes(5 << 20)])
def test_pieces_of_another_length_are_refused(piece: bytes, tmp_path: Path) -> None:
    is_found_out(tmp_path, lying(tmp_path, "read", piece), "does not hand out its run")


def test_a_digest_that_is_not_that_of_the_archive_is_refused(tmp_path: Path) -> None:
    honest = service_in(tmp_path / "host-liar", "liar")

    def altered(request: bytes) -> bytes:
        method, args = read_request(request)
        if method != "play":
            return honest.answer(request)
        played = msgspec.structs.replace(honest.play(*args), sha256="0" * 64)
        return answer_of(request, played)

    is_found_out(tmp_path, altered, "did not arrive as the host liar sent it")


def test_more_than_the_disk_holds_is_not_fetched(tmp_path: Path) -> None:
    played = RunEnded(outcome="pass", size=64 << 40, sha256="0" * 64)
    liar = lying(tmp_path, "play", played)
    asked: list[str] = []

    def noting(request: bytes) -> Any:
        asked.append(read_request(request)[0])
        return liar(request)

    is_found_out(tmp_path, noting, "too much for here")
    assert "read" not in asked


def archive_of(*entries: tarfile.TarInfo) -> Packing:
    """An archive with these entries, all of them empty."""

    def pack(archive: Path) -> None:
        with tarfile.open(archive, "w:gz", compresslevel=1) as tar:
            for one in entries:
                tar.addfile(one)

    return pack


def entry(name: str, kind: bytes = tarfile.REGTYPE, **fields: Any) -> tarfile.TarInfo:
    made = tarfile.TarInfo(name)
    made.type = kind
    for field, value in fields.items():
        setattr(made, field, value)
    return made


def content_of(content: bytes) -> Packing:
    """An archive that no library would write."""
    return lambda archive: archive.write_bytes(gzip.compress(content, 1))


def header(name: str, kind: bytes = tarfile.REGTYPE, **fields: Any) -> bytes:
    return entry(name, kind, **fields).tobuf(tarfile.GNU_FORMAT)


LONG_NAME = header("x", tarfile.GNUTYPE_LONGNAME, size=2) + b"x\0".ljust(512, b"\0")
DAMAGED = gzip.compress(bytes(9999))[:10] + b"\xff" * 90
ARCHIVES: dict[str, Packing] = {
    "a link": archive_of(entry("l", tarfile.SYMTYPE, linkname="/etc/passwd")),
    "a hard link": archive_of(entry("l", tarfile.LNKTYPE, linkname="record.json")),
    "a device": archive_of(entry("d", tarfile.CHRTYPE, devmajor=1)),
    "a pipe": archive_of(entry("p", tarfile.FIFOTYPE)),
    "an absolute name": archive_of(entry("/x/../../../tmp/evil")),
    "a way out": archive_of(entry("../evil")),
    "a deep way out": archive_of(entry("a/b/../../../evil")),
    "64 GiB declared": content_of(header("big", size=(64 << 30) + 1)),
    "a sparse file": content_of(header("big", tarfile.GNUTYPE_SPARSE)),
    "many files": archive_of(*(entry(f"f{number}") for number in range(52))),
    "headers without end": content_of(LONG_NAME * 2000),
    "a header for the memory": content_of(header("x", tarfile.XHDTYPE, size=1 << 20)),
    "a long name": archive_of(entry("n" * 3000)),
    "a file in a file": archive_of(entry("a"), entry("a/b")),
    "half of it": lambda archive: archive.write_bytes(gzip.compress(header("x"), 1)[:-9]),
    "no gzip": lambda archive: archive.write_bytes(b"hello"),
    "damaged": lambda archive: archive.write_bytes(DAMAGED),
    "nothing": content_of(bytes(1024)),
}


@pytest.mark.parametrize("what", ARCHIVES)
def test_archives_that_are_none_of_a_run_are_refused(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host_store, "MAX_BUNDLE_FILES", 50)
    before = set(tmp_path.parent.iterdir())
    is_found_out(tmp_path, packing(tmp_path, ARCHIVES[what]), "")
    assert set(tmp_path.parent.iterdir()) == before
    assert not Path("/tmp/evil").exists()  # noqa: S108


def test_a_bomb_writes_no_more_than_the_half_of_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host_store, "MAX_FLEET_RUN_BYTES", 1 << 20)
    content = b"".join(header(f"f{at}", size=300 << 10) + bytes(300 << 10) for at in range(50))
    content_of(content)(tmp_path / "bomb.tar.gz")
    assert (tmp_path / "bomb.tar.gz").stat().st_size < len(content) // 100
    with pytest.raises(TransferError, match="too large"):
        unpack_run(tmp_path / "bomb.tar.gz", tmp_path / "target")
    assert sum(file.stat().st_size for file in (tmp_path / "target").iterdir()) < 1 << 20


def test_folders_that_a_node_has_left_do_not_keep_a_run_on_its_host(tmp_path: Path) -> None:
    run, archive, arrived = tmp_path / "run", tmp_path / "run.tar.gz", tmp_path / "arrived"
    Path(run, *400 * ["d"]).mkdir(parents=True)
    (run / "record.json").touch()
    whole = sys.getrecursionlimit()
    sys.setrecursionlimit(300)
    try:
        pack_run(run, archive)
        unpack_run(archive, arrived)
    finally:
        sys.setrecursionlimit(whole)
    assert (arrived / "record.json").is_file()
    assert Path(arrived, *MAX_RUN_FOLDER_LEVELS * ["d"]).is_dir()
    assert not Path(arrived, *(MAX_RUN_FOLDER_LEVELS + 1) * ["d"]).exists()


def forged(plan: str, run_id: str = "1") -> Packing:
    def pack(archive: Path) -> None:
        write_run(archive.parent / "forged", plan, run_id)
        pack_run(archive.parent / "forged", archive)

    return pack


@pytest.mark.parametrize(
    ("plan", "match"), [("{}", "is no run"), ("", "is no run"), ("other", "another benchmark")]
)
def test_a_run_of_another_benchmark_is_refused(plan: str, match: str, tmp_path: Path) -> None:
    if plan == "other":
        (tmp_path / "other").mkdir()
        other = msgspec.structs.replace(run_of(tmp_path / "other").head.plan, title="other")
        plan = canonical_json(other).decode()
    is_found_out(tmp_path, packing(tmp_path, forged(plan)), match)


def test_one_run_does_not_count_for_two(tmp_path: Path) -> None:
    suite = Suite(tmp_path)
    liar = packing(tmp_path, forged(canonical_json(suite.run.head.plan).decode()))
    second = dataclasses.replace(suite.run, folder=suite.root / "second", hosts=frozenset({"liar"}))
    first, refused = suite.play({"liar": liar}, second)
    assert first.error is None
    assert isinstance(refused.error, FalseAnswerError)
    assert f"its run is that in {first.run.folder}" in str(refused.error)
    assert [path.parent for path in suite.root.rglob("record.json")] == [first.run.folder]


@pytest.mark.parametrize("silent", ["prepare", "play"])
def test_a_host_that_never_answers_is_given_up(
    silent: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_runs, "_longest_s", lambda *_: 0.0)
    honest = service_in(tmp_path / "host-mute", "mute")

    def mute(request: bytes) -> bytes | None:
        return None if read_request(request)[0] == silent else honest.answer(request)

    suite = Suite(tmp_path, FleetLimits(lost_s=0.05))
    (ended,) = suite.play({"mute": mute, "true": service_in(tmp_path / "host-true", "true").answer})
    assert (ended.host, ended.error) == ("true", None)
    assert "the host mute has not answered for" in suite.notes[0]
    assert ("mute", "lost") in suite.states()
    assert [state for state in suite.states() if state[1] == "done"] == [("true", "done")]
    (tmp_path / "alone").mkdir()
    alone = Suite(tmp_path / "alone", FleetLimits(lost_s=0.05), suite.run)
    (ended,) = alone.play({"mute": mute})
    assert isinstance(ended.error, HostLostError)
    assert "mute" in str(ended.error)


def test_a_host_that_plays_for_others_is_waited_for() -> None:
    steps: Any = iter(())
    host = Host("a", HostFacts(name="a"), HostState())
    loop = fleet_runs._HostLoop(host, 1, steps, call=Call("read", ("1", 0, 1)))
    assert loop.is_others(HostState(state="playing", identity="2" * 32))
    assert not loop.is_others(HostState())


@pytest.mark.parametrize(
    "changes",
    [
        *({"name": name} for name in ("", "..", ".x", "a/b", "a\n", "a\0b", "a,b", "n" * 300, 7)),
        *({"cores": "x"}, {"labels": []}, {"doctor": {"x": 7}}, {"allows": "commands"}),
    ],
)
def test_a_worker_that_is_no_host_of_r2bspec_is_left_out(changes: dict[str, Any]) -> None:
    facts = {"name": "here"} | changes
    assert _host("a", {FACTS: facts, "name": facts["name"], "metrics": {}}) is None


@pytest.mark.parametrize(
    "state",
    [
        *({"left_s": wrong} for wrong in ("x", -1, float("nan"), float("inf"), (), 1e300)),
        *({"p99_ns": wrong} for wrong in ("x", -1, 1.5, 1 << 62)),
        *({"name": 7}, {"phase": {}}, {"identity": []}, [], "idle", {"state": None}),
    ],
)
def test_a_state_that_cannot_be_is_that_of_no_host(state: Any) -> None:
    worker = {FACTS: {"name": "here"}, "name": "here", "metrics": {FACTS: state}}
    assert _host("a", worker) is None
    assert _host("a", worker | {"metrics": {}}) is not None


def test_a_host_does_not_take_the_name_of_another() -> None:
    # Dask has no two workers of one name.
    assert _host("a", {FACTS: {"name": "carter"}, "name": "thief"}) is None
