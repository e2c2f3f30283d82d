"""The controller: carries a plan out, phase by phase, and records what it sees.

Whatever happens, three things hold at the end: no process of the run is left, the run folder has
what was observed until then, and its record says whether that is all.
"""

from __future__ import annotations

import contextlib
import datetime
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

from r2bspec.errors import R2bspecError
from r2bspec.execute.bringup.commands import run_setup_step
from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.errors import (
    GraphMismatchError,
    MemoryLimitError,
    RunError,
    UnsupportedError,
    UnwritableRunError,
)
from r2bspec.execute.host.machine import describe_machine, describe_versions
from r2bspec.execute.host.resource_sampler import ResourceSampler
from r2bspec.execute.inputs.buffer_bags import buffer_bags
from r2bspec.execute.inputs.dataset import ResolvedDataset, obtain_dataset
from r2bspec.execute.inputs.preprocess import preprocess
from r2bspec.execute.measurement.measurement import Measurement
from r2bspec.execute.measurement.run_reporter import RunReporter
from r2bspec.execute.measurement.time_budget import TimeBudget
from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.executables import resolve_argv
from r2bspec.execute.processes.middleware_check import check_middleware
from r2bspec.execute.processes.redaction import make_redactor
from r2bspec.execute.processes.ros_domain import reserved_domain
from r2bspec.execute.processes.signals import Interrupts
from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.execute.progress import Progress
from r2bspec.execute.session import Session
from r2bspec.ipc.buffers import largest_message_bytes
from r2bspec.ipc.clocks import ClockOffsetTracker
from r2bspec.judge.confirmation import judge_confirmation, needs_confirmation
from r2bspec.judge.decision_policy import decision_policy
from r2bspec.judge.judge_samples import judge
from r2bspec.judge.verdict import Verdict
from r2bspec.language.quantities import Size
from r2bspec.measure.run_samples import HostSamples, run_samples
from r2bspec.measure.samples import RunSamples
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.plan.plan import Plan
from r2bspec.plan.unsupported import unsupported_features
from r2bspec.record.errors import RecordError
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import Difference, RunRecord


def run_plan(
    plan: Plan,
    *,
    base_dir: Path,
    folder: RunFolder,
    run_id: str,
    spec_text: str,
    progress: Progress,
) -> RunRecord:
    """Carry out a plan; the run folder is complete when this returns or raises.

    Args:
        plan: what to do.
        base_dir: the folder of the spec, to which its paths are relative.
        folder: where everything observed goes.
        run_id: names the run; also marks its processes.
        spec_text: the resolved spec, for the record.
        progress: is told what happens.

    Raises:
        RunError: the run failed; its record is marked as incomplete and says why.
        DataError: the bag is not there or not readable.
        InterruptedRunError: a signal asked for an end.
    """
    folder.write_plan(canonical_json(plan).decode())
    folder.write_spec(spec_text)
    # Beside the samples, where the user chose to have room, and gone with the run.
    with (
        Interrupts() as interrupts,
        tempfile.TemporaryDirectory(prefix=".scratch-", dir=folder.path) as scratch,
    ):
        return _Controller(
            plan, base_dir, folder, run_id, Path(scratch), progress, interrupts
        ).run()


class _Controller:
    """The state of one run."""

    def __init__(
        self,
        plan: Plan,
        base_dir: Path,
        folder: RunFolder,
        run_id: str,
        scratch: Path,
        progress: Progress,
        interrupts: Interrupts,
    ) -> None:
        self._plan = plan
        self._base_dir = base_dir
        self._folder = folder
        self._run_id = run_id
        self._progress = progress
        self._interrupts = interrupts
        self._scratch = scratch
        self._buffer_dir = scratch / "buffers"
        self._buffer_dir.mkdir()
        self._started_at = _now()
        self._machine = describe_machine()
        self._versions = describe_versions()
        self._events: list[tuple[int, str]] = []
        self._clocks = ClockOffsetTracker()
        self._datasets: tuple[ResolvedDataset, ...] = ()
        # Looked at several times a second, and empty for most plans.
        self._memory_limits = {
            each.name: each.memory_limit_bytes for each in plan.processes if each.memory_limit_bytes
        }
        self._resources = ResourceSampler()
        self._supervisor = ProcessSupervisor(
            run_id,
            scratch,
            self._check,
            lambda child: self._resources.add(child.pid),
            make_redactor(plan.environment, os.environ),
        )
        self._launchers: list[Launcher] = []
        self._sessions: list[Session] = []
        self._foreign: tuple[str, ...] = ()
        self._measurements: list[Measurement] = []
        self._budget = TimeBudget(plan.gate.time_budget_ns, self._note)

    def run(self) -> RunRecord:
        """Carry the plan out, clean up, and write the record, in that order, whatever happens."""
        failure: BaseException | None = None
        try:
            self._write_partial_record()
            self._execute()
        except (OSError, RecordError) as error:
            failure = _unwritable(error, self._folder.path)
            raise failure from error
        except BaseException as error:
            failure = error
            raise
        finally:
            record = self._finish(failure)
        return record

    def _finish(self, failure: BaseException | None) -> RunRecord:
        """End all that still runs, and write what is known."""
        killed = self._supervisor.close()
        if killed:
            self._note(f"had to be killed: {', '.join(sorted(set(killed)))}")
        if cut := self._supervisor.truncated_logs:
            self._note(f"logs that were too long were cut: {', '.join(each.name for each in cut)}")
        record = self._record(failure)
        # Should the disk be full, then this is what the record finds room in.
        shutil.rmtree(self._buffer_dir, ignore_errors=True)
        # Of several failures the first one is to be told.
        with contextlib.suppress(RecordError) if failure else contextlib.nullcontext():
            self._resources.stop()
            self._write_resource_samples()
        with contextlib.suppress(RecordError) if failure else contextlib.nullcontext():
            self._folder.write_record(record)
        return record

    def _execute(self) -> None:
        self._check_supported()
        check_middleware(self._plan, os.environ)
        self._resources.start()
        with self._domain() as domain:
            self._set_up(domain)
            self._check_programs_installed()
            if "load" in self._plan.phases:
                self._load()
            if "preprocess" in self._plan.phases:
                self._phase("preprocess", "running the preprocessors")
                preprocess(
                    self._plan,
                    self._supervisor,
                    self._launcher(domain),
                    self._buffer_dir,
                    self._note,
                )
            self._measure(domain)
            # One that died at the last message did not survive the run either.
            self._supervisor.pump(0.0)
            self._phase("collect", "collecting")
            # Inside the reservation: the domain is free for others only when all are gone.
            self._supervisor.end(list(self._supervisor))

    def _check_supported(self) -> None:
        missing = unsupported_features(self._plan)
        if missing:
            raise UnsupportedError(
                "this version does not carry out "
                + "; ".join(f"{each.what} ({each.path})" for each in missing),
                hint="The spec is right, and can be validated and planned; it cannot be run yet.",
            )

    def _check_programs_installed(self) -> None:
        """See that every program is there before any is started; a setup step may have made it."""
        for process in self._plan.processes:
            resolve_argv(process)

    def _domain(self) -> contextlib.AbstractContextManager[int]:
        """A domain of the run's own; the user's where nodes of theirs take part."""
        if self._plan.external:
            return contextlib.nullcontext(int(os.environ.get("ROS_DOMAIN_ID", "0")))
        return reserved_domain()

    def _check(self) -> None:
        """Called whenever the controller waits: signals, and limits of memory.

        Raises:
            InterruptedRunError: a signal has asked for an end.
            MemoryLimitError: a process uses more than the spec allows.
        """
        self._interrupts.check()
        self._note_clock_steps()
        if not self._memory_limits:
            return
        for child in self._supervisor:
            limit = self._memory_limits.get(child.name)
            resident = self._resources.resident(child.pid)
            if limit is not None and resident > limit and not child.exit_expected:
                raise MemoryLimitError(
                    f"process {child.name} uses {Size(resident)}; its limit is {Size(limit)}",
                    hint="Raise memory_limit, or find out what grows.",
                )

    def _note_clock_steps(self) -> None:
        told, before_ns = self._clocks.steps, self._clocks.total_step_ns
        self._clocks.update()
        if self._clocks.steps > told:
            moved_s = (self._clocks.total_step_ns - before_ns) / 1e9
            self._note(
                f"the system clock was set by {moved_s:+.3f} s; the times of this run are "
                "monotonic, and not moved by that"
            )

    def _set_up(self, domain: int) -> None:
        if not self._plan.setup:
            return
        self._phase("setup", "setting up")
        environment = self._environment(domain)
        for step in self._plan.setup:
            run_setup_step(
                step, self._supervisor, environment, self._folder, self._base_dir, self._note
            )

    def _load(self) -> None:
        self._phase("load", f"reading {self._plan.dataset.source}")
        with self._interrupts.immediate():
            plans = self._plan.datasets or (self._plan.dataset,)
            datasets = [obtain_dataset(each, self._base_dir, self._progress) for each in plans]
            self._datasets = tuple(datasets)
            counts = buffer_bags(
                [each.path for each in datasets], plans, self._buffer_dir, self._progress
            )
        self._note(", ".join(f"{topic}: {count} messages" for topic, count in counts.items()))
        self._interrupts.check()

    def _launcher(self, domain: int) -> Launcher:
        """A launcher whose transport fits the largest message that is buffered by now.

        Preprocessors may publish larger messages than the bag holds, so each phase gets its own.
        """
        made = Launcher(self._supervisor, self._environment(domain), self._folder, self._base_dir)
        self._launchers.append(made)
        return made

    def _environment(self, domain: int) -> RunEnvironment:
        return RunEnvironment(
            self._plan,
            run_id=self._run_id,
            domain=domain,
            scratch=self._scratch,
            largest_message_bytes=max(
                self._plan.largest_message_bytes, largest_message_bytes(self._buffer_dir)
            ),
            ros_logs=self._folder.ros_logs,
        )

    def _measure(self, domain: int) -> None:
        """Play the batch that decides and, if it fails, a fresh one that confirms it or not."""
        began_s = time.monotonic()
        measurement = self._bring_up(domain, self._judge_so_far)
        verdict, iterations = measurement.measure()
        if self._find_foreign_publishers():
            # Others took part in what was measured: a fresh batch would confirm nothing.
            return
        if not self._plan.gate.confirm or not needs_confirmation(verdict):
            return
        if self._plan.external:
            self._note("no fresh batch: nodes that somebody else runs cannot be started anew")
            return
        if not self._budget.allows("no fresh batch", time.monotonic() - began_s):
            return
        self._supervisor.pump(0.0)
        self._phase("confirm", "the run fails: starting a fresh batch to confirm that")
        self._supervisor.end(list(self._supervisor))
        peak_hz = measurement.peak_hz
        measurement = self._bring_up(
            domain, partial(self._judge_confirmation, verdict), confirms=True
        )
        failed = {each.method for each in verdict.requirements if each.outcome == "fail"}
        measurement.measure_confirmation(frozenset(failed), iterations, peak_hz)
        self._find_foreign_publishers()

    def _find_foreign_publishers(self) -> bool:
        """Ask who has published on what is played and watched; whether others have."""
        self._foreign = self._sessions[-1].foreign_publishers()
        for each in self._foreign:
            self._note(f"a program that is not of this run has published on {each}")
        return bool(self._foreign)

    def _bring_up(
        self, domain: int, judge_so_far: Callable[[], Verdict], *, confirms: bool = False
    ) -> Measurement:
        """Bring up a batch of new processes."""
        reporter = RunReporter(
            self._phase, self._note, self._write_partial_record, self._progress, self._resources
        )
        session = Session(
            self._plan,
            self._supervisor,
            self._launcher(domain),
            self._folder,
            self._base_dir,
            self._scratch,
            reporter,
            confirms=confirms,
        )
        self._sessions.append(session)
        segment_player = session.bring_up()
        measurement = Measurement(self._plan, segment_player, reporter, judge_so_far, self._budget)
        self._measurements.append(measurement)
        return measurement

    def _judge_so_far(self) -> Verdict:
        """The verdict on the first batch if the run ended now."""
        return judge(self._plan.objectives, self._samples_so_far(), decision_policy(self._plan))

    def _judge_confirmation(self, first: Verdict) -> Verdict:
        """The verdict on the fresh batch if the run ended now, after that on the first."""
        fresh = self._samples_so_far().confirmation
        assert fresh is not None  # noqa: S101 - it is being played
        return judge_confirmation(self._plan.objectives, fresh, first)

    def _samples_so_far(self) -> RunSamples:
        """The samples of all that has been played, as if the run had ended now."""
        # Should the run be killed before its next look, its folder has what this one rests on.
        self._write_resource_samples()
        samples = {
            name: each for session in self._sessions for name, each in session.samples.items()
        }
        return run_samples(
            self._record(None),
            self._plan,
            lambda segment: samples[segment.id],
            HostSamples(self._resources.rows(), self._resources.surroundings()),
        )

    def _write_resource_samples(self) -> None:
        self._folder.write_resources(self._resources.rows())
        self._folder.write_interference(self._resources.surroundings())

    def _write_partial_record(self) -> None:
        """Write the record as it stands, so that a killed run can be read, too."""
        self._folder.write_record(self._record(RunError("the run was killed", code="R2B671")))

    def _phase(self, name: str, text: str) -> None:
        self._events.append((time.monotonic_ns(), f"phase {name}"))
        self._progress.phase(name, text)

    def _note(self, text: str) -> None:
        self._events.append((time.monotonic_ns(), text))
        self._progress.note(text)

    def _provenance(self) -> dict[str, Any]:
        """Which recordings were read; those after the first under ``also``."""
        if not self._datasets:
            return {}
        first, *others = (each.provenance for each in self._datasets)
        return first | ({"also": others} if others else {})

    def _differences(self, failure: BaseException | None) -> tuple[Difference, ...]:
        """What of the real graph is not as the plan says, each once."""
        found = [each for launcher in self._launchers for each in launcher.differences]
        found += failure.differences if isinstance(failure, GraphMismatchError) else ()
        return tuple(dict.fromkeys(found))

    def _loaded_rmw(self) -> dict[str, str]:
        """The middleware as a process of the harness says; empty until one has."""
        return next(({"rmw": each.rmw} for each in self._launchers if each.rmw), {})

    def _record(self, failure: BaseException | None) -> RunRecord:
        status: Literal["complete", "incomplete", "invalid"] = "complete"
        reason = ""
        if failure is not None:
            status, reason = "incomplete", _reason(failure)
        elif self._foreign:
            status, reason = "invalid", _foreign_reason(self._foreign)
        first = self._measurements[0] if self._measurements else None
        again = self._measurements[1:]
        return RunRecord(
            run_id=self._run_id,
            plan_hash=plan_hash(self._plan),
            started_at=self._started_at,
            ended_at=_now(),
            status=status,
            reason=reason,
            dataset=self._provenance(),
            machine=self._machine,
            versions=self._versions | self._loaded_rmw(),
            processes=self._supervisor.records(),
            segments=tuple(each for session in self._sessions for each in session.segments),
            search=first.search if first else None,
            sustained=first.sustained if first else (),
            events=tuple(self._events),
            floor=self._sessions[0].floor if self._sessions else (),
            silences=tuple(each for session in self._sessions for each in session.silences),
            differences=self._differences(failure),
            confirmation=again[0].confirmation(self._sessions[1].floor) if again else None,
            left_out=tuple(self._budget.left_out),
        )


def _unwritable(error: OSError | RecordError, folder: Path) -> RunError:
    text = str(error)
    if isinstance(error, OSError):
        text = f"{error.filename or folder} cannot be written: {error.strerror or error}"
    hint = "Make room on that disk, or choose another folder with --output."
    return UnwritableRunError(text, hint=hint)


def _foreign_reason(foreign: Sequence[str]) -> str:
    return (
        f"A program that is not of this run has published on {'; '.join(foreign)}. What was "
        "measured is not that of the graph alone."
    )


def _reason(failure: BaseException) -> str:
    if isinstance(failure, R2bspecError):
        return f"{failure.code}: {failure}"
    return f"{type(failure).__name__}: {failure}"


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
