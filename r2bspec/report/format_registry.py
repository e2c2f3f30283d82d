"""Every format of a report: its name, its module, and the libraries that it needs.

A format is a module with one function::

    def render(report_input: ReportInput) -> bytes

It is imported on demand, so that listing the formats costs nothing.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from r2bspec.compare.report_input import ReportInput
from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.plain_text import harmless, plain_values
from r2bspec.report.errors import ReportError, ReportUsageError

Renderer = Callable[[ReportInput], bytes]


@dataclass(frozen=True, slots=True)
class Format:
    """One format.

    Attributes:
        module: has `render`; imported on demand.
        what: a description in one line.
        needs: libraries of the extra ``report`` that the module imports.
        single: whether a file has one monitor at one rate; its path may then contain the
            placeholders ``{monitor}`` and ``{rate}``.
        is_text: whether people or logs read it. Formats for programs, such as JSON, keep every
            character of a text in their own way.
    """

    module: str
    what: str
    needs: tuple[str, ...] = ()
    single: bool = False
    is_text: bool = True


_FORMATS_PACKAGE = "r2bspec.report.formats"

FORMATS: Final[dict[str, Format]] = {
    "json": Format(f"{_FORMATS_PACKAGE}.json", "the content of result.json", is_text=False),
    "text": Format(f"{_FORMATS_PACKAGE}.text", "the terminal report, without colours"),
    "html": Format(
        "r2bspec.report.html", "one self-contained page with charts", ("jinja2", "matplotlib")
    ),
    "markdown": Format(f"{_FORMATS_PACKAGE}.markdown", "Markdown for a comment or a step summary"),
    "github": Format(f"{_FORMATS_PACKAGE}.github", "annotations on the spec's lines"),
    "junit": Format(f"{_FORMATS_PACKAGE}.junit", "JUnit XML, a test case for each requirement"),
    "junit_lenient": Format(
        f"{_FORMATS_PACKAGE}.junit_lenient", "the same, with inconclusive as skipped"
    ),
    "csv": Format(f"{_FORMATS_PACKAGE}.csv", "every metric of every iteration, one per line"),
    "samples": Format(f"{_FORMATS_PACKAGE}.samples_csv", "every single message as a line of CSV"),
    "openmetrics": Format(f"{_FORMATS_PACKAGE}.openmetrics", "OpenMetrics text for Prometheus"),
    "hdrhistogram": Format(
        f"{_FORMATS_PACKAGE}.hdrhistogram", "percentile distribution of the latency", single=True
    ),
    "ros2_benchmark": Format(
        f"{_FORMATS_PACKAGE}.ros2_benchmark",
        "the JSON format of NVIDIA's ros2_benchmark",
        is_text=False,
    ),
    "bencher": Format(f"{_FORMATS_PACKAGE}.bencher", "Bencher Metric Format", is_text=False),
    "benchmark_smaller": Format(
        f"{_FORMATS_PACKAGE}.benchmark_smaller",
        "github-action-benchmark, customSmallerIsBetter",
        is_text=False,
    ),
    "benchmark_bigger": Format(
        f"{_FORMATS_PACKAGE}.benchmark_bigger",
        "github-action-benchmark, customBiggerIsBetter",
        is_text=False,
    ),
    "trace": Format(
        f"{_FORMATS_PACKAGE}.trace", "a timeline for Perfetto or chrome://tracing", is_text=False
    ),
    "mcap": Format(
        f"{_FORMATS_PACKAGE}.mcap", "metrics over time for Foxglove", ("mcap",), is_text=False
    ),
}


def find_format(name: str) -> Format:
    """The format of that name.

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
    missing = [each for each in find_format(name).needs if importlib.util.find_spec(each) is None]
    if missing:
        raise ReportError(
            f"the report format {name!r} needs {' and '.join(missing)}",
            hint="Install them with: pip install 'r2bspec[report]'",
        )


def renderer(name: str) -> Renderer:
    """The function that renders a format.

    Raises:
        ReportUsageError: there is no such format.
        ReportError: a library that it needs is missing.
    """
    check_installed(name)
    known = find_format(name)
    found: Renderer = importlib.import_module(known.module).render
    return partial(_render_text, found, commands=name == "github") if known.is_text else found


def _render_text(render: Renderer, report_input: ReportInput, *, commands: bool) -> bytes:
    """A report without control characters, and without commands but its own."""
    result = plain_values(report_input.result)
    if result is not report_input.result:
        report_input = replace(report_input, result=result)
    shown = render(report_input).decode()
    return harmless(shown, commands=commands).encode()
