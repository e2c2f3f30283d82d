"""``r2bspec plan``: what a run will do, as canonical JSON, as a drawing, or as a difference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from r2bspec.cli.shared_options import (
    allow_path_option,
    case_option,
    parse_variables,
    sets_option,
    variables_option,
)
from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo, echo_document

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec
    from r2bspec.plan.plan import Plan

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
    help="Show instead how SPEC differs from OTHER, a spec or a plan; exit status "
    f"{ExitStatus.FINDINGS_OR_FAILED} if it does.",
)
@click.option(
    "--explain",
    "explain_path",
    metavar="PATH",
    help="Show instead where a value came from, such as benchmark.rates[0]: every file, line and "
    "option on its way.",
)
@sets_option
@variables_option
@case_option
@allow_path_option
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
    explain_path: str | None,
    sets: tuple[str, ...],
    variables: tuple[str, ...],
    case: str,
    allow_paths: tuple[Path, ...],
    output: Path | None,
) -> int:
    """Compile SPEC and print its plan.

    SPEC is a spec, or a plan that this command wrote. The same spec and the same data give the
    same bytes on every machine. Nothing is started.
    """
    if sum(each is not None for each in (graph, other, explain_path)) > 1:
        raise click.UsageError("--graph, --diff and --explain exclude each other")
    if explain_path is not None:
        from r2bspec.language.load_spec import load_spec

        values = parse_variables(variables)
        loaded = load_spec(spec, sets=sets, variables=values, case=case, allow_paths=allow_paths)
        _write(_provenance(loaded, explain_path).encode(), output)
        return ExitStatus.OK
    values = parse_variables(variables)
    plan = _plan(spec, sets=sets, variables=values, case=case, allow_paths=allow_paths)
    if other is not None:
        from r2bspec.plan.plan_diff import diff_plans

        differences = diff_plans(_plan(other, allow_paths=allow_paths), plan)
        _write("".join(f"{each}\n" for each in differences).encode(), output)
        return ExitStatus.FINDINGS_OR_FAILED if differences else ExitStatus.OK
    _write(_render(plan, graph), output, is_json=graph is None)
    return ExitStatus.OK


def _provenance(loaded: LoadedSpec, path: str) -> str:
    """Where a value came from.

    Raises:
        UsageError: the path leads to nothing, or the file is no document.
    """
    from r2bspec.errors import UsageError
    from r2bspec.language.value_trace import UnknownPathError, provenance
    from r2bspec.report.findings.print_findings import show

    if loaded.spec is None:
        show(loaded.diagnostics, loaded.texts)
    try:
        return provenance(loaded, path).text()
    except UnknownPathError as error:
        raise UsageError(str(error), hint=error.hint) from None


def _plan(path: Path, **options: Any) -> Plan:
    """The plan of a spec, or the one in a file; findings go to standard error."""
    from r2bspec import api
    from r2bspec.report.findings.print_findings import show

    try:
        prepared = api.prepare(path, **options)
    except api.InvalidSpecError as error:
        show(error.diagnostics, error.loaded.texts)
        raise
    if prepared.loaded is not None:
        show(prepared.diagnostics, prepared.loaded.texts)
    return prepared.plan


def _render(plan: Plan, graph: str | None) -> bytes:
    if graph == "mermaid":
        from r2bspec.plan.mermaid import to_mermaid

        return to_mermaid(plan).encode()
    if graph == "dot":
        from r2bspec.plan.dot import to_dot

        return to_dot(plan).encode()
    from r2bspec.plan.canonical_json import canonical_json

    return canonical_json(plan)


def _write(content: bytes, output: Path | None, *, is_json: bool = False) -> None:
    if output is None:
        if is_json:
            echo_document(content, nl=False)
        else:
            echo(content.decode(), nl=False)
        return
    from r2bspec.record.atomic_files import write_atomically

    write_atomically(output, content)
