"""The controller: takes a run from state to state, and writes its record.

Each state of the whole run (`r2bspec.execute.states`) is a method of `_Run`, in the order of the
states; those of one start are in `r2bspec.execute.start.start`. At the end of a run, even of a
failed one, no process of the run is left, the run folder contains everything that was measured, and
its record states whether the run is complete.
"""

from __future__ import annotations

import contextlib
import datetime
import errno
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from r2bspec.errors import R2bspecError, refusal_hint
from r2bspec.execute import errors
from r2bspec.execute.anatomy import events_folder
from r2bspec.execute.bringup.launcher import Launcher
from r2bspec.execute.fill_buffers import buffer_bags, obtain_dataset, played_digest, preprocess
from r2bspec.execute.identity.identify_graph import graph_identity, observed_identity
from r2bspec.execute.identity.loaded_files import LoadedFiles
from r2bspec.execute.measurement.extra_iteration import (
    find_profiler,
    play_observed,
    play_profiled,
    profiled_processes,
    require_usable,
    wait_for_last_sample,
)
from r2bspec.execute.measurement.measurement import Measurement
from r2bspec.execute.measurement.turns import Filled, Partner, play_by_turns
from r2bspec.execute.processes import environment as run_environment
from r2bspec.execute.processes import prerequisites
from r2bspec.execute.processes.machine import describe_machine, describe_versions, unwritable_log
from r2bspec.execute.processes.resources import ResourceSampler
from r2bspec.execute.processes.scheduling import require_permitted
from r2bspec.execute.processes.supervisor import ProcessSupervisor
from r2bspec.execute.run_context import MEASURE_PHASE, HostWatch, RunContext, TimeBudget
from r2bspec.execute.start.start import StartSequence
from r2bspec.execute.states import Interrupts, Progress, RunState, RunStates
from r2bspec.extras import install_command
from r2bspec.ipc.buffers import largest_message_bytes
from r2bspec.ipc.network import NetworkError, NetworkNamespace
from r2bspec.judge.decision_policy import decision_policy
from r2bspec.judge.judge_run import judge_confirmation
from r2bspec.judge.measure.host_usage import ProcessSamples
from r2bspec.judge.measure.run_samples import HostSamples, run_samples
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.verdict import Verdict
from r2bspec.language.quantities import Size
from r2bspec.native.build import anatomy_object, harness_library, join_object
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.plan.plan import Plan
from r2bspec.plan.this_machine import find_module
from r2bspec.record.files import RecordError
from r2bspec.record.graph_identity import GraphIdentity
from r2bspec.record.run_folder import RunFolder, write_loaded_files
from r2bspec.record.run_record import (
    AnatomyRecord,
    ConfirmationRecord,
    Difference,
    ProfileRecord,
    RunRecord,
)
from r2bspec.safe_io.private_files import remove_folder


@dataclass(frozen=True)
class RunOptions:
    """The options of a run that are not in its plan.

    Attributes:
        anatomy: observe one more iteration from inside.
        profile: a profiler for one more iteration; empty for none (`find_profiler`).
        identity: what the graph is made of; looked up if None, after the setup steps.
        top: of the work tree of `identity`; looked up if None.
        gate: what reports say of the merge gate, one sentence each.
        partner: the other side of a comparison by turns, of which this run is a side.
    """

    anatomy: bool = False
    profile: str = ""
    identity: GraphIdentity | None = None
    top: Path | None = None
    gate: tuple[str, ...] = ()
    partner: Partner | None = None


def run_plan(
    plan: Plan,
    *,
    base_dir: Path,
    folder: RunFolder,
    run_id: str,
    spec_text: str,
    progress: Progress,
    options: RunOptions = RunOptions(),
) -> RunRecord:
    """Execute a plan; the run folder is written completely when this returns or raises.

    Args:
        plan: of the run.
        base_dir: the folder of the spec, to which its paths are relative.
        folder: receives the samples, logs and the record.
        run_id: names the run; also marks its processes.
        spec_text: the resolved spec, for the record.
        progress: receives phases, notes and progress.
        options: what it does apart from the plan.

    Raises:
        UsageError: there is no process to profile.
        RunError: the run failed; its record is marked as incomplete and gives the reason.
        DataError: the bag does not exist or cannot be read.
        InterruptedRunError: a signal interrupted the run.
    """
    folder.write_plan(canonical_json(plan).decode())
    folder.write_spec(spec_text)
    # In the run folder, because the user chose a disk with space for it; removed after the run.
    with (
        Interrupts() as interrupts,
        _scratch_folder(folder.path) as scratch,
        events_folder(plan, scratch)
        if options.anatomy or plan.anatomy
        else contextlib.nullcontext(scratch) as events,
    ):
        run = _Run(plan, options, base_dir, folder, run_id, scratch, events, progress, interrupts)
        return run.execute()


@contextlib.contextmanager
def _scratch_folder(parent: Path) -> Iterator[Path]:
    """Yield a folder, which is removed with all that nodes have left in it."""
    scratch = Path(tempfile.mkdtemp(prefix=".scratch-", dir=parent))
    try:
        yield scratch
    finally:
        remove_folder(scratch)


class _Run:
    """One run: its states, and what has come of them so far."""

    def __init__(
        self,
        plan: Plan,
        options: RunOptions,
        base_dir: Path,
        folder: RunFolder,
        run_id: str,
        scratch: Path,
        events: Path,
        progress: Progress,
        interrupts: Interrupts,
    ) -> None:
        self._plan = plan
        self._options = options
        self._identity = options.identity
        self._run_id = run_id
        self._interrupts = interrupts
        self._started_at = _now()
        self._machine = describe_machine()
        self._versions = describe_versions()
        self._datasets: tuple[dict[str, Any], ...] = ()
        self._played = ""
        # Checked several times a second, and empty for most plans.
        self._memory_limits = {
            process.name: process.memory_limit_bytes
            for process in plan.processes
            if process.memory_limit_bytes
        }
        states, resources = RunStates(progress), ResourceSampler(run_id)
        supervisor = ProcessSupervisor(
            run_id,
            scratch,
            self._check,
            lambda child: resources.add(child.pid),
            run_environment.make_redactor(os.environ),
            events,
        )
        self._states = states
        self._context = RunContext(
            states=states,
            supervisor=supervisor,
            folder=folder,
            base_dir=base_dir,
            scratch=scratch,
            events=events,
            progress=progress,
            resources=resources,
            host=HostWatch(resources, lambda: len(supervisor.records()), self._machine),
            loaded_files=LoadedFiles(
                supervisor, states.note, scratch / run_environment.MODULES_FOLDER
            ),
            on_segment=self._write_partial_record,
            budget=TimeBudget(plan.gate.time_budget_ns, states.note),
        )
        self._context.buffer_dir.mkdir()
        self._domain = 0
        self._network: NetworkNamespace | None = None
        self._launchers: list[Launcher] = []
        self._starts = StartSequence(plan, self._context, self._launcher)
        self._measurement = Measurement(plan, self._context, self._starts, self._judge_so_far)
        self._anatomy: AnatomyRecord | None = None
        self._profiles: tuple[ProfileRecord, ...] = ()

    def execute(self) -> RunRecord:
        """Execute the plan; then, even after a failure, clean up and write the record."""
        failure: BaseException | None = None
        path = self._context.folder.path
        try:
            self._write_partial_record()
            self._pass_states()
        except (OSError, RecordError) as error:
            failure = _unwritable(error, path)
            raise failure from error
        except errors.RunError as error:
            failure = error
            full = None if isinstance(error, _NOT_BY_DISK) else unwritable_log(path)
            if full is None:
                raise
            # A node could not write its log.
            failure = errors.UnwritableRunError(
                f"{full} cannot be written: {os.strerror(errno.ENOSPC)}",
                hint="Free space on this disk, or let the nodes print less. What failed first: "
                f"{error}",
            )
            raise failure from error
        except BaseException as error:
            failure = error
            raise
        finally:
            record = self._stop(failure)
        return record

    def _pass_states(self) -> None:
        """Take the run through its states."""
        self._prepare()
        # External nodes are in the domain of the user.
        external = self._plan.external
        domain = (
            contextlib.nullcontext(prerequisites.domain_of_user())
            if external
            else prerequisites.reserved_domain()
        )
        with domain as self._domain:
            self._set_up()
            self._fill_buffers()
            try:
                self._measure()
            except errors.RunError as error:
                self._starts.name_start(error)
                raise
            self._play_with_profiler()
            self._observe_from_inside()
            self._collect()

    def _prepare(self) -> None:
        # The processes of the harness can be started, before any data is read.
        if find_module("rclpy") is None:
            raise errors.NotInstalledError(
                "rclpy is not installed",
                hint=f"Source a ROS 2 installation, or {install_command('ros')}.",
            )
        require_permitted(self._plan.processes)
        if self._options.profile:
            profiled_processes(self._plan)
            require_usable(find_profiler(self._options.profile))
        if self._options.anatomy or self._plan.anatomy:
            prerequisites.built(anatomy_object)
        prerequisites.check_middleware(self._plan, os.environ)
        if self._plan.network:
            try:
                self._network = NetworkNamespace(self._plan.network)
            except NetworkError as error:
                raise errors.CertainRunError(
                    str(error), hint=error.hint, code=error.code
                ) from error
        self._context.resources.start()

    def _set_up(self) -> None:
        plan, context = self._plan, self._context
        if plan.setup:
            self._states.enter(RunState.SETUP, "running the setup steps")
            launcher = self._new_launcher("setup")
            for step in plan.setup:
                launcher.run_setup_step(step, context.note)
        # What is built by a setup step is a part of the graph.
        if self._identity is None:
            self._identity = graph_identity(plan, context.base_dir)
        # Every program exists before any is started, but after the setup steps.
        for process in plan.processes:
            prerequisites.resolve_argv(process)
        if plan.harness.placement == "graph":
            for make in (join_object, harness_library):
                prerequisites.built(make)

    def _fill_buffers(self) -> None:
        """Make the messages that are played, unless the other side of a comparison has them."""
        partner, folder = self._options.partner, self._context.buffer_dir
        if partner is not None and (filled := partner.take_buffers(folder)) is not None:
            self._datasets = filled.provenance
            self._played = filled.played
            return
        self._load()
        self._preprocess()
        self._played = played_digest(self._plan, folder)
        if partner is not None:
            partner.share_buffers(folder, Filled(self._datasets, self._played))

    def _load(self) -> None:
        plan, context = self._plan, self._context
        if "load" not in plan.phases:
            return
        self._states.enter(RunState.LOAD, f"reading {plan.dataset.source}")
        with self._interrupts.immediate():
            sources = plan.datasets or (plan.dataset,)
            datasets = [
                obtain_dataset(source, context.base_dir, context.progress) for source in sources
            ]
            self._datasets = tuple(dataset.provenance for dataset in datasets)
            bags = [dataset.path for dataset in datasets]
            latched = [each.source for each in plan.latched_inputs]
            counts = buffer_bags(bags, sources, context.buffer_dir, context.progress, latched)
        context.note(", ".join(f"{topic}: {count} messages" for topic, count in counts.items()))
        self._interrupts.check()

    def _preprocess(self) -> None:
        if "preprocess" not in self._plan.phases:
            return
        self._states.enter(RunState.PREPROCESS, "running the preprocessors")
        preprocess(self._plan, self._context, self._launcher("preprocess"))

    def _measure(self) -> None:
        """Measure in the starts of the plan and, if the run fails, in as many that confirm it."""
        if self._options.partner is None:
            self._measurement.measure()
            return
        player = self._starts.begin()
        self._states.enter(RunState.PLAY, "playing by turns with the other side")
        play_by_turns(self._plan, player, self._options.partner)
        self._starts.find_foreign_publishers()

    def _observe_from_inside(self) -> None:
        if not self._options.anatomy or self._plan.anatomy is True:
            return
        wait_for_last_sample(self._starts)
        self._states.enter(RunState.ANATOMY, "observing one more iteration from inside")
        self._anatomy = play_observed(self._starts, self._peak_hz())
        if self._anatomy.error:
            self._context.note(f"anatomy: {self._anatomy.error}")

    def _play_with_profiler(self) -> None:
        if not self._options.profile:
            return
        wait_for_last_sample(self._starts)
        profiler = find_profiler(self._options.profile)
        self._states.enter(RunState.PROFILE, f"playing one more iteration with {profiler.name}")
        self._profiles = play_profiled(self._starts, profiler, self._peak_hz())
        for profile in self._profiles:
            outcome = profile.error or ", ".join(profile.files)
            self._context.note(f"profile of {profile.process}: {outcome}")

    def _peak_hz(self) -> float | None:
        return self._measurement.batches[0].peak_hz

    def _collect(self) -> None:
        supervisor = self._context.supervisor
        # Detect a process that exited after the last message, which also fails the run.
        supervisor.pump(0.0)
        self._starts.starts[-1].look_at_loaded_files()
        self._states.enter(RunState.COLLECT, "stopping all processes and collecting the samples")
        # Before the domain is released, so that no other run sees these processes.
        supervisor.end(list(supervisor))

    def _stop(self, failure: BaseException | None) -> RunRecord:
        """End all processes that still run, and write the samples and the record."""
        context = self._context
        killed = context.supervisor.close()
        if self._network is not None:
            self._network.close()
        if killed:
            context.note(f"killed, because they did not exit: {', '.join(sorted(set(killed)))}")
        if context.supervisor.lost_watchdog:
            context.note(
                "the watchdog was killed: if r2bspec had been, too, processes would have been left"
            )
        if cut := context.supervisor.truncated_logs:
            context.note(f"truncated large logs: {', '.join(log.name for log in cut)}")
        processes = context.supervisor.records()
        loaded = context.loaded_files.by_process(processes, complete=failure is None)
        if self._identity is not None:
            self._identity = observed_identity(
                self._identity, self._plan, context.base_dir, loaded, self._options.top
            )
        record = self._record(failure)
        # If the disk is full, this frees the space for the record.
        remove_folder(context.buffer_dir)
        # If there are several failures, the first one is reported.
        with contextlib.suppress(RecordError) if failure else contextlib.nullcontext():
            context.resources.stop()
            self._write_resource_samples()
            if self._starts.starts:
                write_loaded_files(context.folder.path, loaded)
        with contextlib.suppress(RecordError) if failure else contextlib.nullcontext():
            context.folder.write_record(record)
        return record

    def _check(self) -> None:
        """Check for signals and memory limits; called whenever the controller waits.

        Raises:
            InterruptedRunError: a signal has arrived.
            RunError: a process uses more memory than the spec allows (R2B635).
        """
        self._interrupts.check()
        if not self._memory_limits:
            return
        for child in self._context.supervisor:
            limit = self._memory_limits.get(child.name)
            resident = self._context.resources.resident(child.pid)
            if limit is not None and resident > limit and not child.exit_expected:
                raise errors.RunError(
                    f"process {child.name} uses {Size(resident)} of memory; "
                    f"its limit is {Size(limit)}",
                    hint="Increase 'memory_limit', or reduce the memory use of the process.",
                    code="R2B635",
                )

    def _launcher(self, phase: str = MEASURE_PHASE) -> Launcher:
        """Return a launcher whose transport is sized for the largest buffered message.

        Preprocessors may publish larger messages than those in the bag, so each phase has its own.
        """
        launcher = self._new_launcher(phase)
        self._launchers.append(launcher)
        return launcher

    def _new_launcher(self, phase: str) -> Launcher:
        context = self._context
        environment = run_environment.RunEnvironment(
            self._plan,
            run_id=self._run_id,
            domain=self._domain,
            scratch=context.scratch,
            largest_message_bytes=max(
                self._plan.largest_message_bytes, largest_message_bytes(context.buffer_dir)
            ),
            ros_logs=context.folder.ros_logs,
        )
        is_measured = phase == MEASURE_PHASE
        network = self._network.prefix if self._network is not None and is_measured else ()
        return Launcher(context.supervisor, environment, context.folder, context.base_dir, network)

    def _judge_so_far(self, failed: Verdict | None) -> Verdict:
        """Judge the run as if it ended now; given a failure, only what confirms it."""
        samples, policy = self._samples_so_far(), decision_policy(self._plan)
        if failed is None:
            return judge(self._plan.objectives, samples, policy)
        assert samples.confirmation is not None  # noqa: S101 - it is being played
        return judge_confirmation(self._plan.objectives, samples.confirmation, failed, policy)

    def _samples_so_far(self) -> RunSamples:
        """Return the samples of everything that has been played, as if the run had ended now."""
        # If the run is killed before its next look, its folder has the samples of this one.
        self._write_resource_samples()
        samples = {
            segment: start.samples[segment]
            for start in self._starts.starts
            for segment in start.samples
        }
        resources = self._context.resources
        return run_samples(
            self._record(None),
            self._plan,
            lambda segment: samples[segment.id],
            HostSamples(
                ProcessSamples(resources.rows()),
                resources.interference(),
                ProcessSamples(resources.devices()),
            ),
        )

    def _write_resource_samples(self) -> None:
        folder, resources = self._context.folder, self._context.resources
        folder.write_rows("resources", resources.rows())
        folder.write_rows("interference", resources.interference())
        if (devices := resources.devices()).size:
            folder.write_rows("devices", devices)

    def _write_partial_record(self) -> None:
        """Write the current record, so that a killed run can also be read."""
        killed = errors.RunError("the run was killed", code="R2B671")
        self._context.folder.write_record(self._record(killed))

    def _provenance(self) -> dict[str, Any]:
        """Return the recordings that were read; those after the first are under ``also``."""
        if not self._datasets:
            return {}
        first, *others = self._datasets
        return first | ({"also": others} if others else {}) | {"played": self._played}

    def _differences(self, failure: BaseException | None) -> tuple[Difference, ...]:
        """Return the differences between the graph and the plan, without duplicates."""
        found = [each for launcher in self._launchers for each in launcher.differences]
        if isinstance(failure, errors.GraphDifferencesError):
            found += failure.differences
        return tuple(dict.fromkeys(found))

    def _anatomies(self) -> tuple[AnatomyRecord, ...]:
        """Return what was observed from inside in each start, and why one more start was not."""
        observed = {
            start.number: start.anatomy.record
            for start in self._starts.starts
            if start.anatomy is not None
        }
        if self._anatomy is not None:
            observed[self._anatomy.start] = self._anatomy
        return tuple(observed.values())

    def _record(self, failure: BaseException | None) -> RunRecord:
        status: Literal["complete", "incomplete", "invalid"] = "complete"
        reason = ""
        if failure is not None:
            status = failure.status if isinstance(failure, errors.RunError) else "incomplete"
            reason = _reason(failure)
        elif self._starts.foreign:
            status = "invalid"
            reason = (
                "A program outside of this run has published on "
                f"{'; '.join(self._starts.foreign)}. The measurement is not of the graph alone."
            )
        # As a process of the harness says; before one has, the one that is selected.
        rmw = next(({"rmw": each.rmw} for each in self._launchers if each.rmw), {})
        first, again = (*self._measurement.batches, None, None)[:2]
        starts = self._starts.starts
        return RunRecord(
            run_id=self._run_id,
            plan_hash=plan_hash(self._plan),
            started_at=self._started_at,
            ended_at=_now(),
            status=status,
            reason=reason,
            dataset=self._provenance(),
            machine=self._machine,
            versions=self._versions | rmw,
            processes=self._context.supervisor.records(),
            segments=tuple(segment for start in starts for segment in start.segments),
            search=first.search_record if first else None,
            sustained=tuple(first.sustained) if first else (),
            events=tuple(self._states.events),
            output_gaps=tuple(silence for start in starts for silence in start.output_gaps),
            differences=self._differences(failure),
            confirmation=ConfirmationRecord(
                search=again.search_record, sustained=tuple(again.sustained)
            )
            if again
            else None,
            left_out=tuple(self._context.budget.left_out),
            starts=tuple(self._starts.records),
            unplayed=starts[0].unplayed if starts else (),
            anatomies=self._anatomies(),
            profiles=self._profiles,
            identity=self._identity,
            gate=self._options.gate,
            exit_status=failure.exit_code if isinstance(failure, R2bspecError) else 0,
        )


_NOT_BY_DISK = (
    errors.GraphDifferencesError,
    errors.InterruptedRunError,
    errors.MiddlewareError,
    errors.UnwritableRunError,
)
"""Errors that a full disk does not lead to, or that name it."""


def _unwritable(error: OSError | RecordError, folder: Path) -> errors.RunError:
    if isinstance(error, RecordError):
        return errors.UnwritableRunError(str(error), hint=error.hint)
    text = f"{error.filename or folder} cannot be written: {error.strerror or error}"
    return errors.UnwritableRunError(text, hint=refusal_hint(error))


def _reason(failure: BaseException) -> str:
    if isinstance(failure, R2bspecError):
        return f"{failure.code}: {failure}"
    return f"{type(failure).__name__}: {failure}"


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
