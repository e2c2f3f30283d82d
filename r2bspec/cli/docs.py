"""``r2bspec docs``: pages, codes, metrics and schemas."""

from __future__ import annotations

import importlib
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path

import click

from r2bspec.cli.completion import complete_topic
from r2bspec.cli.text_output import styled
from r2bspec.diagnostics.code_pages import FAMILIES, Page, all_pages
from r2bspec.diagnostics.quote import printable
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.report.output import echo, echo_document

_FILE = "example.r2b.yaml"
_WIDTH = 88


def _find_code(code: str, pages: Mapping[str, Page]) -> Page:
    """Return the page of a code or a slug.

    ``r2b101``, ``101`` and ``Unknown_Key`` are accepted, too.

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
    from r2bspec.judge.measure.metric_catalogue import names

    known = (*by_slug, *doc_pages(), *names())
    # A code with another digit is another code.
    close = "" if number[3:].isdigit() else did_you_mean(code, known)
    raise UsageError(
        f"there is no page, code or metric {code!r}",
        hint=f"did you mean {close}? " * bool(close)
        + "'r2bspec docs' lists the pages, 'r2bspec docs codes' all codes",
    )


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
    """Return the findings in the failing example, as validate prints them.

    Some need more than a spec.
    """
    from r2bspec.check.engine import check
    from r2bspec.language.load_spec import load_spec
    from r2bspec.report.findings_text import render_text

    loaded = load_spec(page.failing, file=_FILE)
    findings = [finding for finding in check(loaded) if finding.code == page.code]
    return render_text(findings, loaded.texts)


def _indent(block: str) -> Iterator[str]:
    for line in block.rstrip("\n").split("\n"):
        yield f"    {printable(line)}".rstrip()


def explain_metric(name: str) -> list[str]:
    """Return the lines about a metric; none if there is no metric of this name."""
    from r2bspec.judge.measure.metric_catalogue import MetricError

    try:
        return list(_definition(name))
    except MetricError:
        return []


def _definition(name: str) -> Iterator[str]:
    from r2bspec.judge.measure import metric_catalogue as reference

    info = reference.find_metric(name)
    metric = info.metric
    yield f"{info.name}: {info.description}"
    yield ""
    yield from textwrap.wrap(metric.text, _WIDTH)
    yield ""
    for title, value in (
        ("formula", metric.full_formula),
        ("unit", info.unit or "none"),
        ("measured for", info.scope.measured_for),
        ("modes", ", ".join(reference.modes(metric))),
        ("judged by", reference.JUDGED[info.statistic][0]),
        ("requirement", info.example),
    ):
        indent = " " * 14
        yield textwrap.fill(f"{title:<14}{value}", _WIDTH, subsequent_indent=indent)


_SCHEMAS = {
    "spec": "r2bspec.language.json_schema:published_schema_text",
    "plan": "r2bspec.plan.canonical_json:plan_schema_text",
    "result": "r2bspec.report.data_formats:result_schema_text",
}
"""Each schema and the function that generates it; printing one imports no other."""


_PACKAGE = Path(__file__).resolve().parents[1]


_CODES = "codes"
"""The topic that lists all diagnostic codes; no page has its name."""


@click.command("docs")
@click.argument("topic", required=False, shell_complete=complete_topic)
@click.option("--schema", type=click.Choice(list(_SCHEMAS)), help="Print a JSON Schema.")
@click.option("--path", "show_path", is_flag=True, help="Print the path instead of the text.")
def command(topic: str | None, schema: str | None, show_path: bool) -> int:
    """Show the documentation of TOPIC, or the sections with this word; without it, list the pages.

    TOPIC is a page, such as running or metrics, a diagnostic code, such as R2B101 or unknown-key,
    a metric, such as latency.p99, or 'codes' for the list of all codes.
    """
    if schema is not None:
        module, function = _SCHEMAS[schema].split(":")
        echo_document(getattr(importlib.import_module(module), function)(), nl=False)
    elif show_path:
        echo(str(docs_folder() if topic is None else _doc_page(topic)))
    elif topic is None:
        pages = doc_pages()
        width = max(map(len, pages), default=0)
        for name, file in pages.items():
            echo(f"{name:<{width}}  {_page_title(file)}")
    elif topic == _CODES:
        echo("\n".join(_list_codes(all_pages())), lines=True, styled=True)
    elif (page := doc_pages().get(topic.removesuffix(".md"))) is not None:
        echo(page.read_text(encoding="utf-8"), nl=False)
    elif metric := explain_metric(topic):
        echo("\n".join(metric), lines=True)
    else:
        try:
            lines = list(_explain_code(_find_code(topic, all_pages())))
        except UsageError:
            if not (lines := list(_sections_with(topic))):
                raise
        echo("\n".join(lines), lines=True, styled=True)
    return ExitStatus.OK


def _sections_with(word: str) -> Iterator[str]:
    """Yield page and heading of each section that has a word."""
    for name, file in doc_pages().items():
        heading, last = "", ""
        for line in file.read_text(encoding="utf-8").splitlines():
            heading = line.lstrip("# ") if line.startswith("#") else heading
            if word.lower() in line.lower() and heading != last:
                last = heading
                yield f"{name}: {heading}"


def doc_pages() -> dict[str, Path]:
    """Return the file of each page of the documentation, by its name."""
    folder = docs_folder()
    files = (*sorted(folder.glob("*.md")), *sorted(folder.glob("*/*.md")))
    return {file.relative_to(folder).with_suffix("").as_posix(): file for file in files}


def _doc_page(topic: str) -> Path:
    """Return the file of a page.

    Raises:
        UsageError: there is no such page.
    """
    pages = doc_pages()
    name = topic.removesuffix(".md")
    if name not in pages:
        from r2bspec.diagnostics import did_you_mean

        close = did_you_mean(name, pages)
        hint = f"did you mean {close!r}? " if close else ""
        raise UsageError(
            f"there is no page {topic!r}", hint=f"{hint}'r2bspec docs' lists the pages"
        )
    return pages[name]


def docs_folder() -> Path:
    """Return the folder of the pages: in the package, the repository, or as colcon installed it.

    Raises:
        UsageError: this installation has none.
    """
    installed = (folder / "share/r2bspec/docs" for folder in _PACKAGE.parents)
    for folder in (_PACKAGE / "docs", _PACKAGE.parent / "docs", *installed):
        if (folder / "language.md").is_file():
            return folder
    raise UsageError(
        "this installation of r2bspec has no documentation",
        hint="Install r2bspec anew.",
    )


def _page_title(file: Path) -> str:
    """Return the first heading of a page."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return next((line.lstrip("# ") for line in lines if line.startswith("# ")), "")
