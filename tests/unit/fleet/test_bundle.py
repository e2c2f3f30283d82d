"""What travels with a plan, and what a host keeps of it."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from r2bspec import api
from r2bspec.bags.integrity import hash_files
from r2bspec.errors import ExitStatus
from r2bspec.fleet.bundle import Bundle, Job, make_bundle
from r2bspec.fleet.errors import (
    HostFullError,
    HostLostError,
    HostRefusesError,
    NotAllowedError,
    TransferError,
)
from r2bspec.fleet.host_store import HostStore
from r2bspec.fleet.messages import Problem
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.compile_plan import compile_plan
from ros_runs import Bench, relay_spec

NODE = "import near\nimport os\n\n\nclass Own:\n    pass\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of specs, with files that the spec names and files that it does not."""
    made = tmp_path / "work" / "specs"
    Bench(made)
    (made / "own.py").write_text(NODE)
    (made / "near.py").write_text("import far\n")
    (made / "far.py").write_text("")
    (made / "secret.txt").write_text("not to be sent")
    (made.parent / "config").mkdir()
    (made.parent / "config" / "relay.yaml").write_text("/**:\n  ros__parameters: {queue: 3}\n")
    tool = made / "tool.sh"
    tool.write_text("#!/bin/sh\n")
    tool.chmod(0o755)
    return made


def prepared(folder: Path, **changes: Any) -> api.PreparedBenchmark:
    changes = {"setup": {"make": {"command": ["./tool.sh", "--fast"]}}} | changes
    spec = relay_spec(**changes)
    spec["graph"]["nodes"]["own"] = {
        "python": "./own.py:Own",
        "parameters": {"model": "../config/relay.yaml"},
    }
    path = folder / "relay.r2b.yaml"
    path.write_text(yaml.safe_dump(spec))
    loaded = load_spec(path)
    assert loaded.spec is not None, loaded.diagnostics
    return api.PreparedBenchmark(compile_plan(loaded.spec, None), folder, loaded.resolved_yaml())


def bundle_of(folder: Path, **changes: Any) -> Bundle:
    return make_bundle([prepared(folder, **changes)])


def job_of(bundle: Bundle, identity: str = "x") -> Job:
    return Job(
        identity=identity,
        name="relay",
        head=bundle.sides[0],
        bundle=bundle.digest,
        files=bundle.files,
        recordings=bundle.recordings,
    )


@pytest.fixture
def store(tmp_path: Path) -> HostStore:
    """What a host keeps: nothing yet."""
    store = HostStore(tmp_path / "host")
    store.open()
    return store


def send(store: HostStore, bundle: Bundle, job: Job, piece_bytes: int = 1000) -> int:
    """Send everything that the store lacks, in pieces; returns how many."""
    pieces = 0
    files = {file.sha256: file for file in job.files}
    for sha256, here in store.missing(job).items():
        content = bundle.sources[sha256].read_bytes()
        for offset in range(here, max(len(content), 1), piece_bytes):
            store.put(files[sha256], offset, content[offset : offset + piece_bytes])
            pieces += 1
    return pieces


def test_only_what_the_plan_names_is_sent_with_what_it_imports(folder: Path) -> None:
    bundle = bundle_of(folder)
    assert {file.path for file in bundle.files if not file.recording} == {
        "config/relay.yaml",
        "specs/far.py",
        "specs/near.py",
        "specs/own.py",
        "specs/tool.sh",
    }
    assert [file.path for file in bundle.files if file.executable] == ["specs/tool.sh"]
    assert bundle.sides[0].base_dir == "specs"
    assert [recording.path for recording in bundle.recordings] == ["specs/bag"]
    assert {file.path for file in bundle.files if file.recording} == {
        f"specs/bag/{file.name}" for file in (folder / "bag").iterdir()
    }


def test_the_digest_is_that_of_contents_not_of_places(folder: Path, tmp_path: Path) -> None:
    first = bundle_of(folder)
    copied = tmp_path / "elsewhere"
    shutil.copytree(folder.parent, copied)
    assert bundle_of(copied / "specs").digest == first.digest
    (copied / "specs" / "far.py").write_text("VALUE = 1\n")
    assert bundle_of(copied / "specs").digest != first.digest
    (copied / "specs" / "secret.txt").write_text("something else")
    (copied / "specs" / "far.py").write_text("")
    assert bundle_of(copied / "specs").digest == first.digest


def test_a_host_gets_everything_once_and_has_it_as_it_is_here(
    folder: Path, store: HostStore
) -> None:
    bundle = bundle_of(folder)
    job = job_of(bundle)
    assert send(store, bundle, job) > len(bundle.files)
    assert store.missing(job) == {}
    tree = store.unpack(job)
    assert (tree / "specs" / "own.py").read_text() == NODE
    assert os.access(tree / "specs" / "tool.sh", os.X_OK)
    assert {each.name for each in (tree / "specs" / "bag").iterdir()} == {
        each.name for each in (folder / "bag").iterdir()
    }
    assert hash_files(tree / "specs" / "bag") == bundle.recordings[0].sha256
    (tree / "specs" / "built").write_text("kept for the next run")
    (tree / "specs" / "own.py").write_text("changed by a run")
    store.unpack(job)
    assert (tree / "specs" / "built").exists()
    assert (tree / "specs" / "own.py").read_text() == NODE


def test_a_path_that_goes_up_and_comes_back_is_found_on_a_host(
    folder: Path, store: HostStore, tmp_path: Path
) -> None:
    name = f"../../../{tmp_path.name}/work/specs"
    loader = {"bag": f"{name}/bag", "topics": {"/camera": "loaded"}}
    bundle = bundle_of(folder, data_loader=loader, setup={"x": {"command": [f"{name}/tool.sh"]}})
    job = job_of(bundle)
    send(store, bundle, job)
    base_dir = store.unpack(job) / job.head.base_dir
    assert (base_dir / name / "bag" / "metadata.yaml").is_file()
    assert (base_dir / name / "tool.sh").is_file()
    assert base_dir.resolve().is_relative_to(tmp_path / "host" / "work" / bundle.digest)


def test_sending_goes_on_where_it_was_interrupted(folder: Path, store: HostStore) -> None:
    job = job_of(bundle := bundle_of(folder))
    largest = max(job.files, key=lambda file: file.size)
    store.put(largest, 0, bundle.sources[largest.sha256].read_bytes()[:500])
    assert store.missing(job)[largest.sha256] == 500
    send(store, bundle, job)
    assert store.missing(job) == {}


def test_recordings_of_a_shared_folder_are_not_sent(folder: Path, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shutil.copytree(folder / "bag", shared / "bag")
    store = HostStore(tmp_path / "host", shared=(shared,))
    store.open()
    bundle = bundle_of(folder)
    job = job_of(bundle)
    recorded = {file.sha256 for file in job.files if file.recording}
    assert not recorded & set(store.missing(job))
    send(store, bundle, job)
    place = store.unpack(job) / job.recordings[0].path
    assert place.resolve() == (shared / "bag").resolve()
    (shared / "bag" / "metadata.yaml").write_text("another one")
    assert recorded <= set(store.missing(job))
    send(store, bundle, job)
    assert hash_files(store.unpack(job) / job.recordings[0].path) == job.recordings[0].sha256


def test_the_least_recently_used_is_removed_first(folder: Path, tmp_path: Path) -> None:
    store = HostStore(tmp_path / "host", limit_bytes=1)
    store.open()
    bundle = bundle_of(folder)
    job = job_of(bundle)
    send(store, bundle, job)
    store.unpack(job)
    keep = {file.sha256 for file in job.files if file.recording}
    store.trim(keep)
    left = {each.name for kind in ("objects", "work") for each in (store.root / kind).iterdir()}
    assert left == keep
    store.trim()
    assert set(store.missing(job)) == {file.sha256 for file in job.files}


def test_an_error_travels_with_its_code_and_exit_status() -> None:
    sent = msgspec.msgpack.encode(Problem.of(NotAllowedError("no", hint="ask")))
    arrived = msgspec.msgpack.decode(sent, type=Problem).error
    assert isinstance(arrived, HostRefusesError)
    assert (str(arrived), arrived.hint, arrived.code) == ("no", "ask", "R2B685")
    assert arrived.exit_code == ExitStatus.USAGE
    for kind in (HostFullError, HostLostError, TransferError):
        assert type(Problem.of(kind("no", code="R2B123")).error) is kind
    played = Problem(code="R2B301", message="no", exit_status=ExitStatus.USAGE).error
    assert (played.code, str(played), played.exit_code) == ("R2B301", "no", ExitStatus.USAGE)
