"""``r2bspec gate``: compare specs and their code with a base of git, and judge them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from r2bspec.cli import shared_options
from r2bspec.cli.run import RunArguments
from r2bspec.errors import R2bspecError
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.cli.spec_selection import SuiteEntry
    from r2bspec.compare.gated_specs import GatedSpec, GatedSpecs
    from r2bspec.compare.merge_gate import ComparedSpec, GateSides, MergeGate
    from r2bspec.judge.result import Result
    from r2bspec.plan.time_estimate import TimeEstimate
    from r2bspec.report.progress import RemainingTime
    from r2bspec.report.write_reports import ReportRequest


@click.command("gate")
@click.argument("specs", nargs=-1, required=True, metavar="SPEC...")
@click.option(
    "--base",
    required=True,
    metavar="REVISION",
    help="The revision of git to compare with, such as refs/remotes/origin/main.",
)
@shared_options.repeatable_option(
    "--allow",
    metavar="NAME",
    help="What may differ from the base, such as 'objective fast', as the error names it; 'input' "
    "for recordings and preprocessors; 'base' for a base that cannot run",
)
@shared_options.output_option
@shared_options.pairs_option
@shared_options.sets_option
@shared_options.variables_option
@shared_options.queue_options
@shared_options.result_options()
def command(
    specs: tuple[str, ...],
    base: str,
    allow: tuple[str, ...],
    sets: tuple[str, ...],
    variables: tuple[str, ...],
    reports: tuple[ReportRequest, ...],
    **others: Any,
) -> int:
    """Gate a change: is SPEC still met, and did its graph become slower than in the base?

    SPEC is a spec, or a folder of specs, in the work tree of the working folder. The head is that
    work tree as it is; the base is the same spec with the code of a revision. Both are started
    anew in turn, in pairs. If HEAD lacks commits of the base, it is compared with where it left.

    What the verdict depends on must be as in the base, or stricter, and every spec of the base must
    be there; the pipeline can allow what differs by name. A spec that nothing can fail is refused.
    'r2bspec docs gate' has the details.
    """
    from r2bspec import api
    from r2bspec.cli import run_single
    from r2bspec.compare.base_environment import check_tools

    options = RunArguments(reports=reports, **others)

    values = SelectionValues(sets=sets, variables=shared_options.parse_pairs("--var", variables))
    place = Path(specs[0])
    with contextlib.ExitStack() as stack:
        with run_single.reported_failures(_of_all(options), run_single.OutputFolder(), place):
            gate = stack.enter_context(api.open_gate(base, allow))
            check_tools(gate.tree)
            if not options.quiet:
                echo(f"base: {gate.tree.name}", err=True)
            selected = gate.select(specs)
        entries = _entries(selected, values)
        if len(specs) == 1 and len(entries) == 1 and place.is_file():
            return _gate_one(gate, entries[0], selected, options)
        return _gate_all(gate, entries, selected, options)


@dataclass(frozen=True)
class _Entry:
    """A case of a spec that is gated."""

    spec: GatedSpec
    entry: SuiteEntry


def _entries(selected: GatedSpecs, values: SelectionValues) -> list[_Entry]:
    from r2bspec.cli.spec_selection import suite_entries
    from r2bspec.language.selected_spec import SpecSelection

    selection = SpecSelection(Path(), **values)
    return [
        _Entry(spec, entry)
        for spec in selected.specs
        for entry in suite_entries(selection, [str(spec.head)])
    ]


def _of_all(options: RunArguments) -> RunArguments:
    """Return the options without the reports of single runs."""
    from r2bspec.cli.run_suite import NAME_FIELD

    reports = (request for request in options.reports if NAME_FIELD not in request.path)
    return replace(options, reports=tuple(reports))


def _gate_one(gate: MergeGate, one: _Entry, selected: GatedSpecs, options: RunArguments) -> int:
    """Gate a spec of one case; return the exit status of its verdict."""
    from r2bspec import api
    from r2bspec.cli import run_single
    from r2bspec.cli.spec_selection import prepare_and_report
    from r2bspec.cli.text_output import queued_host
    from r2bspec.report.progress import RemainingTime

    entry, folder = one.entry, run_single.OutputFolder()
    with run_single.reported_failures(options, folder, one.spec.head):
        with options.sparing_inputs():
            prepared = prepare_and_report(entry.selection, infos=options.verbose)
        compared = _compared(gate, one, prepared)
        compared = replace(compared, sentences=(*selected.notes, *compared.sentences))
        _check_names(gate)
        name = f"{prepared.plan.name}-pairs"
        path = folder.path = options.output or api.default_run_folder(name)
        estimate = _estimate(prepared, compared, options)
        with queued_host(name, estimate.seconds, options.wait_s, quiet=options.quiet):
            sides = _sides(gate, compared, options)
            if not options.quiet:
                echo(f"{name}: {estimate.text()}", err=True)
            remaining = RemainingTime(estimate)
            result = _play(gate, compared, sides, options, path, one.spec.head, remaining)
        run_single.show(result, prepared, options, path, one.spec.head)
        return result.verdict.exit_code


def _gate_all(
    gate: MergeGate, entries: Sequence[_Entry], selected: GatedSpecs, options: RunArguments
) -> int:
    """Gate several specs: all are compared, then all are played; return the worst exit status."""
    from r2bspec.cli import run_single
    from r2bspec.cli.run_suite import LocalExecutor, Suite, announcement, prepare_entry
    from r2bspec.cli.text_output import queued_host
    from r2bspec.report.suite import SUITE_FORMATS

    if not entries:
        # There is no run that could have a report.
        of_all = tuple(each for each in options.reports if each.format in SUITE_FORMATS)
        options = replace(options, reports=of_all)
    suite = Suite.of(options)
    suite.gate = selected.notes
    runs = [one.entry for one in entries]
    ready: dict[int, tuple[ComparedSpec, GateSides]] = {}

    def refused() -> bool:
        return any(entry.error is not None for entry in runs)

    with options.sparing_inputs():
        for entry in runs:
            prepare_entry(entry, options)
    compared = {}
    for one in entries:
        with _error_of(one.entry):
            compared[id(one.entry)] = _compared(gate, one, one.entry.benchmark)
    with run_single.reported_failures(_of_all(options), run_single.OutputFolder(), Path()):
        if not refused():
            _check_names(gate)
    with contextlib.ExitStack() as stack:
        if runs and not refused():
            for entry in runs:
                entry.estimate = _estimate(entry.benchmark, compared[id(entry)], options)
            seconds, name = sum(entry.seconds for entry in runs), f"{len(runs)} benchmarks"
            host = queued_host(name, seconds, options.wait_s, quiet=options.quiet)
            stack.enter_context(host)
            for entry in runs:
                with _error_of(entry):
                    sides = _sides(gate, compared[id(entry)], options)
                    ready[id(entry)] = compared[id(entry)], sides
        suite.create_folder()
        suite.enter(runs)
        if refused():
            return suite.refuse()

        def play(entry: SuiteEntry, own: RunArguments, remaining: RemainingTime) -> Result:
            return _play(
                gate, *ready[id(entry)], own, entry.folder, entry.selection.spec, remaining
            )

        return suite.run(announcement(runs), LocalExecutor(suite, options, play).play(runs))


@contextlib.contextmanager
def _error_of(entry: SuiteEntry) -> Iterator[None]:
    """Print what the gate refuses, and keep it as the error of a run."""
    from r2bspec.cli.main import show_error
    from r2bspec.execute.errors import InterruptedRunError

    if entry.error is not None:
        return
    try:
        yield
    except InterruptedRunError:
        raise
    except R2bspecError as error:
        show_error(error)
        entry.error = error


def _compared(gate: MergeGate, one: _Entry, prepared: PreparedBenchmark) -> ComparedSpec:
    """Compare a spec with that of the base, and print what differs; nothing is played.

    Raises:
        R2bspecError: the gate refuses the spec, or its base.
    """
    from r2bspec.compare.gate_rules import require_objectives

    with _findings_shown(prepared):
        require_objectives(prepared.plan.objectives, str(one.spec.head))
        return gate.compare(one.spec, one.entry.selection, prepared)


def _sides(gate: MergeGate, compared: ComparedSpec, options: RunArguments) -> GateSides:
    """Build the base, and compare what both sides are given; the caller has the lock of the host.

    Raises:
        R2bspecError: the gate refuses the input, or its base.
    """
    from r2bspec.report.progress import shown_progress

    with _findings_shown(compared.head), shown_progress(quiet=options.quiet) as progress:
        return gate.sides(compared, progress)


@contextlib.contextmanager
def _findings_shown(prepared: PreparedBenchmark) -> Iterator[None]:
    """Print what the gate refuses at its lines."""
    from r2bspec.cli.text_output import show_findings
    from r2bspec.compare.gate_rules import MissingObjectivesError, WeakerGateError

    try:
        yield
    except WeakerGateError as error:
        show_findings(error.diagnostics, prepared.loaded)
        error.remainder = str(error)
        raise
    except MissingObjectivesError as error:
        show_findings([error.diagnostic], prepared.loaded)
        error.remainder = ""
        raise


def _check_names(gate: MergeGate) -> None:
    """Check that each name of ``--allow`` is known to one of the specs.

    Raises:
        UsageError: one is known to none.
    """
    from r2bspec.compare.gate_rules import check_allowed

    if gate.names:
        check_allowed(gate.allow, gate.names)


def _estimate(
    prepared: PreparedBenchmark, compared: ComparedSpec, options: RunArguments
) -> TimeEstimate:
    from r2bspec.compare.comparison_time import estimate_comparison
    from r2bspec.plan.time_estimate import estimate_time

    if compared.base is None:
        return estimate_time(prepared.plan)
    return estimate_comparison(prepared.plan, options.pairs)


def _play(
    gate: MergeGate,
    compared: ComparedSpec,
    sides: GateSides,
    options: RunArguments,
    folder: Path,
    spec: Path,
    remaining: RemainingTime,
) -> Result:
    from r2bspec import api
    from r2bspec.cli import run_single
    from r2bspec.compare.base_environment import check_tools
    from r2bspec.execute.states import Progress

    def play(progress: Progress) -> Result:
        result = api.run_gated(gate, compared, sides, folder, progress, pairs=options.pairs)
        # Most of r2bspec is imported where it is needed first.
        check_tools(gate.tree)
        return result

    return run_single.execute(options, folder, spec, remaining, play)
