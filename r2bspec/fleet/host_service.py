"""What a host does for its clients: takes files, plays one run at a time, hands its folder out."""

from __future__ import annotations

import contextlib
import fcntl
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec

from r2bspec.check.this_machine import LABELS_VARIABLE
from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus
from r2bspec.fleet.bundle import digest_of
from r2bspec.fleet.errors import HostFullError, HostLostError, TransferError, VersionDiffersError
from r2bspec.fleet.host_facts import HostFacts
from r2bspec.fleet.host_messages import (
    PROTOCOL,
    Job,
    Played,
    Prepared,
    Problem,
    Request,
    decode,
    encode,
    failed,
    problem_of,
    sides_of,
)
from r2bspec.fleet.host_store import HostStore, full_disk, remove
from r2bspec.fleet.host_validation import HostValidation, other_recordings
from r2bspec.fleet.permissions import check_allowed
from r2bspec.fleet.play_run import (
    ENDED_FILE,
    JOB_FILE,
    LOCK_FILE,
    PROGRESS_FILE,
    RUN_FOLDER,
    RunState,
)
from r2bspec.fleet.run_archive import pack
from r2bspec.plan.canonical_json import parse_plan
from r2bspec.plan.host_match import unmet
from r2bspec.private_files import user_umask
from r2bspec.record.atomic_files import write_atomically

_PLAYED_FILE: Final = "played.json"
_ARCHIVE: Final = "run.tar.gz"
_MAX_PIECE_BYTES: Final = 32 << 20
_NO_ROOM: Final = frozenset({"R2B651", "R2B664"})
"""A run that could not be written, and shared memory that is too small: another host may do."""


@dataclass
class HostService:
    """The one slot of a host, and its store.

    Attributes:
        facts: of the host.
        store: of its worker.
        environment: of the runs, in addition to that of the worker.
    """

    facts: HostFacts
    store: HostStore
    environment: dict[str, str] = field(default_factory=dict)
    _slot: threading.Lock = field(default_factory=threading.Lock)
    _playing: str = ""
    _child: subprocess.Popen[bytes] | None = None
    _closing: bool = False
    _validation: HostValidation = field(init=False)

    def __post_init__(self) -> None:
        labels = ",".join(f"{name}={value}" for name, value in self.facts.labels.items())
        self.environment = {**os.environ, **self.environment, LABELS_VARIABLE: labels}
        self._validation = HostValidation(self.facts.name, self.environment)

    def answer(self, content: bytes, piece: bytes) -> bytes:
        """Answer a request; a problem is an answer, too.

        Args:
            content: the JSON of a `Request`.
            piece: of a file, with ``put``.
        """
        try:
            with full_disk(self.facts.name):
                return self._answer(msgspec.json.decode(content, type=Request), piece)
        except HostFullError as error:
            with contextlib.suppress(OSError):
                self.store.trim(self._in_use())
            return failed(problem_of(error))
        except R2bspecError as error:
            return failed(problem_of(error))
        except (OSError, ValueError, msgspec.MsgspecError) as error:
            return failed(
                Problem(code="R2B682", message=f"the host {self.facts.name} failed: {error}")
            )

    def state(self) -> dict[str, Any]:
        """What the host does, for the heartbeats of its worker."""
        if not self._playing:
            return {"state": "idle"}
        found: dict[str, Any] = {"state": "playing", "identity": self._playing}
        with contextlib.suppress(OSError, msgspec.MsgspecError):
            content = (self.store.spool(self._playing) / PROGRESS_FILE).read_bytes()
            found |= msgspec.to_builtins(msgspec.json.decode(content, type=RunState))
        return found

    def close(self) -> None:
        """End the run that is playing: the worker ends."""
        self._closing = True
        if self._child is not None:
            with contextlib.suppress(OSError):
                self._child.terminate()

    def remove_unfinished(self) -> None:
        """Remove runs that an earlier worker did not finish, unless they are still ending."""
        for spool in (self.store.root / "spool").iterdir():
            if not (spool / _PLAYED_FILE).exists() and not _is_locked(spool / LOCK_FILE):
                remove(spool)

    def _answer(self, request: Request, piece: bytes) -> bytes:
        match request.what:
            case "prepare" if request.job is not None:
                return encode(self._prepare(request.job))
            case "put" if request.missing is not None:
                self.store.put(request.missing, request.offset, piece)
                return b"{}"
            case "play" if request.job is not None:
                return encode(self._play(request.job))
            case "piece":
                return self._piece(request)
            case "drop":
                remove(self.store.spool(request.identity))
                return b"{}"
        raise TransferError(f"the request {request.what!r} is incomplete")

    def _prepare(self, job: Job) -> Prepared:
        self._check_version(job)
        if (self.store.spool(job.identity) / _PLAYED_FILE).exists():
            return Prepared(played=True)
        for side in sides_of(job):
            plan = parse_plan(side.plan.encode(), "the plan of the client")
            check_allowed(plan, self.facts.allows, self.facts.name)
            if lacks := unmet(plan.requires or None, self.facts.machine):
                return Prepared(problems=(_unfit(lacks),))
        if missing := tuple(self.store.missing(job)):
            return Prepared(missing=missing)
        for recording in job.recordings:
            self.store.complete(recording)
        tree = self.store.unpack(job)
        self.store.trim(frozenset({job.bundle, *self._in_use(), *_contents(job)}))
        return Prepared(problems=tuple(self._problems(job, tree)))

    def _check_version(self, job: Job) -> None:
        if job.protocol == PROTOCOL and job.version == self.facts.r2bspec:
            return
        raise VersionDiffersError(
            f"the host {self.facts.name} has r2bspec {self.facts.r2bspec}, and the client has "
            f"{job.version}",
            hint="Install the same version on both: they measure and judge alike only then.",
        )

    def _problems(self, job: Job, tree: Path) -> Iterator[Problem]:
        """Why a job cannot be run here: recordings that are elsewhere, and what `validate` says."""
        yield from other_recordings(job)
        for side in sides_of(job):
            if side.spec_text:
                yield from self._validation.problems(job, side, tree)

    def _play(self, job: Job) -> Played:
        self._check_version(job)
        with self._slot:
            spool = self.store.spool(job.identity)
            if not (spool / _PLAYED_FILE).exists():
                self._playing = job.identity
                try:
                    self._play_in(spool, job)
                finally:
                    self._playing = ""
            return msgspec.json.decode((spool / _PLAYED_FILE).read_bytes(), type=Played)

    def _play_in(self, spool: Path, job: Job) -> None:
        for side in sides_of(job):
            plan = parse_plan(side.plan.encode(), "the plan of the client")
            check_allowed(plan, self.facts.allows, self.facts.name)
        if next(self.store.missing(job), None) is not None:
            raise TransferError(
                f"the host {self.facts.name} has removed files of {job.name} for those of others",
                hint="Start its worker with a larger --cache-limit.",
            )
        _wait_for(spool / LOCK_FILE)
        remove(spool)
        spool.mkdir(mode=0o700, parents=True)
        (spool / JOB_FILE).write_bytes(encode(job))
        tree = self.store.unpack(job)
        status = self._run_child(spool, tree)
        if self._closing:
            remove(spool)
            raise HostLostError(f"the worker of the host {self.facts.name} was ended")
        ended = _ended(spool, job, status)
        problem = ended.problem
        if problem is not None and problem.code in _NO_ROOM:
            remove(spool)
            raise HostFullError(
                f"the host {self.facts.name} has no room for the run: {problem.message}",
                hint=problem.hint,
            )
        size, sha256 = _pack(spool)
        played = msgspec.structs.replace(ended, size=size, sha256=sha256)
        write_atomically(spool / _PLAYED_FILE, encode(played))

    def _run_child(self, spool: Path, tree: Path) -> int:
        """Play in a process of its own, which ends when this one does; returns its status."""
        reader, writer = os.pipe()
        try:
            with (spool / "output.log").open("wb") as log:
                self._child = subprocess.Popen(
                    [
                        *(sys.executable, "-P", "-m", "r2bspec.fleet.play_run"),
                        *(str(spool), str(tree), str(reader)),
                    ],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=self.environment,
                    pass_fds=(reader,),
                    start_new_session=True,
                    umask=user_umask(),
                )
            return self._child.wait()
        finally:
            os.close(reader)
            os.close(writer)
            self._child = None

    def _piece(self, request: Request) -> bytes:
        archive = self.store.spool(request.identity) / _ARCHIVE
        if not archive.exists():
            raise TransferError(f"the host {self.facts.name} has removed the run")
        with archive.open("rb") as stream:
            stream.seek(request.offset)
            return b"=" + stream.read(min(request.size, _MAX_PIECE_BYTES))

    def _in_use(self) -> frozenset[str]:
        return frozenset({self._playing} if self._playing else ())


def _contents(job: Job) -> Iterator[str]:
    yield from (each.sha256 for each in job.files)
    yield from (each.sha256 for each in job.recordings)


def _unfit(lacks: tuple[str, ...]) -> Problem:
    return Problem(code="R2B683", message="; ".join(lacks), exit_status=ExitStatus.USAGE)


def _ended(spool: Path, job: Job, status: int) -> Played:
    """What the child says, or that it said nothing."""
    file = spool / ENDED_FILE
    if file.exists():
        return decode(file.read_bytes(), Played)
    output = (spool / "output.log").read_text(errors="replace").strip().splitlines()
    last = f": {output[-1]}" if output else ""
    how = f"signal {-status}" if status < 0 else f"status {status}"
    return Played(
        identity=job.identity,
        problem=Problem(code="R2B631", message=f"the run ended with {how}{last}"),
    )


def _pack(spool: Path) -> tuple[int, str]:
    """The run folder as one archive; its size in bytes, and its digest."""
    run = spool / RUN_FOLDER
    if not run.is_dir():
        return 0, ""
    archive = spool / _ARCHIVE
    pack(run, archive)
    remove(run)
    sha256, size = digest_of(archive)
    return size, sha256


def _is_locked(file: Path) -> bool:
    try:
        with file.open("r") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _wait_for(file: Path) -> None:
    """Wait for the end of a run whose worker was killed; it ends by itself then."""
    while _is_locked(file):
        time.sleep(0.2)
