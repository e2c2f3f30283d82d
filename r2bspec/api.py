"""The public interface: the stages of a benchmark, combined as on the command line."""

from __future__ import annotations

import contextlib
import datetime
import math
import re
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from r2bspec.diagnostics.quote import pluralize
from r2bspec.errors import OUTPUT_FOLLOWS, ExitStatus, R2bspecError, split_output
from r2bspec.language.selected_spec import SelectionValues, select
from r2bspec.language.selected_spec import SpecSelection as SpecSelection
from r2bspec.plan.prepared_benchmark import SPEC_BESIDE_PLAN
from r2bspec.plan.prepared_benchmark import PreparedBenchmark as PreparedBenchmark

if TYPE_CHECKING:
    from r2bspec.compare.base_reference import BaseReference
    from r2bspec.compare.merge_gate import ComparedSpec, GateSides, MergeGate
    from r2bspec.diagnostics import Diagnostic
    from r2bspec.execute.controller import RunOptions
    from r2bspec.execute.states import Progress
    from r2bspec.judge.result import Result
    from r2bspec.language.load_spec import LoadedSpec
    from r2bspec.language.spec import Spec
    from r2bspec.plan.plan import Plan
    from r2bspec.record.graph_identity import GraphIdentity
    from r2bspec.record.run_folder import Run, RunFolder


class GraphMismatchError(R2bspecError):
    """A run failed at a place of the spec: the graph differs, or a process has ended.

    Attributes:
        diagnostics: the differences, at their places in the spec, sorted by place.
        loaded: the document, with the texts that the diagnostics refer to.
        details: what there is to say apart from the diagnostics; may be empty.
    """

    def __init__(
        self,
        error: R2bspecError,
        loaded: LoadedSpec,
        diagnostics: Sequence[Diagnostic],
        details: str = "",
    ) -> None:
        super().__init__(str(error), hint=error.hint, code=error.code)
        self.exit_code = error.exit_code
        self.loaded = loaded
        self.details = details
        self.diagnostics = tuple(diagnostics)


class InvalidSpecError(R2bspecError):
    """A spec with errors.

    Attributes:
        diagnostics: all findings, sorted by place.
        loaded: the document, with the texts that the diagnostics refer to.
    """

    code = "R2B602"
    exit_code = ExitStatus.USAGE

    def __init__(self, loaded: LoadedSpec, diagnostics: Sequence[Diagnostic]) -> None:
        errors = sum(diagnostic.severity == "error" for diagnostic in diagnostics)
        super().__init__(
            f"{loaded.file} is not valid: {pluralize(errors, 'error')}",
            hint="'r2bspec validate' shows what is wrong, 'r2bspec docs CODE' why.",
        )
        self.loaded = loaded
        self.diagnostics = tuple(diagnostics)


PrepareBase = Callable[["BaseReference"], PreparedBenchmark]
"""Prepares the base of a comparison, if it differs from the head in more than the environment."""


def load(spec: SpecSelection | Path | str, **values: Unpack[SelectionValues]) -> Spec:
    """Load a spec; the arguments are those of `prepare`.

    Raises:
        InvalidSpecError: it is not valid; see its `diagnostics`.
    """
    loaded = select(spec, values).load()
    if loaded.spec is None:
        raise InvalidSpecError(loaded, loaded.diagnostics)
    return loaded.spec


def validate(
    spec: SpecSelection | Path | str, **values: Unpack[SelectionValues]
) -> tuple[Diagnostic, ...]:
    """Return all findings in all cases of a spec, or in a selected case, sorted by place.

    Nothing that the spec names is executed. The arguments are those of `prepare`.
    """
    from r2bspec.check import check_cases

    return tuple(check_cases(select(spec, values).load_cases()))


def prepare(
    spec: SpecSelection | Path | str, *, smoke: bool = False, **values: Unpack[SelectionValues]
) -> PreparedBenchmark:
    """Check a spec and compile its plan, or read a plan from a ``.json`` file.

    Args:
        spec: the file, or a selection (`r2bspec.language.selected_spec.SpecSelection`).
        smoke: prepare a smoke run, which judges nothing: see `r2bspec.plan.smoke_plan`.
        values: fields of the selection by name: `sets`, `variables`, `case` and `allow_paths`.
            They replace those of a selection that is given.

    Raises:
        InvalidSpecError: the spec has errors.
        PlanError: the file is not a valid plan.
        UntrustedPlanError: a stranger's plan reads environment variables.
        DataError: the bag does not exist or is not readable.
    """
    selection = select(spec, values)
    if selection.spec.suffix == ".json":
        return _stored_plan(selection, smoke=smoke)
    return prepare_loaded(selection.load(), smoke=smoke)


def prepare_loaded(loaded: LoadedSpec, *, smoke: bool = False) -> PreparedBenchmark:
    """Check a document that has been loaded, and compile its plan.

    Args:
        loaded: the document.
        smoke: as for `prepare`.

    Raises:
        InvalidSpecError: it has errors.
        DataError: the bag does not exist or is not readable.
    """
    import msgspec

    from r2bspec.check.engine import check, context_of
    from r2bspec.plan.compile_plan import compile_plan

    context = context_of(loaded)
    diagnostics = check(loaded, context=context)
    if smoke:
        # Nothing is judged: how many messages a verdict needs does not matter.
        diagnostics = [
            diagnostic for diagnostic in diagnostics if not diagnostic.code.startswith("R2B5")
        ]
    if context is None or any(diagnostic.severity == "error" for diagnostic in diagnostics):
        raise InvalidSpecError(loaded, diagnostics)
    plan = compile_plan(
        context.spec,
        context.require_bags(),
        companion_files=context.companion_files,
        wiring=context.wiring,
    )
    if smoke:
        from r2bspec.plan.smoke_plan import smoke_plan

        plan = smoke_plan(plan)
    return PreparedBenchmark(
        # The case is part of the name by which results are stored and compared.
        plan=msgspec.structs.replace(plan, name=loaded.id) if loaded.case else plan,
        base_dir=loaded.base_dir.absolute(),
        spec_text=loaded.resolved_yaml(),
        diagnostics=tuple(diagnostics),
        loaded=loaded,
    )


def _stored_plan(selection: SpecSelection, *, smoke: bool) -> PreparedBenchmark:
    """Return the plan in a file, and the resolved spec if the same folder has it."""
    from r2bspec.plan.canonical_json import read_plan
    from r2bspec.record.run_folder import read_spec_text

    plan = read_plan(selection.spec)
    if smoke:
        from r2bspec.plan.smoke_plan import smoke_plan

        plan = smoke_plan(plan)
    spec_text = read_spec_text(selection.spec.with_suffix(SPEC_BESIDE_PLAN))
    return PreparedBenchmark(plan, selection.spec.parent.absolute(), spec_text)


def compile_plan(spec: SpecSelection | Path | str, **values: Unpack[SelectionValues]) -> Plan:
    """Return the plan of a spec; the arguments are those of `prepare`.

    Raises:
        InvalidSpecError: the spec has errors.
        DataError: the bag does not exist or is not readable.
    """
    return prepare(spec, **values).plan


def run(
    prepared: PreparedBenchmark,
    output: Path | None = None,
    progress: Progress | None = None,
    *,
    anatomy: bool = False,
    profile: str = "",
    wait_s: float | None = math.inf,
    identity: GraphIdentity | None = None,
    gate: Sequence[str] = (),
) -> Result:
    """Run a benchmark on real ROS 2, and judge it.

    Args:
        prepared: from `prepare`.
        output: the run folder, new or empty; by default one below ``runs/``.
        progress: is notified of progress.
        anatomy: play one more iteration in processes that are observed from inside.
        profile: play one more iteration with this profiler: ``perf``, ``py-spy``, ``nsys``, or the
            words before the command of a process, in which ``$(profile)`` is its file.
        wait_s: how long to wait while this host runs other benchmarks, which is then noted; None
            to run next to them.
        identity: the identity of the graph, if it is known already.
        gate: what reports say of a merge gate, one sentence each.

    Raises:
        HostBusyError: it runs them for longer.
        GraphMismatchError: the graph differs from the spec, which was compiled just now.
        RunError: the run failed; its folder has what was observed until then.
        RecordError: the run folder cannot be created.
        OtherMachineError: this machine is not what the spec requires.
    """
    from r2bspec.execute.controller import RunOptions
    from r2bspec.execute.processes.machine import check_machine
    from r2bspec.execute.states import Progress
    from r2bspec.plan.time_estimate import estimate_time
    from r2bspec.record.run_folder import RunFolder
    from r2bspec.safe_io.private_files import private_files

    check_machine(prepared.plan)
    listener = progress or Progress()
    options = RunOptions(anatomy, profile, identity=identity, gate=tuple(gate))
    with (
        queued_host(prepared.plan.name, estimate_time(prepared.plan).seconds, wait_s, listener),
        private_files(),
        RunFolder.create(output or default_run_folder(prepared.plan.name)) as folder,
    ):
        return _run_in_folder(folder, prepared, listener, options)


def queued_host(
    name: str, seconds: float, wait_s: float | None, progress: Progress
) -> AbstractContextManager[None]:
    """Wait for the runs that came before, then hold this host for the block.

    Args:
        name: the name of the benchmark, for those who wait.
        seconds: how long it will take.
        wait_s: as for `run`.
        progress: is notified while others are waited for.

    Raises:
        HostBusyError: others have the host for longer.
    """
    if wait_s is None:
        return contextlib.nullcontext()
    from r2bspec.execute.host_queue import Place, host_to_itself

    def on_wait(place: Place) -> None:
        progress.waiting(str(place), place.left())

    return host_to_itself(name, seconds=seconds, wait_s=wait_s, on_wait=on_wait)


def _run_in_folder(
    folder: RunFolder, prepared: PreparedBenchmark, progress: Progress, options: RunOptions
) -> Result:
    from r2bspec.execute.controller import run_plan

    with _failures_at_their_places(prepared.loaded):
        try:
            run_plan(
                prepared.plan,
                base_dir=prepared.base_dir,
                folder=folder,
                run_id=secrets.token_hex(8),
                spec_text=prepared.spec_text,
                progress=progress,
                options=options,
            )
        except R2bspecError:
            # Write a result of what was measured, marked as incomplete; if that fails, too, the
            # first failure is reported.
            with contextlib.suppress(R2bspecError, OSError):
                _write_result(folder)
            raise
    return _write_result(folder)


@contextlib.contextmanager
def _failures_at_their_places(
    loaded: LoadedSpec | None, base: LoadedSpec | None = None
) -> Iterator[None]:
    """Raise failures of the runs of a block with their places in the spec, where they have any.

    Args:
        loaded: the spec that is run.
        base: the spec of the base of a comparison, if a user has named it.
    """
    from r2bspec.check.rule import differences_to_diagnostics, failure_to_diagnostics
    from r2bspec.compare.interleaved_comparison import BaseFailsError
    from r2bspec.execute.errors import GraphDifferencesError as Differs
    from r2bspec.execute.errors import RunError

    try:
        yield
    except R2bspecError as error:
        failure = error.__cause__ if isinstance(error, BaseFailsError) else error
        of = loaded if failure is error else base
        if of is None or not isinstance(failure, RunError):
            raise
        if isinstance(failure, Differs):
            mismatches = differences_to_diagnostics(failure.differences, of)
            raise GraphMismatchError(error, of, mismatches, failure.details) from error
        text, output = split_output(str(error))
        at = failure_to_diagnostics(text, error.code, failure.hint, failure.blamed, of)
        if failure.blamed and at:
            output = output and f"{OUTPUT_FOLLOWS}{output}"
            raise GraphMismatchError(error, of, at, output) from error
        raise


def _write_result(folder: RunFolder) -> Result:
    from r2bspec.judge.judge_run import result_of, to_json
    from r2bspec.record.run_folder import open_run

    result = result_of(open_run(folder.path))
    folder.write_result(to_json(result))
    return result


def run_pairs(
    head: PreparedBenchmark,
    against: Sequence[str] = (),
    output: Path | None = None,
    progress: Progress | None = None,
    *,
    prepare_base: PrepareBase | None = None,
    pairs: int | None = None,
    control: bool = False,
    force: bool = False,
    wait_s: float | None = math.inf,
) -> Result:
    """Compare a graph with another graph, in interleaved runs on real ROS 2.

    Args:
        head: to be judged.
        against: the base (`r2bspec.compare.base_reference`); empty for a control.
        output: the folder of the comparison, new or empty; by default one below ``runs/``.
        progress: is notified of progress.
        prepare_base: prepares the base if it is another spec, or has other values.
        pairs: how many; as many as the spec has iterations if None.
        control: compare the head with itself, to see the noise.
        force: compare even with different loads.
        wait_s: as for `run`.

    Raises:
        HostBusyError: as for `run`.
        UsageError: the base is not valid.
        IncomparableError: the two are the same, or are offered different loads.
        InvalidSpecError: the spec of the base is not valid.
        RunError: a run failed; the folder has the pairs finished until then.
        RecordError: the folder cannot be created.
    """
    from r2bspec.compare.base_reference import parse_base_reference
    from r2bspec.compare.interleaved_comparison import (
        ComparisonSide,
        estimate_comparison,
        prepare_comparison,
    )
    from r2bspec.compare.interleaved_runs import compare
    from r2bspec.execute.processes.environment import applied_environment, workspace_environments
    from r2bspec.execute.states import Progress

    reference = parse_base_reference(against)
    environment = workspace_environments(reference.environments)
    base = head
    if reference.changes_spec:
        if prepare_base is None:
            raise ValueError("a base with another spec needs prepare_base")
        with applied_environment(environment):
            base = prepare_base(reference)
    sides = [
        ComparisonSide(side.plan, side.base_dir, side.spec_text, overrides)
        for side, overrides in ((base, environment), (head, {}))
    ]
    comparison = prepare_comparison(
        *sides, against=reference.text, pairs=pairs, control=control, force=force
    )
    name = f"{head.plan.name}-pairs"
    listener = progress or Progress()
    seconds = estimate_comparison(head.plan, pairs).seconds
    with (
        queued_host(name, seconds, wait_s, listener),
        _failures_at_their_places(head.loaded, base.loaded),
    ):
        return compare(comparison, output or default_run_folder(name), progress)


@contextlib.contextmanager
def open_gate(base: str, allow: Sequence[str] = ()) -> Iterator[MergeGate]:
    """Yield the merge gate of the repository that holds the working folder.

    Args:
        base: a revision of git.
        allow: what may differ from the base, by name.

    Raises:
        BaseRevisionError: there is no such revision, it is ambiguous, or it cannot be written.
    """
    from r2bspec.compare.base_tree import open_base_tree
    from r2bspec.compare.merge_gate import MergeGate
    from r2bspec.execute.states import Interrupts

    # The first signal ends the run in progress, and not this process, which has to tidy up.
    with Interrupts() as interrupts, open_base_tree(base) as tree:
        interrupts.check()
        yield MergeGate(tree, tuple(allow), prepare_loaded)


def run_gated(
    gate: MergeGate,
    compared: ComparedSpec,
    sides: GateSides,
    output: Path,
    progress: Progress | None = None,
    *,
    pairs: int | None = None,
) -> Result:
    """Compare a spec and its code with the base of a merge gate, in interleaved runs.

    Without a base, the head alone is run and judged; the result says why. The caller has the lock
    of the host.

    Args:
        gate: from `open_gate`.
        compared: the spec, from `MergeGate.compare`.
        sides: what is played of it, from `MergeGate.sides`.
        output: the run folder, new or empty.
        progress: is notified of progress.
        pairs: how many; as many as the spec has iterations if None.

    Raises:
        BaseFailsError: the base cannot be played, and that is not allowed.
        OtherSidesFilesError: a side has loaded files of the other one.
        RunError: the head failed; the folder has the pairs finished until then.
        RecordError: the folder cannot be created.
    """
    from r2bspec.compare.interleaved_comparison import BaseFailsError, prepare_comparison
    from r2bspec.compare.interleaved_runs import compare

    if sides.base is not None:
        comparison = prepare_comparison(
            sides.base,
            sides.head,
            against=gate.tree.name,
            pairs=pairs,
            force=True,
            gate=sides.sentences,
            check_run=sides.check,
        )
        try:
            with _failures_at_their_places(compared.head.loaded):
                return compare(comparison, output, progress)
        except BaseFailsError as error:
            sides = gate.alone_without_base(compared, error)
            # What was played is kept, beside the run of the head.
            output.rename(output.with_name(f"{output.name}-base-failed"))
    return run(
        replace(compared.head, plan=sides.head.plan),
        output,
        progress,
        wait_s=None,
        identity=sides.head.identity,
        gate=sides.sentences,
    )


def judge(run: Run) -> Result:
    """Judge a finished run, opened with `r2bspec.record.run_folder.open_run`. Needs no ROS.

    Raises:
        RecordError: a file of the run is missing or damaged.
    """
    from r2bspec.judge.judge_run import result_of

    return result_of(run)


def default_run_folder(name: str) -> Path:
    """Return the default run folder for a name: a folder below ``runs/``."""
    now = datetime.datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    return Path("runs") / f"{folder_name(name)}-{now}-{secrets.token_hex(2)}"


def folder_name(name: str) -> str:
    """Return the name of a benchmark and its case as a folder name: ``relay_threads=2``."""
    return re.sub(r"[^A-Za-z0-9_.=-]+", "_", name).strip("_") or "run"
