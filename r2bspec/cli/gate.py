"""``r2bspec gate``: compare specs and their code with a base of git, and judge them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from r2bspec.cli import shared_options
from r2bspec.cli.run import RunArguments, Runs
from r2bspec.cli.spec_selection import SpecSelection, SuiteEntry, suite_entries
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.compare.gated_specs import GatedSpec
    from r2bspec.compare.merge_gate import ComparedSpec, GateSides, MergeGate
    from r2bspec.execute.states import Progress
    from r2bspec.judge.result import Result
    from r2bspec.plan.time_estimate import TimeEstimate
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
    from r2bspec.cli.run_specs import reported_failures, run_specs
    from r2bspec.cli.suite import suite_reports
    from r2bspec.compare.base_environment import check_tools
    from r2bspec.report.suite import SUITE_FORMATS

    options = RunArguments(reports=reports, **others)
    values = SelectionValues(sets=sets, variables=shared_options.parse_pairs("--var", variables))
    place = Path(specs[0])
    with contextlib.ExitStack() as stack:
        of_all = replace(options, reports=suite_reports(reports))
        with reported_failures(of_all, None, place):
            gate = stack.enter_context(api.open_gate(base, allow))
            check_tools(gate.tree)
            if not options.quiet:
                echo(f"base: {gate.tree.name}", err=True)
            selected = gate.select(specs)
        entries = [
            GatedEntry(entry.selection, spec=spec)
            for spec in selected.specs
            for entry in suite_entries(SpecSelection(Path(), **values), [str(spec.head)])
        ]
        if not entries:
            # There is no run that could have a report.
            reports = tuple(
                request for request in of_all.reports if request.format in SUITE_FORMATS
            )
            options = replace(options, reports=reports)
        several = not (len(specs) == len(entries) == 1 and place.is_file())
        runs = GatedRuns(gate, selected.notes, options, several=several)
        return run_specs(entries, runs, several=several)


@dataclass
class GatedEntry(SuiteEntry):
    """A case of a spec that is gated.

    Attributes:
        spec: the spec, here and in the base.
        compared: with the base; None before.
        sides: what is played, the base built; None before.
    """

    spec: GatedSpec = field(kw_only=True)
    compared: ComparedSpec | None = None
    sides: GateSides | None = None


class GatedRuns(Runs[GatedEntry]):
    """Plays specs in pairs with the base of a merge gate; if it refuses one, it plays none."""

    needs_all = True

    def __init__(
        self, gate: MergeGate, notes: tuple[str, ...], options: RunArguments, *, several: bool
    ) -> None:
        super().__init__(options)
        self.gate = gate
        self.notes = notes
        self.several = several

    def name(self, entry: GatedEntry) -> str:
        """Return the name of a single comparison in the queue, and of its folder."""
        return f"{entry.name}-pairs"

    def check(self, entries: Sequence[GatedEntry]) -> None:
        """Compare all specs with those of the base, and print what differs."""
        from r2bspec.cli.run_specs import kept_error
        from r2bspec.compare.gate_rules import check_allowed, require_objectives

        for entry in entries:
            if entry.error is None:
                with kept_error(entry, several=self.several), _findings_shown(entry.benchmark):
                    require_objectives(entry.benchmark.plan.objectives, str(entry.spec.head))
                    compared = self.gate.compare(entry.spec, entry.selection, entry.benchmark)
                    notes = () if self.several else self.notes
                    sentences = (*notes, *compared.sentences)
                    entry.compared = replace(compared, sentences=sentences)
        if self.gate.names and all(entry.error is None for entry in entries):
            check_allowed(self.gate.allow, self.gate.names)

    def estimate(self, entry: GatedEntry) -> TimeEstimate:
        """Return how long the pairs take, or the head alone."""
        from r2bspec.compare.interleaved_comparison import estimate_comparison
        from r2bspec.plan.time_estimate import estimate_time

        assert entry.compared is not None  # noqa: S101 - `check` comes first
        if entry.compared.base is None:
            return estimate_time(entry.benchmark.plan)
        return estimate_comparison(entry.benchmark.plan, self.options.pairs)

    def build(self, entry: GatedEntry) -> None:
        """Build the base, and compare what both sides are given."""
        from r2bspec.report.progress import shown_progress

        assert entry.compared is not None  # noqa: S101 - `check` comes first
        with (
            _findings_shown(entry.benchmark),
            shown_progress(quiet=self.options.quiet) as progress,
        ):
            entry.sides = self.gate.sides(entry.compared, progress)

    def play(self, entry: GatedEntry, progress: Progress) -> Result:
        """Play the pairs of an entry."""
        from r2bspec import api
        from r2bspec.compare.base_environment import check_tools

        compared, sides = entry.compared, entry.sides
        assert compared is not None  # noqa: S101 - `check` comes first
        assert sides is not None  # noqa: S101 - `build` comes first
        pairs = self.options.pairs
        result = api.run_gated(self.gate, compared, sides, entry.folder, progress, pairs=pairs)
        # Most of r2bspec is imported where it is needed first.
        check_tools(self.gate.tree)
        return result


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
