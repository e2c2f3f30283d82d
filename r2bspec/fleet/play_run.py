"""The program that plays one run of a fleet on its host: ``python -m r2bspec.fleet.play_run``.

It is a process of its own, so that the worker, its event loop and its sockets are not in the
process that measures. It ends with its worker: a pipe, held open by the worker alone, tells.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec

from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus
from r2bspec.fleet.host_messages import Job, Played, Problem, Side, encode, problem_of
from r2bspec.fleet.host_store import inside
from r2bspec.record.atomic_files import write_atomically

JOB_FILE: Final = "job.json"
ENDED_FILE: Final = "ended.json"
PROGRESS_FILE: Final = "progress.json"
RUN_FOLDER: Final = "run"
LOCK_FILE: Final = "playing.lock"

_PROGRESS_INTERVAL_S: Final = 5.0
"""Progress is written by the controller: rarely, because it measures at the same time."""


class RunState(msgspec.Struct, frozen=True, kw_only=True):
    """How far a run is, for the tables of clients.

    Attributes:
        phase: in words.
        left_s: the estimated rest; None where it is unknown.
        p99_ns: of the latest latencies; None before the first.
    """

    name: str
    phase: str = ""
    left_s: float | None = None
    p99_ns: int | None = None


class _WrittenProgress:
    """Writes the state of the run to a file, at most every few seconds."""

    def __init__(self, job: Job, file: Path, left_s: Callable[[str], float | None]) -> None:
        self._job = job
        self._file = file
        self._left_s = left_s
        self._name = ""
        self._text = "starting"
        self._next = 0.0

    def phase(self, name: str, text: str) -> None:
        self._name, self._text = name, text
        self._write(None)

    def step(self, done: int, total: int) -> None:
        """Not shown."""

    def segment(self, title: str, steps: int) -> None:  # noqa: ARG002
        """Shown with the next state."""
        self._text = title

    def playing(self, view: Any) -> None:
        if time.monotonic() >= self._next:
            self._next = time.monotonic() + _PROGRESS_INTERVAL_S
            self._write(view.p99_ns())

    def note(self, text: str) -> None:
        """Notes are in the record of the run."""

    def _write(self, p99_ns: int | None) -> None:
        state = RunState(
            name=self._job.name, phase=self._text, left_s=self._left_s(self._name), p99_ns=p99_ns
        )
        # Read by the worker, which takes an unreadable state for none: it need not be durable.
        temporary = self._file.with_suffix(".tmp")
        try:
            temporary.write_bytes(msgspec.json.encode(state))
            temporary.replace(self._file)
        except OSError:
            return


def main(spool: Path, tree: Path, pipe: int) -> None:
    """Play the job of a spool folder.

    Args:
        spool: has ``job.json``, and gets the run folder and ``ended.json``.
        tree: the root of its bundle.
        pipe: ends when the worker does.
    """
    import fcntl

    lock = (spool / LOCK_FILE).open("w")
    fcntl.flock(lock, fcntl.LOCK_EX)
    _end_with(pipe)
    job = msgspec.json.decode((spool / JOB_FILE).read_bytes(), type=Job)
    began = time.monotonic()
    outcome, problem = "", None
    try:
        outcome = _play(job, spool, tree)
    except R2bspecError as error:
        problem = problem_of(error)
    except Exception as error:
        problem = Problem(
            code="R2B690",
            message=f"r2bspec itself failed: {type(error).__name__}: {error}",
            exit_status=ExitStatus.INTERNAL_ERROR,
        )
    ended = Played(
        identity=job.identity,
        outcome=outcome,
        problem=problem,
        seconds=time.monotonic() - began,
    )
    write_atomically(spool / ENDED_FILE, encode(ended))


def _end_with(pipe: int) -> None:
    """Interrupt this process when the other end of a pipe is closed."""

    def wait() -> None:
        while os.read(pipe, 1):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    os.set_inheritable(pipe, False)
    threading.Thread(target=wait, daemon=True, name="worker-watch").start()


def _play(job: Job, spool: Path, tree: Path) -> str:
    """Make the run, or the comparison; returns the outcome of its verdict."""
    from r2bspec import api
    from r2bspec.execute.host.host_lock import host_lock
    from r2bspec.plan.time_estimate import estimate_time
    from r2bspec.report.remaining_time import RemainingTime

    head = _prepared(job.head, tree)
    remaining = RemainingTime(estimate_time(head.plan))

    def left_s(phase: str) -> float | None:
        remaining.begin(phase)
        return None if job.compares else remaining.seconds()

    progress = _WrittenProgress(job, spool / PROGRESS_FILE, left_s)
    folder = spool / RUN_FOLDER

    def on_wait(holder: str) -> None:
        progress.phase("", f"waiting for {holder}")

    with host_lock(f"{job.name} of a fleet", on_wait=on_wait):
        if job.compares:
            result = _compare(job, head, tree, folder, progress)
        else:
            result = api.run(
                head,
                folder,
                progress,
                abort_on_fail=job.abort_on_fail,
                record_outputs=job.record_outputs,
                lock="off",  # it is held here: waiting for it again would never end
            )
    return str(result.verdict.outcome)


def _prepared(side: Side, tree: Path) -> Any:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.plan.canonical_json import parse_plan

    base_dir = tree if side.base_dir == "." else inside(tree, side.base_dir)
    return PreparedBenchmark(
        plan=parse_plan(side.plan.encode(), "the plan of the client"),
        base_dir=base_dir,
        spec_text=side.spec_text,
    )


def _compare(job: Job, head: Any, tree: Path, folder: Path, progress: Any) -> Any:
    from r2bspec.compare.interleaved_comparison import compare, prepare_comparison
    from r2bspec.compare.interleaved_runs import ComparisonSide
    from r2bspec.execute.processes.workspaces import workspace_environments

    environment = workspace_environments(job.environments)
    base = _prepared(job.base, tree) if job.base is not None else head
    sides = [
        ComparisonSide(each.plan, each.base_dir, each.spec_text, overrides)
        for each, overrides in ((base, environment), (head, {}))
    ]
    comparison = prepare_comparison(
        *sides, against=job.against, pairs=job.pairs, control=job.control, force=job.force
    )
    return compare(comparison, folder, progress)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
