"""A client that sends what none of r2bspec would: refused, nothing is written or played."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

pytest.importorskip("distributed")

from direct_hosts import Service, run_of, service_in
from r2bspec.fleet.bundle import (
    Bundle,
    Job,
    SentFile,
    SentRecording,
    Side,
    bundle_digest,
    make_bundle,
)
from r2bspec.fleet.messages import Answer, Call, Problem, request_of
from r2bspec.safe_io.limits import MAX_BUNDLE_BYTES

IDENTITY = "0" * 32
SHA256 = hashlib.sha256(b"x").hexdigest()


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    """A host; whatever a client does, nothing is written beside its folder."""
    (tmp_path / "outside").mkdir()
    made = service_in(tmp_path / "host")
    yield made
    assert list((tmp_path / "outside").iterdir()) == []
    assert {path.name for path in made.store.root.iterdir()} == {"objects", "work", "spool"}


def refusal(service: Service, request: bytes) -> Problem:
    """What the host says; it plays nothing."""
    plays = service.plays
    answer = msgspec.msgpack.decode(service.answer(request), type=Answer)
    assert answer.problem is not None
    assert service.plays == plays
    assert answer.problem.code != "R2B690"
    return answer.problem


def job_of(bundle: Bundle, /, **changes: Any) -> Job:
    job = Job(
        identity=IDENTITY,
        name="relay",
        bundle=bundle.digest,
        files=bundle.files,
        recordings=bundle.recordings,
        head=bundle.sides[0],
    )
    return msgspec.structs.replace(job, **changes)


def of_files(*files: SentFile) -> dict[str, Any]:
    """The changes to a job that has other files, and says so."""
    return {"files": files, "bundle": bundle_digest(files)}


def offered(service: Service, job: Job, bundle: Bundle) -> None:
    """Offer a job, and send what it lacks."""
    for sha256 in service.prepare(job):
        content = bundle.sources[sha256].read_bytes()
        file = next(file for file in job.files if file.sha256 == sha256)
        service.put(file, 0, content)
    assert service.prepare(job) == {}


@pytest.mark.parametrize(
    "request_bytes",
    [
        *(b"", b"\xc1", b"hello", b"\x80" * 100_000, b"\x93\xa0\xa0"),
        *(
            msgspec.msgpack.encode(("", method, ()))
            for method in (
                "",
                "close",
                "state",
                "answer",
                "__init__",
                "_run_child",
                "store",
                "name",
            )
        ),
    ],
)
def test_what_is_no_request_is_refused(request_bytes: bytes, service: Service) -> None:
    refusal(service, request_bytes)


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "", ".", "x", SHA256 + "\n", "A" * 64, 7])
def test_what_names_no_file_is_refused(name: Any, service: Service) -> None:
    file = {"path": "x", "size": 1, "sha256": name}
    for call in (
        Call("read", (name, 0, 1)),
        Call("drop", (name,)),
        Call("put", (file, 0, b"x")),
    ):
        assert "no request" in refusal(service, request_of(call)).message


@pytest.mark.parametrize(
    ("size", "offset", "piece"),
    [(1, 1, b""), (1, 1 << 40, b"x"), (1, 0, b"xx"), (9, 5, b"x"), (0, 0, b"x")],
)
def test_a_piece_that_does_not_follow_is_refused(
    size: int, offset: int, piece: bytes, service: Service
) -> None:
    file = SentFile(path="x", size=size, sha256=SHA256)
    refused = refusal(service, request_of(Call("put", (file, offset, piece))))
    assert "did not arrive as it was sent" in refused.message
    assert list((service.store.root / "objects").iterdir()) == []


@pytest.mark.parametrize(("size", "offset"), [(-1, 0), (1, -1), (1 << 60, 0), (1, 1 << 60)])
def test_impossible_sizes_are_refused(size: int, offset: int, service: Service) -> None:
    file = {"path": "x", "size": size, "sha256": SHA256}
    refusal(service, request_of(Call("put", (file, offset, b"x"))))


def test_a_file_of_another_digest_is_not_kept(service: Service) -> None:
    file = SentFile(path="x", size=1, sha256=SHA256)
    assert "did not arrive" in refusal(service, request_of(Call("put", (file, 0, b"y")))).message
    assert list((service.store.root / "objects").iterdir()) == []


def test_files_that_are_not_those_of_the_bundle_are_refused(
    service: Service, tmp_path: Path
) -> None:
    bundle = make_bundle(run_of(tmp_path).sides)
    more = SentFile(path="os.py", size=1, sha256=SHA256)
    for job in (
        job_of(bundle, bundle="0" * 64),
        job_of(bundle, files=(*bundle.files, more)),
        job_of(bundle, **of_files(*[more] * 20_001)),
        job_of(bundle, **of_files(msgspec.structs.replace(more, size=MAX_BUNDLE_BYTES + 1))),
    ):
        for method in ("prepare", "play"):
            refused = refusal(service, request_of(Call(method, (job,))))
            assert "are not those of a bundle" in refused.message
            assert refused.kind == "TransferError"


@pytest.mark.parametrize("path", ["../outside/x", "/tmp/x", "a/../../x", "", "a\0b"])  # noqa: S108
def test_no_path_of_a_job_leads_out(path: str, service: Service, tmp_path: Path) -> None:
    bundle = make_bundle(run_of(tmp_path).sides)
    offered(service, job_of(bundle), bundle)
    service.put(SentFile(path="x", size=1, sha256=SHA256), 0, b"x")
    file = SentFile(path=path, size=1, sha256=SHA256)
    side = msgspec.structs.replace(bundle.sides[0], base_dir=path)
    recordings = (SentRecording(path=path, sha256=SHA256),)
    for job in (
        job_of(bundle, **of_files(*bundle.files, file)),
        job_of(bundle, head=side),
        *([job_of(bundle, recordings=recordings)] if path.startswith("/") else []),
    ):
        for method in ("prepare", "play"):
            if method == "prepare" or job.recordings != recordings:
                refusal(service, request_of(Call(method, (job,))))


def test_a_link_in_a_tree_is_not_followed(service: Service, tmp_path: Path) -> None:
    """A run may leave links in its folder, for the next client that has the same files."""
    bundle = make_bundle(run_of(tmp_path).sides)
    service.put(SentFile(path="x", size=1, sha256=SHA256), 0, b"x")
    file = SentFile(path="config/deep/x", size=1, sha256=SHA256)
    job = job_of(bundle, **of_files(*bundle.files, file))
    offered(service, job, bundle)
    tree = service.store.root / "work" / job.bundle
    (tree / "config/deep/x").unlink()
    (tree / "config/deep/x").symlink_to(tmp_path / "outside" / "x")
    assert service.prepare(job) == {}
    assert not (tree / "config/deep/x").is_symlink()
    (tree / "config/deep/x").unlink()
    (tree / "config/deep").rmdir()
    (tree / "config/deep").symlink_to(tmp_path / "outside")
    assert service.prepare(job) == {}
    assert (tree / "config/deep/x").read_text() == "x"


@pytest.mark.parametrize("kind", ["device", "pipe"])
def test_a_recording_without_end_is_not_read(kind: str, service: Service, tmp_path: Path) -> None:
    place = Path("/dev/zero")
    if kind == "pipe":
        place = tmp_path / "pipe"
        os.mkfifo(place)
    bundle = make_bundle(run_of(tmp_path).sides)
    offered(service, job_of(bundle), bundle)
    job = job_of(bundle, recordings=(SentRecording(path=str(place), sha256=SHA256),))
    assert refusal(service, request_of(Call("prepare", (job,)))).code == "R2B301"


def test_a_setup_file_of_the_client_needs_a_permission(service: Service, tmp_path: Path) -> None:
    bundle = make_bundle(run_of(tmp_path).sides)
    for environment in ("./setup.bash", "/opt/x/setup.bash", "LD_PRELOAD=./x.so"):
        job = job_of(bundle, compares=True, environments=(environment,))
        refused = refusal(service, request_of(Call("play", (job,))))
        assert (refused.code, "--allow-commands" in refused.message) == ("R2B685", True)


def test_a_plan_that_is_none_is_refused(service: Service, tmp_path: Path) -> None:
    bundle = make_bundle(run_of(tmp_path).sides)
    for plan in ("", "{}", "[" * 100_000, '{"r2bspec_plan": 1}'):
        side = Side(plan=plan, spec_text="", base_dir=".")
        refusal(service, request_of(Call("prepare", (job_of(bundle, head=side),))))
        base = job_of(bundle, base=side)
        refusal(service, request_of(Call("play", (base,))))


def test_a_replayed_request_plays_nothing_twice(service: Service, tmp_path: Path) -> None:
    bundle = make_bundle(run_of(tmp_path).sides)
    offered(service, job_of(bundle), bundle)
    request = request_of(Call("play", (job_of(bundle),)))
    answers = {service.answer(request) for _ in range(3)}
    assert (len(answers), service.plays) == (1, 1)
    service.answer(request_of(Call("drop", (IDENTITY,))))
    assert refusal(service, request_of(Call("read", (IDENTITY, 0, 1)))).kind == "TransferError"
