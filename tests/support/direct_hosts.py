"""Hosts of a fleet without Dask and without ROS between them and their clients."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import msgspec

from r2bspec._version import __version__
from r2bspec.api import PreparedBenchmark
from r2bspec.errors import R2bspecError
from r2bspec.fleet.bundle import Job
from r2bspec.fleet.fleet_runs import FleetRun
from r2bspec.fleet.host_service import HostService
from r2bspec.fleet.host_store import ENDED_FILE, JOB_FILE, RUN_FOLDER, HostStore
from r2bspec.fleet.hosts import Host, HostFacts
from r2bspec.fleet.messages import Call, HostState, Problem, RunEnded, read_answer, request_of
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.compile_plan import compile_plan
from ros_runs import Bench, relay_spec
from run_simulation import EMPTY_RECORD

FACTS = HostFacts(name="here", r2bspec=__version__)

Answering = Callable[[bytes], Any]
"""What a host makes of a request."""


def write_run(folder: Path, plan: str, run_id: str) -> None:
    """The folder of a run of a plan, without samples."""
    folder.mkdir(parents=True)
    (folder / "plan.json").write_text(plan)
    digest = f"sha256:{hashlib.sha256(plan.encode()).hexdigest()}"
    record = msgspec.structs.replace(EMPTY_RECORD, run_id=run_id, plan_hash=digest)
    (folder / "record.json").write_bytes(msgspec.json.encode(record))


class Service(HostService):
    """A host whose runs have no ROS in them."""

    plays = 0
    problem: Problem | None = None

    def _run_child(self, spool: Path, tree: Path) -> int:
        assert (tree / "bag" / "metadata.yaml").is_file()
        self.plays += 1
        job = msgspec.json.decode((spool / JOB_FILE).read_bytes(), type=Job)
        write_run(spool / RUN_FOLDER, job.head.plan, secrets.token_hex(8))
        played = RunEnded(outcome="pass", problem=self.problem)
        (spool / ENDED_FILE).write_bytes(msgspec.json.encode(played))
        return 0


def service_in(folder: Path, name: str = FACTS.name, kind: type[Service] = Service) -> Service:
    """A host that keeps what it is sent in a folder."""
    store = HostStore(folder)
    store.open()
    return kind(msgspec.structs.replace(FACTS, name=name), store)


class DirectClient:
    """A fleet whose hosts answer as they please; one that answers None says nothing."""

    connections = 1

    def __init__(self, answering: dict[str, Answering]) -> None:
        self._answering = answering
        self.hosts = {
            name: Host(name, msgspec.structs.replace(FACTS, name=name), HostState())
            for name in answering
        }

    def refresh(self) -> bool:
        return True

    def submit(self, host: Host, call: Call) -> Future[Any]:
        answer: Future[Any] = Future()
        request = request_of(call)
        try:
            if (content := self._answering[host.name](request)) is None:
                return answer
            answer.set_result(read_answer(host.name, call.method, request, content))
        except R2bspecError as error:
            answer.set_exception(error)
        return answer


def run_of(folder: Path, **node: Any) -> FleetRun:
    """A run of a relay on a small recording."""
    spec = relay_spec()
    spec["graph"]["nodes"]["relay"] |= node
    loaded = load_spec(Bench(folder / "bench").write(spec))
    assert loaded.spec is not None
    side = PreparedBenchmark(compile_plan(loaded.spec, None), folder / "bench", "")
    return FleetRun(
        name="relay", folder=folder / "out" / "relay", head=side, hosts=frozenset({"here"})
    )
