"""What a host does for its clients: takes files, plays one run at a time, hands its folder out.

It is a plugin of the Dask worker of the host. Clients name its methods (`r2bspec.fleet.messages`).
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, Final

import msgspec
from distributed.diagnostics.plugin import WorkerPlugin

from r2bspec.bags.integrity import hash_files
from r2bspec.errors import R2bspecError
from r2bspec.fleet import errors, host_store
from r2bspec.fleet.bundle import Job, SentFile, digest_of
from r2bspec.fleet.hosts import HostFacts
from r2bspec.fleet.messages import PLUGIN, FleetRunState, Problem, RunEnded, answer_of, read_request
from r2bspec.fleet.permissions import check_allowed
from r2bspec.plan.canonical_json import parse_plan
from r2bspec.plan.this_machine import LABELS_VARIABLE, unmet
from r2bspec.record.files import write_atomically
from r2bspec.safe_io.private_files import user_umask

_PLAYED_FILE: Final = "played.json"
_ARCHIVE: Final = "run.tar.gz"
_NO_ROOM: Final = frozenset({"R2B651", "R2B664"})
"""A run that could not be written, and shared memory that is too small: another host may do."""


class HostService(WorkerPlugin):
    """The one slot of a host, and its store."""

    name = PLUGIN

    def __init__(self, facts: HostFacts, store: host_store.HostStore, lock: int = 0) -> None:
        """Begin.

        Args:
            facts: of the host.
            store: of its worker.
            lock: the descriptor of the store's lock, which runs inherit.
        """
        self.facts = facts
        self.store = store
        self._lock = lock
        labels = ",".join(f"{name}={value}" for name, value in facts.labels.items())
        self._environment = {**os.environ, LABELS_VARIABLE: labels, "PYTHONNOUSERSITE": "1"}
        self._slot = threading.Lock()
        self._playing = ""
        self._child: subprocess.Popen[bytes] | None = None
        self._is_closing = False

    def answer(self, request: bytes) -> bytes:
        """Do what a client asks for; whatever becomes of it is the answer."""
        try:
            method, args = read_request(request)
            return answer_of(request, getattr(self, method)(*args))
        except Exception as error:  # the client is told, whatever it is
            return answer_of(request, problem=Problem.of(self._told(error)))

    def _told(self, error: Exception) -> R2bspecError:
        """What a client is told of an error; a full disk is trimmed."""
        name = self.facts.name
        if isinstance(error, OSError) and error.errno in host_store.FULL_DISK:
            hint = "Free space there, or start its worker with a smaller --cache-limit."
            error = errors.HostFullError(f"the disk of the host {name} is full", hint=hint)
        if isinstance(error, errors.HostFullError):
            with contextlib.suppress(OSError):
                self.store.trim({self._playing})
        if isinstance(error, R2bspecError):
            return error
        return errors.FleetError(f"the host {name} failed: {error}")

    def state(self) -> dict[str, Any]:
        """What the host does, for the heartbeats of its worker: a `HostState`."""
        if not self._playing:
            return {"state": "idle"}
        state: dict[str, Any] = {"state": "playing", "identity": self._playing}
        with contextlib.suppress(OSError, msgspec.MsgspecError):
            content = (self.store.spool(self._playing) / host_store.PROGRESS_FILE).read_bytes()
            state |= msgspec.to_builtins(msgspec.json.decode(content, type=FleetRunState))
        return state

    def close(self) -> None:
        """End the run that is playing: the worker ends."""
        self._is_closing = True
        if (child := self._child) is not None:
            with contextlib.suppress(OSError):
                child.terminate()

    def remove_unfinished(self) -> None:
        """Remove runs that an earlier worker did not finish, and what else it left."""
        for name in ("work", host_store.SCRATCH):
            host_store.remove(self.store.root / name)
        self.store.open()
        for spool in (self.store.root / "spool").iterdir():
            if not (spool / _PLAYED_FILE).exists():
                host_store.remove(spool)

    def prepare(self, job: Job) -> dict[str, int]:
        """Take a job that is offered.

        Returns:
            The digests of files to be sent before the job is offered again, with the bytes of
            each that are here.

        Raises:
            HostRefusesError: this host cannot run it.
        """
        if (self.store.spool(job.identity) / _PLAYED_FILE).exists():
            return {}
        self._check_allowed(job)
        self.store.check(job)
        if missing := self.store.missing(job):
            return missing
        self.store.unpack(job)
        self.store.trim({job.bundle, self._playing, *(file.sha256 for file in job.files)})
        for recording in job.recordings:
            place = Path(recording.path)
            if place.is_absolute() and not _is_recording(place, recording.sha256):
                raise errors.HostRefusesError(
                    f"{recording.path} is not on this host, or is another recording",
                    hint="Name recordings relative to the spec or by $R2B_DATASETS: they are sent.",
                    code="R2B301",
                )
        return {}

    def _check_allowed(self, job: Job) -> None:
        files = [file.path for file in job.files]
        for side in job.sides:
            plan = parse_plan(side.plan.encode(), "the plan of the client")
            check_allowed(plan, self.facts.allows, self.facts.name, job.environments, files=files)
            if lacks := unmet(plan.requires or None, self.facts):
                raise errors.NoHostError("; ".join(lacks))

    def put(self, file: SentFile, offset: int, piece: bytes) -> None:
        """Take a piece of a file."""
        self.store.put(file, offset, piece)

    def play(self, job: Job) -> RunEnded:
        """Play a job, unless it has been played already: its result is still here then.

        Raises:
            TransferError: files of the job have been removed for those of others.
            HostFullError: the host has no room for the run.
            HostRefusesError: the spec is not valid here; a package may be missing.
            HostLostError: the worker was ended.
        """
        with self._slot:
            spool = self.store.spool(job.identity)
            if not (spool / _PLAYED_FILE).exists():
                self._playing = job.identity
                try:
                    self._play_in(spool, job)
                finally:
                    self._playing = ""
            return msgspec.json.decode((spool / _PLAYED_FILE).read_bytes(), type=RunEnded)

    def read(self, identity: str, offset: int, size: int) -> bytes:
        """A piece of the archive of a run."""
        archive = self.store.spool(identity) / _ARCHIVE
        if not archive.exists():
            raise errors.TransferError(f"the host {self.facts.name} has removed the run")
        with archive.open("rb") as stream:
            stream.seek(offset)
            return stream.read(size)

    def drop(self, identity: str) -> None:
        """Remove a run that its client has."""
        host_store.remove(self.store.spool(identity))

    def _play_in(self, spool: Path, job: Job) -> None:
        self._check_allowed(job)
        self.store.check(job)
        if self.store.missing(job):
            raise errors.TransferError(
                f"the host {self.facts.name} has removed files of {job.name} for those of others",
                hint="Start its worker with a larger --cache-limit.",
            )
        host_store.remove(spool)
        spool.mkdir(mode=0o700, parents=True)
        (spool / host_store.JOB_FILE).write_bytes(msgspec.json.encode(job))
        status = self._run_child(spool, self.store.unpack(job))
        if self._is_closing:
            host_store.remove(spool)
            raise errors.HostLostError(f"the worker of the host {self.facts.name} was ended")
        played = _ended(spool, status)
        problem = played.problem
        if problem is not None and problem.code in _NO_ROOM:
            host_store.remove(spool)
            raise errors.HostFullError(
                f"the host {self.facts.name} has no room for the run: {problem.message}",
                hint=problem.hint,
            )
        if problem is not None and problem.is_of_host:
            host_store.remove(spool)
            raise errors.HostRefusesError(problem.message, hint=problem.hint, code=problem.code)
        if (run := spool / host_store.RUN_FOLDER).is_dir():
            archive = spool / _ARCHIVE
            host_store.pack_run(run, archive)
            host_store.remove(run)
            size, sha256 = archive.stat().st_size, digest_of(archive)
            played = msgspec.structs.replace(played, size=size, sha256=sha256)
        write_atomically(spool / _PLAYED_FILE, msgspec.json.encode(played))

    def _run_child(self, spool: Path, tree: Path) -> int:
        """Play in a process of its own, which ends when this one does; returns its status."""
        words = [
            *(sys.executable, "-s", "-P", "-m", "r2bspec.fleet.play_run"),
            *(str(spool), str(tree), str(self._lock)),
        ]
        with (spool / "output.log").open("wb") as log:
            child = self._child = subprocess.Popen(
                words,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
                pass_fds=(self._lock,),
                start_new_session=True,
                umask=user_umask(),
            )
        if self._is_closing:
            # It was ended while the files were placed: `close` has seen no process.
            child.terminate()
        try:
            return child.wait()
        finally:
            assert child.stdin is not None  # noqa: S101 - it is a pipe
            child.stdin.close()
            self._child = None


def _is_recording(place: Path, sha256: str) -> bool:
    return (place.is_file() or place.is_dir()) and hash_files(place) == sha256


def _ended(spool: Path, status: int) -> RunEnded:
    """What the child says, or that it said nothing."""
    file = spool / host_store.ENDED_FILE
    if file.exists():
        return msgspec.json.decode(file.read_bytes(), type=RunEnded)
    output = (spool / "output.log").read_text(errors="replace").strip().splitlines()
    last = f": {output[-1]}" if output else ""
    how = f"signal {-status}" if status < 0 else f"status {status}"
    problem = Problem(code="R2B631", message=f"the run ended with {how}{last}")
    return RunEnded(problem=problem)
