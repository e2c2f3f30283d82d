"""``r2bspec explain``: what a diagnostic code means, with a failing and a passing example."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator, Mapping

import click

from r2bspec.cli.completions import complete_code
from r2bspec.diagnostics.code_pages import FAMILIES, Page, all_pages
from r2bspec.diagnostics.quote import printable
from r2bspec.errors import UsageError
from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo

_FILE = "example.r2b.yaml"
_WIDTH = 88


@click.command("explain")
@click.argument("code", required=False, shell_complete=complete_code)
def command(code: str | None) -> int:
    """Explain the diagnostic CODE, such as R2B101 or unknown-key; without CODE, list all.

    CODE may also be a metric, such as latency.p99; 'r2bspec metrics' lists them.
    """
    from r2bspec.cli.metrics import explain_metric

    if code is not None and (metric := explain_metric(code)):
        echo("\n".join(metric))
        return ExitStatus.OK
    pages = all_pages()
    lines = _list(pages) if code is None else _explain(_find(code, pages))
    echo("\n".join(lines), styled=True)
    return ExitStatus.OK


def _find(code: str, pages: Mapping[str, Page]) -> Page:
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

    close = _near(number, pages) if number[3:].isdigit() else did_you_mean(slug, by_slug)
    if not close and "." in code:
        from r2bspec.measure.metric_catalogue import names

        close = did_you_mean(code, names())
    raise UsageError(
        f"unknown code {code!r}",
        hint=f"did you mean {close}? " * bool(close)
        + "'r2bspec explain' lists all codes, 'r2bspec metrics' all metrics",
    )


def _near(number: str, pages: Mapping[str, Page]) -> str:
    """The code that may have been meant: with two neighbouring digits swapped, or one too many.

    A code with one other digit is another code, and any number has many of these.
    """
    swapped = [
        number[:place] + number[place + 1] + number[place] + number[place + 2 :]
        for place in range(3, len(number) - 1)
    ]
    longer = [number[:place] + number[place + 1 :] for place in range(3, len(number))]
    return next((each for each in (*swapped, *longer) if each in pages), "")


def _list(pages: Mapping[str, Page]) -> Iterator[str]:
    family = ""
    width = max(len(page.slug) for page in pages.values())
    for code, page in pages.items():
        if code[3] != family:
            if family:
                yield ""
            family = code[3]
            yield _heading(FAMILIES.get(family, ""))
        yield f"  {code}  {page.slug:<{width}}  {page.severity.value:<7}  {page.title}"


def _explain(page: Page) -> Iterator[str]:
    yield _heading(f"{page.code} {page.slug}: {page.title} ({page.severity.value})")
    yield ""
    yield from textwrap.wrap(page.why, _WIDTH)
    if page.failing:
        yield ""
        yield _heading("Failing example")
        yield from _indent(page.failing)
        findings = _findings(page)
        if findings:
            yield ""
            yield from _indent(findings)
    if page.passing:
        yield ""
        yield _heading("Passing example")
        yield from _indent(page.passing)


def _findings(page: Page) -> str:
    """The findings in the failing example, as validate prints them; some need more than a spec."""
    from r2bspec.check.engine import check
    from r2bspec.language.load_spec import load_spec
    from r2bspec.report.findings_text import render_text

    loaded = load_spec(page.failing, file=_FILE)
    found = [each for each in check(loaded) if each.code == page.code]
    return render_text(found, loaded.texts)


def _indent(block: str) -> Iterator[str]:
    for line in block.rstrip("\n").split("\n"):
        yield f"    {printable(line)}".rstrip()


def _heading(text: str) -> str:
    from r2bspec.report.findings_text import wants_colour

    return click.style(text, bold=True) if wants_colour(sys.stdout) else text
