"""``r2bspec doctor``: check this machine, and remove leftovers of dead runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.shared_options import FOLDER, format_option
from r2bspec.cli.text_output import styled
from r2bspec.diagnostics.plain_text import plain
from r2bspec.diagnostics.quote import pluralize
from r2bspec.errors import ExitStatus
from r2bspec.report.output import echo, echo_json

if TYPE_CHECKING:
    from r2bspec.doctor.checkup import CheckResult, Status

_MARKS: dict[Status, tuple[str, str]] = {
    "ok": ("✔", "green"),
    "warn": ("!", "yellow"),
    "problem": ("✘", "red"),
}


@click.command(
    "doctor",
    epilog=f"Exit status {ExitStatus.FINDINGS_OR_FAILED} if there is a problem; "
    f"{ExitStatus.OK} if there are only warnings.",
)
@click.option(
    "--clean",
    is_flag=True,
    help="First remove leftovers of dead runs: processes, shared memory, scratch folders.",
)
@click.option(
    "--runs",
    type=FOLDER,
    default=Path("runs"),
    show_default=True,
    help="The folder of run folders, or one run folder, searched for leftovers.",
)
@format_option()
def command(clean: bool, runs: Path, output_format: str) -> int:
    """Check this machine's fitness for benchmarking, with advice for each problem.

    --clean removes your shared memory of dead ROS programs, whichever program created it; memory in
    use by a living process is never touched.
    """
    from r2bspec.doctor.checks import examine
    from r2bspec.doctor.checkup import System, worst_status
    from r2bspec.doctor.leftovers import clean as remove_leftovers

    system = System(runs=runs)
    removed = remove_leftovers(system) if clean else []
    checks = list(examine(system))
    status = worst_status(checks)
    if output_format == "json":
        answer = {"r2bspec_doctor": 1, "status": status, "removed": removed, "checks": checks}
        echo_json(answer)
    else:
        for line in removed:
            echo(f"removed {line}")
        if clean:
            echo("" if removed else "nothing to remove\n", lines=True)
        _show(checks, status)
    return ExitStatus.FINDINGS_OR_FAILED if status == "problem" else ExitStatus.OK


def _show(checks: list[CheckResult], status: Status) -> None:
    """Print a block for each topic, a line for each check, and advice below it."""
    width = max(len(check.name) for check in checks)
    topic = ""
    for check in checks:
        if check.topic != topic:
            heading = styled(check.topic, bold=True)
            echo(f"\n{heading}" if topic else heading, lines=True, styled=True)
            topic = check.topic
        mark, colour = _MARKS[check.status]
        echo(
            f"  {styled(mark, fg=colour)} {check.name:<{width}}  {plain(check.found)}",
            styled=True,
        )
        if check.advice:
            echo(f"    {'':<{width}}  {styled(f'→ {plain(check.advice)}', dim=True)}", styled=True)
    echo()
    counts = {mark: sum(check.status == mark for check in checks) for mark in _MARKS}
    words = {
        "ok": "This machine is fit for benchmarking.",
        "warn": f"{pluralize(counts['warn'], 'warning')}: benchmarks run, but results may be "
        "affected.",
        "problem": f"{pluralize(counts['problem'], 'problem')} and "
        f"{pluralize(counts['warn'], 'warning')}.",
    }
    mark, colour = _MARKS[status]
    echo(f"{styled(mark, fg=colour, bold=True)} {words[status]}", styled=True)
