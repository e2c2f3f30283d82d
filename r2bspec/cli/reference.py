"""The verbs that print what r2bspec defines: ``explain``, ``metrics``, ``schema`` and ``docs``."""

from __future__ import annotations

import importlib
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path

import click

from r2bspec.cli.completion import complete_code, complete_metric
from r2bspec.cli.shared_options import format_option
from r2bspec.cli.text_output import styled
from r2bspec.diagnostics.code_pages import FAMILIES, Page, all_pages
from r2bspec.diagnostics.quote import printable
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.report.output import echo, echo_document, echo_json

_FILE = "example.r2b.yaml"
_WIDTH = 88


@click.command("explain")
@click.argument("code", required=False, shell_complete=complete_code)
def explain_command(code: str | None) -> int:
    """Explain the diagnostic CODE, such as R2B101 or unknown-key; without CODE, list all.

    CODE may also be a metric, such as latency.p99; 'r2bspec metrics' lists them.
    """
    if code is not None and (metric := explain_metric(code)):
        echo("\n".join(metric), lines=True)
        return ExitStatus.OK
    pages = all_pages()
    lines = _list_codes(pages) if code is None else _explain_code(_find_code(code, pages))
    echo("\n".join(lines), lines=True, styled=True)
    return ExitStatus.OK


def _find_code(code: str, pages: Mapping[str, Page]) -> Page:
    """The page of a code or a slug; ``r2b101``, ``101`` and ``Unknown_Key`` are accepted, too.

    Raises:
        UsageError: there is none.
    """
    number = f"R2B{code.upper().removeprefix('R2B')}"
    if number in pages:
        return pages[number]
    slug = code.lower().replace("_", "-")
    by_slug = {page.slug: page for page in pages.values()}
    if slug in by_slug:
        return by_slug[slug]
    from r2bspec.diagnostics import did_you_mean

    close = _near_code(number, pages) if number[3:].isdigit() else did_you_mean(slug, by_slug)
    if not close and "." in code:
        from r2bspec.judge.measure.metric_catalogue import names

        close = did_you_mean(code, names())
    raise UsageError(
        f"unknown code {code!r}",
        hint=f"did you mean {close}? " * bool(close)
        + "'r2bspec explain' lists all codes, 'r2bspec metrics' all metrics",
    )


def _near_code(number: str, pages: Mapping[str, Page]) -> str:
    """The code that may have been meant: with two neighbouring digits swapped, or one too many.

    A code with one other digit is another code, and any number has many of these.
    """
    swapped = [
        number[:place] + number[place + 1] + number[place] + number[place + 2 :]
        for place in range(3, len(number) - 1)
    ]
    longer = [number[:place] + number[place + 1 :] for place in range(3, len(number))]
    return next((candidate for candidate in (*swapped, *longer) if candidate in pages), "")


def _list_codes(pages: Mapping[str, Page]) -> Iterator[str]:
    family = ""
    width = max(len(page.slug) for page in pages.values())
    for code, page in pages.items():
        if code[3] != family:
            if family:
                yield ""
            family = code[3]
            yield styled(FAMILIES.get(family, ""), bold=True)
        yield f"  {code}  {page.slug:<{width}}  {page.severity.value:<7}  {page.title}"


def _explain_code(page: Page) -> Iterator[str]:
    yield styled(f"{page.code} {page.slug}: {page.title} ({page.severity.value})", bold=True)
    yield ""
    yield from textwrap.wrap(page.why, _WIDTH)
    if page.failing:
        yield ""
        yield styled("Failing example", bold=True)
        yield from _indent(page.failing)
        findings = _example_findings(page)
        if findings:
            yield ""
            yield from _indent(findings)
    if page.passing:
        yield ""
        yield styled("Passing example", bold=True)
        yield from _indent(page.passing)


def _example_findings(page: Page) -> str:
    """The findings in the failing example, as validate prints them; some need more than a spec."""
    from r2bspec.check.engine import check
    from r2bspec.language.load_spec import load_spec
    from r2bspec.report.findings_text import render_text

    loaded = load_spec(page.failing, file=_FILE)
    findings = [finding for finding in check(loaded) if finding.code == page.code]
    return render_text(findings, loaded.texts)


def _indent(block: str) -> Iterator[str]:
    for line in block.rstrip("\n").split("\n"):
        yield f"    {printable(line)}".rstrip()


@click.command("metrics")
@click.argument("names", nargs=-1, metavar="[METRIC]...", shell_complete=complete_metric)
@format_option("text", "json", "markdown")
def metrics_command(names: tuple[str, ...], output_format: str) -> int:
    """List the metrics that the requirements of a spec can name.

    With METRIC, such as latency.p99, only these, with their definition.
    """
    from r2bspec.judge.measure import metric_catalogue as reference
    from r2bspec.judge.measure.metric_catalogue import METRICS, MetricError

    try:
        infos = [reference.find_metric(name) for name in names] or list(METRICS.values())
    except MetricError as error:
        meant = f"did you mean {error.suggestion}? " if error.suggestion else ""
        raise UsageError(str(error), hint=f"{meant}'r2bspec metrics' lists all") from error
    if output_format == "json":
        echo_json([reference.as_builtins(info) for info in infos])
    elif output_format == "markdown":
        echo_document(reference.markdown_page(), nl=False)
    elif names:
        echo("\n\n".join("\n".join(_definition(name)) for name in names), lines=True)
    else:
        echo("\n".join(_overview()), lines=True)
    return ExitStatus.OK


def explain_metric(name: str) -> list[str]:
    """The lines about a metric; none if there is no metric of this name."""
    from r2bspec.judge.measure.metric_catalogue import MetricError

    try:
        return list(_definition(name))
    except MetricError:
        return []


def _overview() -> Iterator[str]:
    from r2bspec.judge.measure import metric_catalogue as reference
    from r2bspec.judge.measure.metric_catalogue import METRICS

    width = max(map(len, METRICS))
    for number, (_, infos) in enumerate(reference.groups()):
        if number:
            yield ""
        for info in infos:
            where = _shown_modes(reference.modes(info))
            yield f"{info.name:<{width}}  {info.unit:<6} {info.description}{where}".rstrip()
    yield ""
    yield "Other percentiles can be named, too: latency.p42, latency.p99_5 for 99.5 %."
    yield "'r2bspec metrics METRIC' shows the definition of one."


def _shown_modes(modes: tuple[str, ...]) -> str:
    """The modes in which a metric is known, where these are not all."""
    from r2bspec.judge.measure.metric_catalogue import MODES

    missing = [mode for mode in MODES if mode not in modes]
    return f" (not {' or '.join(missing)})" if missing else ""


def _definition(name: str) -> Iterator[str]:
    from r2bspec.judge.measure import metric_catalogue as reference

    info = reference.find_metric(name)
    meant = reference.definition(info)
    yield f"{info.name}: {info.description}"
    yield ""
    yield from textwrap.wrap(meant.text, _WIDTH)
    yield ""
    for title, value in (
        ("formula", meant.formula),
        ("unit", info.unit or "none"),
        ("measured for", reference.SCOPES[info.scope]),
        ("modes", ", ".join(reference.modes(info))),
        ("judged by", reference.JUDGED[info.statistic][0]),
        ("requirement", reference.example_requirement(info)),
    ):
        indent = " " * 14
        yield textwrap.fill(f"{title:<14}{value}", _WIDTH, subsequent_indent=indent)


_SCHEMAS = {
    "spec": "r2bspec.language.json_schema:published_schema_text",
    "plan": "r2bspec.plan.canonical_json:plan_schema_text",
    "result": "r2bspec.report.result_json:result_schema_text",
}
"""Each schema and the function that generates it; printing one imports no other."""


@click.command("schema")
@click.argument("name", type=click.Choice(list(_SCHEMAS)), default="spec")
def schema_command(name: str) -> int:
    """Print the JSON Schema of a spec, a plan or a result."""
    module, function = _SCHEMAS[name].split(":")
    echo_document(getattr(importlib.import_module(module), function)(), nl=False)
    return ExitStatus.OK


_PACKAGE = Path(__file__).resolve().parents[1]


@click.command("docs")
@click.argument("page", required=False)
@click.option("--path", "show_path", is_flag=True, help="Print the path instead of the text.")
def docs_command(page: str | None, show_path: bool) -> int:
    """List the pages of the documentation, or print PAGE, such as running or proofs/verdicts.

    Pages are Markdown.
    """
    folder = docs_folder()
    files = (*sorted(folder.glob("*.md")), *sorted(folder.glob("*/*.md")))
    pages = {file.relative_to(folder).with_suffix("").as_posix(): file for file in files}
    if page is None:
        if show_path:
            echo(str(folder))
            return ExitStatus.OK
        width = max(map(len, pages), default=0)
        for name, file in pages.items():
            echo(f"{name:<{width}}  {_page_title(file)}")
        return ExitStatus.OK
    name = page.removesuffix(".md")
    if name not in pages:
        from r2bspec.diagnostics import did_you_mean

        close = did_you_mean(name, pages)
        hint = f"did you mean {close!r}? " if close else ""
        raise UsageError(f"there is no page {page!r}", hint=f"{hint}'r2bspec docs' lists the pages")
    if show_path:
        echo(str(pages[name]))
    else:
        echo(pages[name].read_text(encoding="utf-8"), nl=False)
    return ExitStatus.OK


def docs_folder() -> Path:
    """Where the pages are: in the installed package, the repository, or what colcon has installed.

    Raises:
        UsageError: this installation has none.
    """
    installed = (folder / "share/r2bspec/docs" for folder in _PACKAGE.parents)
    for folder in (_PACKAGE / "docs", _PACKAGE.parent / "docs", *installed):
        if (folder / "language.md").is_file():
            return folder
    raise UsageError(
        "this installation of r2bspec has no documentation",
        hint="Install r2bspec anew; 'r2bspec explain' and --help work without.",
    )


def _page_title(file: Path) -> str:
    """The first heading of a page."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return next((line.lstrip("# ") for line in lines if line.startswith("# ")), "")
