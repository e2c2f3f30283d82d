"""``r2bspec tune``: the deployment that meets the objectives at the least cost."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from r2bspec.cli import shared_options as options
from r2bspec.cli.spec_selection import prepare_and_report
from r2bspec.cli.text_output import locked_host
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.language.quantities import Duration
from r2bspec.language.selected_spec import SelectionValues, SpecSelection
from r2bspec.report.output import echo

if TYPE_CHECKING:
    from r2bspec.plan.tuning_space import Deployment
    from r2bspec.tune.tuning_result import TuningOutcome

EXIT_STATUS: Final[dict[TuningOutcome, ExitStatus]] = {
    "improved": ExitStatus.OK,
    "met today": ExitStatus.OK,
    "meets": ExitStatus.OK,
    "not met": ExitStatus.FINDINGS_OR_FAILED,
    "not shown": ExitStatus.INCONCLUSIVE,
    "incomplete": ExitStatus.INCONCLUSIVE,
}


@click.command("tune")
@options.spec_argument
@options.spec_options
@click.option(
    "--output",
    "-o",
    type=options.FOLDER,
    help="The folder of the search, new or empty.  [default: runs/NAME-tune-TIME]",
)
@click.option("--resume", is_flag=True, help="Go on with the search in the folder of --output.")
@click.option(
    "--trials",
    type=click.IntRange(min=1, max=10_000),
    help="The most deployments that are tried.  [default: tune.trials, or 30]",
)
@click.option(
    "--budget",
    type=options.duration("10 s", "168 h"),
    help="The time for search and proof.  [default: tune.budget, or 20 min]",
)
@click.option(
    "--pairs",
    type=click.IntRange(min=3, max=1000),
    help="The most pairs of runs of the proof.  [default: tune.pairs, or 8]",
)
@click.option(
    "--minimize",
    metavar="METRIC",
    help="The metric to make least.  [default: tune.minimize, or cpu.graph.mean]",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of the proposals.")
@click.option("--write", is_flag=True, help="Apply the patch to SPEC if a deployment is proved.")
@options.fleet_options("on all hosts that fit, which are of one class")
@options.flag_options({"--no-wait": "Refuse to run while this host runs a benchmark."})
@options.format_option()
@options.quiet_option
def command(
    spec: Path,
    values: SelectionValues,
    output: Path | None,
    resume: bool,
    trials: int | None,
    budget: Duration | None,
    pairs: int | None,
    minimize: str | None,
    seed: int,
    write: bool,
    on: str | None,
    hosts: str,
    connection: Mapping[str, Any],
    no_wait: bool,
    output_format: str,
    quiet: bool,
) -> int:
    """Search for the deployment of SPEC that meets its objectives at the least cost, and prove it.

    Processes, containers, executors, threads, transport and what 'tune:' in SPEC names are varied;
    'r2bspec plan SPEC --tune' shows all of it. Each trial is a start of all processes. The best of
    them race in further starts; the winner is compared with today's deployment in interleaved pairs
    of new runs, and so is each of its levers. The claim is what these pairs show.

    The folder of the search gets tuning.json, a page, a patch of SPEC, a launch file and every run.
    Exit status: 0 a deployment meets the objectives, 1 none does, 3 the pairs show nothing.
    """
    if resume and output is None:
        raise click.UsageError("--resume needs the --output of the earlier call")
    if on is None and (hosts != "all" or any(connection.values())):
        raise click.UsageError("--hosts and the options of a connection need --on")
    selection = SpecSelection(spec, **values)
    prepared = prepare_and_report(selection)
    from r2bspec import api
    from r2bspec.execute.progress import Progress
    from r2bspec.fleet.security import fleet_address
    from r2bspec.fleet.uniform_hosts import uniform_hosts
    from r2bspec.report.progress import shown_progress
    from r2bspec.report.terminal import standard_output
    from r2bspec.tune.machine import goal_of
    from r2bspec.tune.run_search import PATCH_FILE, require_extra, tune
    from r2bspec.tune.search import SearchSettings
    from r2bspec.tune.trials import Player, ThisHost
    from r2bspec.tune.tuning_report import print_tuning
    from r2bspec.tune.tuning_result import to_json

    require_extra()
    declared = prepared.loaded.spec.tune if prepared.loaded and prepared.loaded.spec else None
    if declared is None:
        raise click.UsageError(f"{spec} is a plan, whose deployment is fixed: give the spec")
    settings = SearchSettings(
        trials=trials or declared.trials,
        budget_s=(budget or declared.budget).seconds,
        pairs=pairs or declared.pairs,
        seed=seed,
    )
    goal_of(prepared.plan, minimize or declared.minimize)  # before the wait for the host
    folder = output or api.default_run_folder(f"{prepared.plan.name}-tune")
    with contextlib.ExitStack() as opened:
        player: Player = ThisHost(Progress())
        if on is not None:
            address = fleet_address(on, **connection)
            fitting = uniform_hosts(address, prepared.plan, hosts.split(","))
            player = opened.enter_context(fitting)
        else:
            opened.enter_context(
                locked_host(f"{prepared.plan.name} tune", "refuse" if no_wait else "wait")
            )
        opened.enter_context(_resumable(folder))
        progress = opened.enter_context(shown_progress(quiet=quiet))
        result = tune(
            selection,
            prepared,
            folder,
            settings,
            minimize=minimize or declared.minimize,
            player=player,
            tell=progress.note,
            resume=resume,
        )
    if output_format == "json":
        echo(to_json(result).decode(), nl=False)
    else:
        print_tuning(result, standard_output())
    echo(f"search: {folder}", err=True)
    if result.winner is not None and result.is_proved:
        _offer_patch(selection, result.winner, folder / PATCH_FILE, write=write)
    elif write:
        echo(f"{spec} was not changed: no deployment is proved", err=True)
    return EXIT_STATUS[result.outcome]


@contextlib.contextmanager
def _resumable(folder: Path) -> Iterator[None]:
    """Say how a search that is interrupted goes on.

    Raises:
        InterruptedRunError: it is.
    """
    from r2bspec.execute.errors import InterruptedRunError

    try:
        yield
    except (InterruptedRunError, KeyboardInterrupt) as error:
        raise InterruptedRunError(
            "the search was interrupted",
            hint=f"The same command with --output {folder} --resume goes on with its trials.",
        ) from error


def _offer_patch(selection: SpecSelection, winner: Deployment, file: Path, *, write: bool) -> None:
    """Keep the change of the spec that makes it the deployment found; print or apply it."""
    from r2bspec.cli.check_files import write_text
    from r2bspec.record.files import write_atomically
    from r2bspec.tune.patch import patch_spec

    try:
        patch = patch_spec(selection, winner.sets)
    except UsageError as error:
        # What was found stands; but what is asked for has to be done.
        file.unlink(missing_ok=True)
        if write:
            raise
        echo(f"no patch: {error}", err=True)
        echo(f"  help: {error.hint}", err=True)
        return
    write_atomically(file, patch.diff.encode())
    for note in patch.notes:
        echo(note, err=True)
    if write:
        write_text(str(patch.file), patch.after)
        echo(f"{patch.file} was changed", err=True)
    else:
        echo(patch.diff, nl=False, err=True)
        echo(f"--write makes this change, which {file} has", err=True)
