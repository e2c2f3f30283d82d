"""``r2bspec plan``: what a run will do, as canonical JSON, as a drawing, or as a difference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.options import parse_variables, sets_option, variables_option

if TYPE_CHECKING:
    from r2bspec.plan.model import Plan

_SPEC = click.Path(path_type=Path, dir_okay=False)


@click.command("plan")
@click.argument("spec", type=_SPEC)
@click.option(
    "--graph",
    type=click.Choice(["mermaid", "dot"]),
    help="Draw the plan instead, for Markdown (mermaid) or Graphviz (dot).",
)
@click.option(
    "--diff",
    "other",
    type=_SPEC,
    metavar="OTHER",
    help="Show instead how SPEC differs from OTHER, a spec or a plan; exit status 1 if it does.",
)
@sets_option
@variables_option
@click.option(
    "--output",
    "-o",
    type=click.Path(path_type=Path, dir_okay=False, writable=True),
    help="Write to this file, whole or not at all, instead of standard output.",
)
def command(
    spec: Path,
    graph: str | None,
    other: Path | None,
    sets: tuple[str, ...],
    variables: tuple[str, ...],
    output: Path | None,
) -> int:
    """Compile SPEC and print its plan.

    SPEC is a spec, or a plan that this command wrote. The same spec and the same data give the
    same bytes on every machine. Nothing is started.
    """
    if graph is not None and other is not None:
        raise click.UsageError("--graph and --diff exclude each other")
    plan = _plan(spec, sets, variables)
    if other is not None:
        from r2bspec.plan.diff import diff_plans

        differences = diff_plans(_plan(other, (), ()), plan)
        _write("".join(f"{each}\n" for each in differences).encode(), output)
        return 1 if differences else 0
    _write(_shown(plan, graph), output)
    return 0


def _plan(path: Path, sets: tuple[str, ...], variables: tuple[str, ...]) -> Plan:
    """The plan of a spec, or the one in a file; findings go to standard error."""
    from r2bspec import api
    from r2bspec.report.findings.show import show

    try:
        prepared = api.prepare(path, sets=sets, variables=parse_variables(variables))
    except api.InvalidSpecError as error:
        show(error.diagnostics, error.loaded.texts)
        raise
    if prepared.loaded is not None:
        show(prepared.diagnostics, prepared.loaded.texts)
    return prepared.plan


def _shown(plan: Plan, graph: str | None) -> bytes:
    if graph == "mermaid":
        from r2bspec.plan.mermaid import to_mermaid

        return to_mermaid(plan).encode()
    if graph == "dot":
        from r2bspec.plan.dot import to_dot

        return to_dot(plan).encode()
    from r2bspec.plan.canonical import canonical_json

    return canonical_json(plan)


def _write(content: bytes, output: Path | None) -> None:
    if output is None:
        click.echo(content, nl=False)
        return
    from r2bspec.record.files import write_whole

    write_whole(output, content)
