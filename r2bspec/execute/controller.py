"""The controller: executes a plan phase by phase and writes the run record.

At the end of a run, even of a failed one, no process of the run is left, the run folder contains
everything that was measured, and its record states whether the run is complete.
"""

from __future__ import annotations

import contextlib
import datetime
import errno
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

from r2bspec.check.installed_packages import find_module
from r2bspec.errors import R2bspecError
from r2bspec.execute.bringup.graph_joins import build_join_files
from r2bspec.execute.bringup.launcher import Launcher, message_packages
from r2bspec.execute.bringup.readiness import run_setup_step
from r2bspec.execute.errors import (
    GraphMismatchError,
    InterruptedRunError,
    MemoryLimitError,
    NotInstalledError,
    RunError,
    UnsupportedError,
    UnwritableRunError,
)
from r2bspec.execute.host.machine import describe_machine, describe_versions, unwritable_log
from r2bspec.execute.host.resource_sampler import HostWatch, ResourceSampler
from r2bspec.execute.identity.identify_graph import graph_identity
from r2bspec.execute.identity.mapped_files import modules_of_programs
from r2bspec.execute.inputs.buffer_bags import ResolvedDataset, buffer_bags, obtain_dataset
from r2bspec.execute.inputs.preprocess import preprocess
from r2bspec.execute.measurement.measurement import Measurement
from r2bspec.execute.measurement.run_reporter import RunReporter, TimeBudget
from r2bspec.execute.processes.environment import (
    MODULES_FOLDER,
    RunEnvironment,
    SecretReferences,
    make_redactor,
)
from r2bspec.execute.processes.executables import require_joinable, resolve_argv
from r2bspec.execute.processes.middleware_setup import check_middleware, reserved_domain
from r2bspec.execute.processes.signals import Interrupts
from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.execute.profile.profiled_iteration import (
    ProfiledIteration,
    profiled_processes,
    wait_for_last_sample,
)
from r2bspec.execute.profile.profilers import find_profiler, require_usable
from r2bspec.execute.progress import PhaseClock, Progress
from r2bspec.execute.session import MEASURE_PHASE, Session
from r2bspec.execute.start_sequence import StartSequence
from r2bspec.ipc.arrivals import ClockOffsetTracker
from r2bspec.ipc.buffers import largest_message_bytes
from r2bspec.judge.confirmation import judge_confirmation, needs_confirmation
from r2bspec.judge.decision_policy import certain_failures, decision_policy
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import Verdict
from r2bspec.language.quantities import Size
from r2bspec.measure.run_samples import HostSamples, run_samples
from r2bspec.measure.samples import RunSamples
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.plan.plan import Plan
from r2bspec.record.errors import RecordError
from r2bspec.record.graph_identity import GraphIdentity
from r2bspec.record.loaded_files import write_loaded_files
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import AccuracyRecord, Difference, ProfileRecord, RunRecord


def run_plan(
    plan: Plan,
    *,
    base_dir: Path,
    folder: RunFolder,
    run_id: str,
    spec_text: str,
    progress: Progress,
    abort_on_fail: bool = False,
    record_outputs: bool = False,
    profile: str = "",
    profile_node: str = "",
    identity: GraphIdentity | None = None,
    gate: tuple[str, ...] = (),
) -> RunRecord:
    """Execute a plan; the run folder is written completely when this returns or raises.

    Args:
        plan: of the run.
        base_dir: the folder of the spec, to which its paths are relative.
        folder: receives the samples, logs and the record.
        run_id: names the run; also marks its processes.
        spec_text: the resolved spec, for the record.
        progress: receives phases, notes and progress.
        abort_on_fail: end a rate as soon as a requirement can no longer be met.
        record_outputs: record the messages of one more iteration in the run folder.
        profile: a profiler for one more iteration; empty for none (`find_profiler`).
        profile_node: the node, or process, that it observes; all nodes if empty.
        identity: what the graph is made of; looked up if None, after the setup steps.
        gate: what reports say of the merge gate, one sentence each.

    Raises:
        UsageError: the profiler, or its node, does not exist.
        RunError: the run failed; its record is marked as incomplete and gives the reason.
        DataError: the bag does not exist or cannot be read.
        InterruptedRunError: a signal interrupted the run.
    """
    folder.write_plan(canonical_json(plan).decode())
    folder.write_spec(spec_text)
    # In the run folder, because the user chose a disk with space for it; removed after the run.
    with (
        Interrupts() as interrupts,
        tempfile.TemporaryDirectory(prefix=".scratch-", dir=folder.path) as scratch,
    ):
        controller = _Controller(
            plan, base_dir, folder, run_id, Path(scratch), progress, interrupts
        )
        controller.abort_on_fail = abort_on_fail
        controller.record_outputs = record_outputs
        controller.profile, controller.profile_node = profile, profile_node
        controller.identity, controller.gate = identity, gate
        return controller.run()


class _Controller:
    """The state of one run."""

    abort_on_fail = False
    record_outputs = False
    profile = ""
    profile_node = ""
    identity: GraphIdentity | None = None
    gate: tuple[str, ...] = ()

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
        self._clock = PhaseClock()
        self._clocks = ClockOffsetTracker()
        self._datasets: tuple[ResolvedDataset, ...] = ()
        # Checked several times a second, and empty for most plans.
        self._memory_limits = {
            each.name: each.memory_limit_bytes for each in plan.processes if each.memory_limit_bytes
        }
        self._resources = ResourceSampler(run_id)
        self._supervisor = ProcessSupervisor(
            run_id,
            scratch,
            self._check,
            lambda child: self._resources.add(child.pid),
            make_redactor(plan.environment, os.environ),
            self._clock,
        )
        self._launchers: list[Launcher] = []
        self._early_launcher: Launcher | None = None
        self._starts: StartSequence | None = None
        self._accuracy: tuple[AccuracyRecord, ...] = ()
        self._measurements: list[Measurement] = []
        self._profiles: tuple[ProfileRecord, ...] = ()
        self._budget = TimeBudget(plan.gate.time_budget_ns, self._note)

    def run(self) -> RunRecord:
        """Execute the plan; then, even after a failure, clean up and write the record."""
        failure: BaseException | None = None
        try:
            self._write_partial_record()
            self._execute()
        except (OSError, RecordError) as error:
            failure = _unwritable(error, self._folder.path)
            raise failure from error
        except RunError as error:
            failure = error
            full = None if isinstance(error, _NOT_BY_DISK) else unwritable_log(self._folder.path)
            if full is None:
                raise
            failure = _without_room(full, error)
            raise failure from error
        except BaseException as error:
            failure = error
            raise
        finally:
            record = self._finish(failure)
        return record

    def _finish(self, failure: BaseException | None) -> RunRecord:
        """End all processes that still run, and write the samples and the record."""
        killed = self._supervisor.close()
        if killed:
            self._note(f"killed, because they did not exit: {', '.join(sorted(set(killed)))}")
        if cut := self._supervisor.truncated_logs:
            self._note(f"truncated large logs: {', '.join(each.name for each in cut)}")
        record = self._record(failure)
        # If the disk is full, this frees the space for the record.
        shutil.rmtree(self._buffer_dir, ignore_errors=True)
        # If there are several failures, the first one is reported.
        with contextlib.suppress(RecordError) if failure else contextlib.nullcontext():
            self._resources.stop()
            self._write_resource_samples()
            if self._starts is not None:
                write_loaded_files(self._folder.path, self._loaded_files(record))
        with contextlib.suppress(RecordError) if failure else contextlib.nullcontext():
            self._folder.write_record(record)
        return record

    def _loaded_files(self, record: RunRecord) -> dict[str, frozenset[str]]:
        """The files that each process of the graph has loaded, by its name."""
        assert self._starts is not None  # noqa: S101 - see the caller
        files = self._starts.loaded_files()
        modules = modules_of_programs(self._scratch / MODULES_FOLDER)
        for process in record.processes:
            if process.pid in modules:
                files[process.name] = files.get(process.name, frozenset()) | modules[process.pid]
        return files

    def _execute(self) -> None:
        _require_rclpy()
        self._check_profiler()
        check_middleware(self._plan, os.environ)
        SecretReferences(self._plan.environment, os.environ).require_set(self._plan)
        self._resources.start()
        with self._domain() as domain:
            self._set_up(domain)
            # What is built by a setup step is a part of the graph.
            self._identify()
            self._check_programs_installed()
            if "load" in self._plan.phases:
                self._start_early(domain)
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
            # Detect a process that exited after the last message, which also fails the run.
            self._supervisor.pump(0.0)
            self._sessions()[-1].note_loaded_files()
            self._phase("collect", "stopping all processes and collecting the samples")
            # Before the domain is released, so that no other run sees these processes.
            self._supervisor.end(list(self._supervisor))

    def _check_profiler(self) -> None:
        if self.profile:
            profiled_processes(self._plan, self.profile_node)
            require_usable(find_profiler(self.profile))

    def _check_programs_installed(self) -> None:
        """Check that every program exists before any is started, but after the setup steps."""
        with self._clock.waiting("programs: found, or built"):
            for process in self._plan.processes:
                argv = resolve_argv(process)
                if process.join is not None:
                    require_joinable(process.name, argv)
            if self._plan.harness.placement == "graph":
                build_join_files()

    def _domain(self) -> contextlib.AbstractContextManager[int]:
        """A reserved domain; the user's own domain if the graph has external nodes."""
        if self._plan.external:
            return contextlib.nullcontext(int(os.environ.get("ROS_DOMAIN_ID", "0")))
        return reserved_domain()

    def _check(self) -> None:
        """Check for signals and memory limits; called whenever the controller waits.

        Raises:
            InterruptedRunError: a signal has arrived.
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
                    f"process {child.name} uses {Size(resident)} of memory; "
                    f"its limit is {Size(limit)}",
                    hint="Increase 'memory_limit', or reduce the memory use of the process.",
                )

    def _note_clock_steps(self) -> None:
        steps_before, before_ns = self._clocks.steps, self._clocks.total_step_ns
        self._clocks.update()
        if self._clocks.steps > steps_before:
            moved_s = (self._clocks.total_step_ns - before_ns) / 1e9
            self._note(
                f"the system clock was set by {moved_s:+.3f} s; this does not affect the times of "
                "this run, which are on the monotonic clock"
            )

    def _set_up(self, domain: int) -> None:
        if not self._plan.setup:
            return
        self._phase("setup", "running the setup steps")
        environment = self._environment(domain)
        for step in self._plan.setup:
            run_setup_step(
                step, self._supervisor, environment, self._folder, self._base_dir, self._note
            )

    def _identify(self) -> None:
        if self.identity is None:
            self.identity = graph_identity(self._plan, self._base_dir)

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
        """A launcher whose transport is sized for the largest buffered message.

        Preprocessors may publish larger messages than those in the bag, so each phase has its own.
        """
        made = self._new_launcher(domain)
        if self._early_launcher is not None:
            made.adopt_early(self._early_launcher)
        self._launchers.append(made)
        return made

    def _new_launcher(self, domain: int) -> Launcher:
        return Launcher(self._supervisor, self._environment(domain), self._folder, self._base_dir)

    def _start_early(self, domain: int) -> None:
        """Let the processes that come next import ROS while the recordings are read.

        With the harness in the graph they would ask for it, which they can only later.
        """
        phase = "preprocess" if "preprocess" in self._plan.phases else MEASURE_PHASE
        if phase == MEASURE_PHASE and self._plan.harness.placement == "graph":
            return
        self._early_launcher = self._new_launcher(domain)
        self._early_launcher.start_early(
            (each for each in self._plan.processes if each.phase == phase),
            message_packages(self._plan),
            observer=phase == MEASURE_PHASE,
        )

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
        """Measure in the starts of the plan and, if the run fails, in as many that confirm it."""
        reporter = RunReporter(
            self._phase,
            self._note,
            self._write_partial_record,
            self._progress,
            self._resources,
            HostWatch(
                self._resources,
                lambda: len(self._supervisor.records()),
                self._machine.get("cores"),
            ),
        )
        starts = self._starts = StartSequence(
            self._plan,
            self._supervisor,
            partial(self._launcher, domain),
            self._folder,
            self._base_dir,
            self._scratch,
            reporter,
        )
        try:
            self._measure_in(starts, reporter)
        except RunError as error:
            starts.name_start(error)
            raise
        if self.profile:
            self._play_with_profiler(starts)

    def _play_with_profiler(self, starts: StartSequence) -> None:
        wait_for_last_sample(starts)
        profiler = find_profiler(self.profile)
        self._phase("profile", f"playing one more iteration with {profiler.name}")
        self._profiles = ProfiledIteration(
            self._plan,
            profiler,
            profiled_processes(self._plan, self.profile_node),
            self._supervisor,
            starts,
            self._folder,
        ).play(self._measurements[0].peak_hz)
        for each in self._profiles:
            self._note(f"profile of {each.process}: {each.error or ', '.join(each.files)}")

    def _measure_in(self, starts: StartSequence, reporter: RunReporter) -> None:
        began_s = time.monotonic()
        measurement = self._begin(starts, reporter, self._judge_so_far)
        verdict, iterations = measurement.measure()
        if self.record_outputs:
            self._phase("record", "recording the messages of one more iteration")
            for topic, count in self._sessions()[-1].record_outputs().items():
                self._note(f"recorded {count} messages of {topic}")
        if any(each.truth is not None for each in self._plan.monitors):
            self._phase("truth", "comparing one more iteration with the truth")
            folders = tuple(each.path for each in self._datasets)
            self._accuracy = self._sessions()[-1].compare_with_truth(folders)
        if starts.find_foreign_publishers():
            # Others took part in what was measured: a fresh batch would confirm nothing.
            return
        if not self._plan.gate.confirm or not needs_confirmation(verdict):
            return
        if self._plan.external:
            self._note("no confirmation run: r2bspec cannot restart external nodes")
            return
        if not self._budget.allows("no confirmation run", time.monotonic() - began_s):
            return
        self._phase("confirm", "the run fails: starting the confirmation run in new processes")
        peak_hz = measurement.peak_hz
        judge_again = partial(self._judge_confirmation, verdict)
        measurement = self._begin(starts, reporter, judge_again, confirms=True)
        failed = {each.method for each in verdict.requirements if each.outcome == "fail"}
        measurement.measure_confirmation(frozenset(failed), iterations, peak_hz)
        starts.find_foreign_publishers()

    def _begin(
        self,
        starts: StartSequence,
        reporter: RunReporter,
        judge_so_far: Callable[[], Verdict],
        *,
        confirms: bool = False,
    ) -> Measurement:
        """Start all processes for the run or for its confirmation."""
        measurement = Measurement(
            self._plan,
            starts.begin(confirms=confirms),
            reporter,
            judge_so_far,
            self._budget,
            partial(starts.begin, confirms=confirms),
            # A confirmation run plays as many iterations as the run that it confirms.
            self._lost_rates if self.abort_on_fail and not confirms else None,
        )
        self._measurements.append(measurement)
        return measurement

    def _judge_so_far(self) -> Verdict:
        """The verdict on the run if it ended now, without a confirmation."""
        samples = self._samples_so_far()
        return judge(self._plan.objectives, samples, decision_policy(self._plan))

    def _lost_rates(self) -> dict[float, str]:
        """The rates with a requirement that can no longer be met, and which one that is."""
        samples = self._samples_so_far()
        verdict = judge(self._plan.objectives, samples, decision_policy(self._plan))
        return {
            failed.at_hz: f"'{failed.text.strip()}' can no longer be met"
            for failed in certain_failures(verdict, samples, self._plan)
            if failed.at_hz is not None
        }

    def _judge_confirmation(self, first: Verdict) -> Verdict:
        """The verdict on the confirmation run if it ended now, given that on the run."""
        fresh = self._samples_so_far().confirmation
        assert fresh is not None  # noqa: S101 - it is being played
        return judge_confirmation(self._plan.objectives, fresh, first, self._plan.gate.interference)

    def _samples_so_far(self) -> RunSamples:
        """The samples of everything that has been played, as if the run had ended now."""
        # If the run is killed before its next look, its folder has the samples of this one.
        self._write_resource_samples()
        samples = {
            name: each for session in self._sessions() for name, each in session.samples.items()
        }
        return run_samples(
            self._record(None),
            self._plan,
            lambda segment: samples[segment.id],
            HostSamples(self._resources.rows(), self._resources.interference()),
        )

    def _sessions(self) -> list[Session]:
        return self._starts.sessions if self._starts else []

    def _write_resource_samples(self) -> None:
        self._folder.write_resources(self._resources.rows())
        self._folder.write_interference(self._resources.interference())

    def _write_partial_record(self) -> None:
        """Write the current record, so that a killed run can also be read."""
        self._folder.write_record(self._record(RunError("the run was killed", code="R2B671")))

    def _phase(self, name: str, text: str) -> None:
        self._clock.begin(name)
        self._events.append((time.monotonic_ns(), f"phase {name}"))
        self._progress.phase(name, text)

    def _note(self, text: str) -> None:
        self._events.append((time.monotonic_ns(), text))
        self._progress.note(text)

    def _provenance(self) -> dict[str, Any]:
        """The recordings that were read; those after the first are under ``also``."""
        if not self._datasets:
            return {}
        first, *others = (each.provenance for each in self._datasets)
        return first | ({"also": others} if others else {})

    def _differences(self, failure: BaseException | None) -> tuple[Difference, ...]:
        """The differences between the graph and the plan, without duplicates."""
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
        elif self._starts and self._starts.foreign:
            status, reason = "invalid", _foreign_reason(self._starts.foreign)
        first = self._measurements[0] if self._measurements else None
        again = self._measurements[1:]
        sessions = self._sessions()
        fresh_overhead = next((each.harness_overhead for each in sessions if each.confirms), ())
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
            segments=tuple(each for session in sessions for each in session.segments),
            search=first.search if first else None,
            sustained=first.sustained if first else (),
            events=tuple(self._events),
            harness_overhead=sessions[0].harness_overhead if sessions else (),
            output_gaps=tuple(each for session in sessions for each in session.output_gaps),
            differences=self._differences(failure),
            confirmation=again[0].confirmation(fresh_overhead) if again else None,
            left_out=tuple(self._budget.left_out),
            ended_rates=tuple(self._budget.ended_rates),
            starts=tuple(self._starts.records) if self._starts else (),
            unplayed=sessions[0].unplayed if sessions else (),
            profiles=self._profiles,
            accuracy=self._accuracy,
            phases=self._clock.phases(),
            identity=self.identity,
            gate=self.gate,
        )


_NOT_BY_DISK = (GraphMismatchError, InterruptedRunError, UnsupportedError, UnwritableRunError)
"""Errors that a full disk does not lead to, or that name it."""


def _without_room(log: Path, error: RunError) -> UnwritableRunError:
    """The error of a run that failed because a node could not write its log."""
    return UnwritableRunError(
        f"{log} cannot be written: {os.strerror(errno.ENOSPC)}",
        hint=f"Free space on this disk, or let the nodes print less. What failed first: {error}",
    )


def _require_rclpy() -> None:
    """See that the processes of the harness can be started, before any data is read.

    Raises:
        NotInstalledError: rclpy is not installed.
    """
    if find_module("rclpy") is None:
        raise NotInstalledError(
            "rclpy is not installed",
            hint="Source a ROS 2 installation, or pip install 'r2bspec[ros]'.",
        )


def _unwritable(error: OSError | RecordError, folder: Path) -> RunError:
    text = str(error)
    if isinstance(error, OSError):
        text = f"{error.filename or folder} cannot be written: {error.strerror or error}"
    hint = "Free space on this disk, or choose another folder with --output."
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
