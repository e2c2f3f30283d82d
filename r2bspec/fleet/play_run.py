"""The program that plays one run of a fleet on its host: ``python -m r2bspec.fleet.play_run``.

It is a process of its own, so that the worker, its event loop and its sockets are not in the
process that measures. It ends with its worker, whose end of a pipe is its standard input.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.execute.progress import Progress
from r2bspec.fleet.bundle import Job, Side
from r2bspec.fleet.host_store import ENDED_FILE, JOB_FILE, PROGRESS_FILE, RUN_FOLDER
from r2bspec.fleet.messages import FleetRunState, Problem, RunEnded
from r2bspec.record.files import write_atomically

if TYPE_CHECKING:
    from r2bspec.judge.result import Result
    from r2bspec.plan.prepared_benchmark import PreparedBenchmark

_PROGRESS_INTERVAL_S: Final = 5.0
"""Progress is written by the controller: rarely, because it measures at the same time."""


class _WrittenProgress(Progress):
    """Writes the state of the run to a file, at most every few seconds."""

    def __init__(self, name: str, file: Path, left_s: Callable[[str], float | None]) -> None:
        self._name = name
        self._file = file
        self._left_s = left_s
        self._phase = ""
        self._text = "starting"
        self._next = 0.0

    def phase(self, name: str, text: str) -> None:
        self._phase, self._text = name, text
        self._write(None)

    def segment(self, title: str, steps: int) -> None:  # noqa: ARG002
        """Shown with the next state."""
        self._text = title

    def playing(self, view: Any) -> None:
        if time.monotonic() >= self._next:
            self._next = time.monotonic() + _PROGRESS_INTERVAL_S
            self._write(view.p99_ns())

    def _write(self, p99_ns: int | None) -> None:
        left_s = self._left_s(self._phase)
        state = FleetRunState(name=self._name, phase=self._text, left_s=left_s, p99_ns=p99_ns)
        # Read by the worker, which takes an unreadable state for none: it need not be durable.
        temporary = self._file.with_suffix(".tmp")
        try:
            temporary.write_bytes(msgspec.json.encode(state))
            temporary.replace(self._file)
        except OSError:
            return


def main(spool: Path, tree: Path, lock: int) -> None:
    """Play the job of a spool folder.

    Args:
        spool: has ``job.json``, and gets the run folder and ``ended.json``.
        tree: the root of its bundle.
        lock: of the folder of the host, which is held until this process ends.
    """
    os.set_inheritable(lock, False)
    threading.Thread(target=_end_with_worker, daemon=True).start()
    job = msgspec.json.decode((spool / JOB_FILE).read_bytes(), type=Job)
    outcome = ""
    try:
        problem = _invalidity(job, tree)
        if problem is None:
            outcome = _play(job, spool, tree).verdict.outcome
    except R2bspecError as error:
        problem = Problem.of(error)
    except Exception as error:
        problem = Problem(
            code="R2B690",
            message=f"r2bspec itself failed: {type(error).__name__}: {error}",
            exit_status=ExitStatus.INTERNAL_ERROR,
        )
    played = RunEnded(outcome=outcome, problem=problem)
    write_atomically(spool / ENDED_FILE, msgspec.json.encode(played))


def _end_with_worker() -> None:
    """Interrupt this process when the worker closes the pipe, or is gone."""
    while os.read(sys.stdin.fileno(), 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


def _invalidity(job: Job, tree: Path) -> Problem | None:
    """The first error that ``validate`` finds with what is installed on this host."""
    from r2bspec import api

    for side in job.sides:
        file = tree / side.base_dir / ".fleet.r2b.yaml"
        try:
            file.write_text(side.spec_text, encoding="utf-8")
            if side.spec_text:
                api.prepare(file, smoke=job.smoke)
        except api.InvalidSpecError as error:
            first = next(finding for finding in error.diagnostics if finding.severity == "error")
            hint = first.help or ""
            return Problem(code=first.code, message=first.message, hint=hint, is_of_host=True)
        finally:
            file.unlink(missing_ok=True)
    return None


def _play(job: Job, spool: Path, tree: Path) -> Result:
    """Make the run, or the comparison."""
    from r2bspec import api
    from r2bspec.execute.processes.machine import host_lock
    from r2bspec.plan.time_estimate import estimate_time
    from r2bspec.report.progress import RemainingTime

    head = _prepared(job.head, tree)
    remaining = RemainingTime(estimate_time(head.plan))

    def left_s(phase: str) -> float | None:
        remaining.begin(phase)
        return None if job.compares else remaining.seconds()

    progress = _WrittenProgress(job.name, spool / PROGRESS_FILE, left_s)

    def on_wait(holder: str) -> None:
        progress.phase("", f"waiting for {holder}")

    with host_lock(f"{job.name} of a fleet", on_wait=on_wait):
        if job.compares:
            return _compare(job, head, tree, spool / RUN_FOLDER, progress)
        return api.run(
            head,
            spool / RUN_FOLDER,
            progress,
            abort_on_fail=job.abort_on_fail,
            anatomy=job.anatomy,
            lock="off",  # it is held here: waiting for it again would never end
        )


def _prepared(side: Side, tree: Path) -> PreparedBenchmark:
    from r2bspec.plan.canonical_json import parse_plan
    from r2bspec.plan.prepared_benchmark import PreparedBenchmark

    return PreparedBenchmark(
        plan=parse_plan(side.plan.encode(), "the plan of the client"),
        base_dir=tree / side.base_dir,
        spec_text=side.spec_text,
    )


def _compare(
    job: Job, head: PreparedBenchmark, tree: Path, folder: Path, progress: _WrittenProgress
) -> Result:
    from r2bspec.compare.interleaved_comparison import ComparisonSide, prepare_comparison
    from r2bspec.compare.interleaved_runs import compare
    from r2bspec.execute.processes.environment import workspace_environments

    environment = workspace_environments(job.environments)
    base = _prepared(job.base, tree) if job.base is not None else head
    sides = [
        ComparisonSide(side.plan, side.base_dir, side.spec_text, overrides)
        for side, overrides in ((base, environment), (head, {}))
    ]
    comparison = prepare_comparison(
        *sides, against=job.against, pairs=job.pairs, control=job.control, force=job.force
    )
    return compare(comparison, folder, progress)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
