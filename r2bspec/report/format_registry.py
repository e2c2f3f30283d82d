"""Every format of every report: its name, the function that renders it, and what it needs.

A format of a run is a function::

    def render(report_input: ReportInput) -> bytes

Functions are named here, and imported on demand, so that listing the formats costs nothing, and so
that the HTML pages stand beside the other reports, which do not import them.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.plain_text import harmless, plain_values
from r2bspec.errors import ExitStatus, R2bspecError, UsageError
from r2bspec.extras import install_command


class ReportUsageError(UsageError):
    """An invalid request for a report: an unknown format, or two reports to one stream."""

    code = "R2B660"


class ReportError(R2bspecError):
    """A report cannot be written: a library is missing."""

    code = "R2B661"
    exit_code = ExitStatus.USAGE


Renderer = Callable[[ReportInput], bytes]


@dataclass(frozen=True, slots=True)
class Format:
    """A report format.

    Attributes:
        function: the function that renders it, as ``module:function`` in this package; imported on
            demand.
        what: a description in one line.
        needs: libraries of the extra ``report`` that the module imports.
    """

    function: str
    what: str
    needs: tuple[str, ...] = ()


FORMATS: Final[dict[str, Format]] = {
    "json": Format("data_formats:render_json", "the content of result.json"),
    "text": Format("terminal:render", "the terminal report, without colours"),
    "html": Format("html.page:render", "one self-contained page with charts", ("jinja2",)),
    "markdown": Format("markdown:render", "Markdown for a comment or a step summary"),
    "github": Format("pipelines:render_github", "annotations on the spec's lines"),
    "junit": Format("pipelines:render_junit", "JUnit XML, a test case for each requirement"),
    "csv": Format("data_formats:render_values", "every metric of every iteration, one per line"),
    "samples": Format("data_formats:render_samples", "every single message as a line of CSV"),
}
"""The formats of a run."""

GRAPH_PAGE: Final = "html.page:render_graph"
"""The drawing of a plan as a page."""


def load(function: str) -> Callable[..., Any]:
    """Import and return a function that this registry names."""
    module, _, name = function.partition(":")
    loaded: Callable[..., Any] = getattr(importlib.import_module(f"r2bspec.report.{module}"), name)
    return loaded


def find_format(name: str) -> Format:
    """Return the format of that name.

    Raises:
        ReportUsageError: there is none.
    """
    known = FORMATS.get(name)
    if known is None:
        close = did_you_mean(name, FORMATS)
        raise ReportUsageError(
            f"unknown report format {name!r}",
            hint=f"Did you mean {close!r}?" if close else f"Formats: {', '.join(FORMATS)}.",
        )
    return known


def check_installed(name: str) -> None:
    """Check that the libraries of a format are installed, without importing them.

    Raises:
        ReportUsageError: there is no such format.
        ReportError: a library is missing.
    """
    missing = [
        library for library in find_format(name).needs if importlib.util.find_spec(library) is None
    ]
    if missing:
        raise ReportError(
            f"the report format {name!r} needs {' and '.join(missing)}",
            hint=f"Install them with: {install_command('report')}",
        )


def renderer(name: str) -> Renderer:
    """Return the function that renders a format.

    Raises:
        ReportUsageError: there is no such format.
        ReportError: a library that it needs is missing.
    """
    check_installed(name)
    render: Renderer = load(find_format(name).function)
    # JSON keeps every character of a text in its own way.
    return render if name == "json" else partial(_render_text, render, commands=name == "github")


def _render_text(render: Renderer, report_input: ReportInput, *, commands: bool) -> bytes:
    """Return a report without control characters, and without commands but its own."""
    result = plain_values(report_input.result)
    if result is not report_input.result:
        report_input = replace(report_input, result=result)
    shown = render(report_input).decode()
    return harmless(shown, commands=commands).encode()
