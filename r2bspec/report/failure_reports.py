"""Reports of a run that ended before there was anything to report: why it did.

A pipeline shows the requested reports, and its readers see no log. So the formats that people read
in a pipeline (``markdown``, ``github``, ``junit``) have the error and its findings; others are not
written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.errors import R2bspecError
from r2bspec.report.findings import github, junit, text
from r2bspec.report.write_reports import ReportRequest, write_report


def write_failure_reports(
    requests: Iterable[ReportRequest], error: R2bspecError, spec: Path
) -> None:
    """Write the requested reports that can tell of an error.

    Args:
        requests: the reports.
        error: why there is no run; with `diagnostics` and the document `loaded`, if it has some.
        spec: the file of the benchmark.

    Raises:
        RecordError: a file cannot be written.
    """
    diagnostics = tuple(getattr(error, "diagnostics", ()))
    if not diagnostics:
        place = Span.of_file(str(spec))
        diagnostics = (Diagnostic(error.code, Severity.ERROR, str(error), place, help=error.hint),)
    loaded = getattr(error, "loaded", None)
    sources: Mapping[str, str] = loaded.texts if loaded is not None else {}
    for request in requests:
        render = _RENDERERS.get(request.format)
        if render is not None:
            write_report(request.path, render(error, diagnostics, sources).encode())


def _markdown(
    error: R2bspecError, diagnostics: Sequence[Diagnostic], sources: Mapping[str, str]
) -> str:
    # Indented, so that nothing in the text ends the block or is markup.
    shown = text.render(diagnostics, sources).replace("\n", "\n    ")
    return f"### ✘ error {error.code}: nothing was measured\n\n    {shown.rstrip()}\n"


def _github(
    _error: R2bspecError, diagnostics: Sequence[Diagnostic], sources: Mapping[str, str]
) -> str:
    return github.render(diagnostics, sources)


def _junit(
    _error: R2bspecError, diagnostics: Sequence[Diagnostic], sources: Mapping[str, str]
) -> str:
    return junit.render(diagnostics, sources)


_RENDERERS: Final[
    Mapping[str, Callable[[R2bspecError, Sequence[Diagnostic], Mapping[str, str]], str]]
] = {"markdown": _markdown, "github": _github, "junit": _junit}
