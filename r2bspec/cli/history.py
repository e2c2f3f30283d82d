"""``r2bspec history``: list, accept and delete the runs of a history."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.diagnostics.quote import clip
from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo, echo_document

if TYPE_CHECKING:
    from r2bspec.compare.history import HistoryEntry

USER_HISTORY = "user"
"""The name of the user's own history."""

_MAX_CELL = 300

_file_option = click.option(
    "--history",
    "--file",
    "file",
    default=USER_HISTORY,
    show_default=True,
    metavar="FILE",
    help="The history file; 'user' is a file in your data folder.",
)


def history_file(text: str) -> Path:
    """The file of a history, as the user names it."""
    from r2bspec.compare.history import user_history

    return user_history() if text == USER_HISTORY else Path(text)


@click.group("history")
def command() -> None:
    """List and delete the runs stored by 'r2bspec run --history'."""


@command.command("list")
@_file_option
@click.option("--name", default="", help="Only runs of this benchmark.")
@click.option(
    "--format",
    "output_format",
    type=click.Choice(["text", "json"]),
    default="text",
    show_default=True,
    help="The output format.",
)
def list_runs(file: str, name: str, output_format: str) -> int:
    """List the runs, oldest first."""
    from r2bspec.compare.history import open_history

    with open_history(history_file(file)) as history:
        runs = history.runs(name=name)
    if output_format == "json":
        import msgspec

        echo_document(msgspec.json.format(msgspec.json.encode(runs), indent=2).decode())
        return ExitStatus.OK
    for line in _table(runs):
        echo(line)
    return ExitStatus.OK


def _table(runs: tuple[HistoryEntry, ...]) -> list[str]:
    if not runs:
        return ["no runs"]
    rows = [("run", "started", "benchmark", "plan", "machine", "outcome")]
    rows += [
        (
            clip(one.run_id, _MAX_CELL),
            clip(one.started_at, _MAX_CELL),
            clip(one.name, _MAX_CELL),
            one.plan.removeprefix("sha256:")[:12],
            clip(f"{one.host} ({one.machine})", _MAX_CELL),
            clip(f"{one.outcome}, accepted" if one.accepted else one.outcome, _MAX_CELL),
        )
        for one in runs
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


@command.command("accept")
@click.argument("run_id", metavar="RUN_ID")
@_file_option
def accept(run_id: str, file: str) -> int:
    """Let a failed run count as a baseline: the change is intended."""
    from r2bspec.compare.history import HistoryError, open_history

    with open_history(history_file(file)) as history:
        if not history.accept(run_id):
            raise HistoryError(
                f"the history has no run {run_id!r}", hint="'r2bspec history list' lists the runs."
            )
    echo(f"run {run_id} now counts as a baseline", err=True)
    return ExitStatus.OK


@command.command("prune")
@_file_option
@click.option("--keep", type=click.IntRange(min=0), help="Keep this number of the latest runs.")
@click.option(
    "--before", metavar="DATE", help="Delete runs started before this date, such as 2026-01-31."
)
@click.option(
    "--run", "run_ids", multiple=True, metavar="RUN_ID", help="Delete this run; may be repeated."
)
@click.option("--name", default="", help="Only runs of this benchmark.")
def prune(
    file: str, keep: int | None, before: str | None, run_ids: tuple[str, ...], name: str
) -> int:
    """Delete runs: all but the latest, older ones, or single ones.

    --keep counts the runs of each plan on each kind of machine separately.
    """
    if keep is None and before is None and not run_ids:
        raise click.UsageError("name the runs to delete: --keep N, --before DATE or --run RUN_ID")
    from r2bspec.compare.history import open_history

    since = parse_time(before) if before is not None else None
    with open_history(history_file(file)) as history:
        groups: dict[tuple[str, str, str], list[HistoryEntry]] = {}
        for one in history.runs(name=name):
            groups.setdefault((one.plan, one.host, one.dataset), []).append(one)
        removed_ids = set(run_ids)
        for runs in groups.values():
            kept = [one for one in runs if one.run_id not in removed_ids]
            if since is not None:
                removed_ids |= {one.run_id for one in kept if parse_time(one.started_at) < since}
            if keep is not None:
                removed_ids |= {one.run_id for one in kept[: max(len(kept) - keep, 0)]}
        number = history.remove(sorted(removed_ids))
    echo(f"{number} run{'' if number == 1 else 's'} deleted", err=True)
    return ExitStatus.OK


def parse_time(text: str) -> datetime.datetime:
    """A date or a time in ISO 8601; without a zone, in local time.

    Raises:
        click.UsageError: it is neither.
    """
    try:
        found = datetime.datetime.fromisoformat(text)
    except ValueError as error:
        raise click.UsageError(f"{text!r} is not a date; write it like 2026-01-31") from error
    return found.astimezone() if found.tzinfo is None else found
