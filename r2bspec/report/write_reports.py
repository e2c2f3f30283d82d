"""Writes the requested reports: ``FORMAT=PATH``, with ``-`` for standard output.

A file is written atomically; its folders are created.

Of a run that ended before there was anything to report, the reports say why. A pipeline shows the
requested reports, and its readers see no log. So the formats that people read in a pipeline
(``markdown``, ``html``, ``github``, ``junit``) have the error and its findings, and ``json`` the
error; others are not written.
"""

from __future__ import annotations

import fnmatch
import glob
import json
import os
import re
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from r2bspec.compare.report_input import ReportInput, read_folder
from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.diagnostics.plain_text import harmless
from r2bspec.errors import R2bspecError, split_output
from r2bspec.record.files import write_output
from r2bspec.record.run_folder import FOLDER_ENTRIES, RECORD_FILES
from r2bspec.report import finding_formats, format_registry
from r2bspec.report.document import Document, Fold, Section, Verbatim
from r2bspec.report.findings_text import render_text
from r2bspec.safe_io.safe_file import is_folder, is_there

STDOUT = "-"

_PLACEHOLDER: Final = re.compile(r"\{\w+\}")


@dataclass(frozen=True, slots=True)
class ReportRequest:
    """A requested report; `path` may be ``-``."""

    format: str
    path: str


def parse_report_requests(options: Iterable[str]) -> tuple[ReportRequest, ...]:
    """Parse ``FORMAT=PATH`` options, and check before the run that each can be written.

    Raises:
        ReportUsageError: one has no equals sign or no path, or names no format; or as
            `check_targets`.
        ReportError: a library that one of them needs is missing.
    """
    requests = tuple(_parse(option) for option in options)
    for parsed in requests:
        format_registry.check_installed(parsed.format)
    check_targets(requests)
    return requests


def check_targets(
    requests: Sequence[ReportRequest], read: Iterable[str] = (), output: Path | None = None
) -> None:
    """Check that no report replaces another report, or a file that r2bspec reads or has written.

    Args:
        requests: the reports; a placeholder in a path stands for any text.
        read: files from which the reports are made.
        output: the folder of the run that will be made.

    Raises:
        ReportUsageError: two write to standard output or to the same file; or one is a folder,
            one of the files that are read, or has the name of a file in a run folder.
    """
    if not requests:
        return
    inputs = {os.path.realpath(file) for file in read}
    targets: list[str] = []
    for request in requests:
        target = request.path if request.path == STDOUT else os.path.realpath(request.path)
        if target in targets:
            where = "standard output" if target == STDOUT else repr(request.path)
            raise format_registry.ReportUsageError(
                f"two reports cannot both go to {where}", hint="Name another file for one of them."
            )
        targets.append(target)
        if target == STDOUT:
            continue
        if is_folder(Path(target)):
            raise format_registry.ReportUsageError(
                f"{request.path} is a folder", hint="Give the name of a file, in it or elsewhere."
            )
        if _names_any(target, inputs) or _is_of_a_run(target, output):
            raise format_registry.ReportUsageError(
                f"the {request.format} report would replace {request.path}, which r2bspec needs",
                hint="Give the name of another file.",
            )


def _is_of_a_run(target: str, output: Path | None) -> bool:
    """Return whether a file has a name by which a run folder above it keeps what was measured."""
    below = None if output is None else Path(os.path.realpath(output))
    for folder in Path(target).parents:
        if folder == below or any(is_there(folder / name) for name in RECORD_FILES):
            first = Path(target).relative_to(folder).parts[0]
            if _names_any(first, FOLDER_ENTRIES):
                return True
    return False


def _names_any(path: str, names: Collection[str]) -> bool:
    """Return whether a path, with any text for its placeholders, is one of these names."""
    return bool(fnmatch.filter(names, _PLACEHOLDER.sub("*", glob.escape(path))))


def _parse(option: str) -> ReportRequest:
    name, equals, path = option.partition("=")
    if not equals or not path:
        raise format_registry.ReportUsageError(
            f"--report takes FORMAT=PATH, not {option!r}",
            hint="For example --report html=report.html, or --report markdown=- for standard "
            "output.",
        )
    format_registry.find_format(name)
    return ReportRequest(name, path)


def takes_stdout(requests: Sequence[ReportRequest]) -> bool:
    """Return True if a report is written to standard output."""
    return any(request.path == STDOUT for request in requests)


def write_reports(requests: Iterable[ReportRequest], report_input: ReportInput) -> None:
    """Write each report to its path.

    Raises:
        ReportError: one cannot be made from this run.
        RecordError: a file cannot be written.
    """
    page = report_input.suite_page
    for request in requests:
        render = format_registry.renderer(request.format)
        if page is not None:
            link = link_text(page, request.path) if request.path != STDOUT else ""
            report_input = replace(report_input, suite_link=link)
        write_report(request.path, render(report_input))


def link_text(target: Path, page: str) -> str:
    """Return a link from a page to a file, relative to the page, so that both can be moved."""
    return quote(Path(os.path.relpath(target, Path(page).parent)).as_posix())


def write_report(path: str, content: bytes) -> None:
    """Write a report to its path, ``-`` for standard output.

    Raises:
        RecordError: the file cannot be written.
    """
    if path == STDOUT:
        sys.stdout.flush()
        sys.stdout.buffer.write(content)
        sys.stdout.flush()
        return
    write_output(Path(path), content)


def write_folder_reports(
    requests: Sequence[ReportRequest],
    folder: Path,
    spec_file: Path | None,
    *,
    verbose: bool = False,
    suite_page: Path | None = None,
) -> None:
    """Write the reports of a run folder; without reports it is not opened.

    Args:
        requests: what to write.
        folder: the folder of the run.
        spec_file: whose objectives were judged.
        verbose: with every reason and every note.
        suite_page: the page of the suite of the run, to which its HTML links.

    Raises:
        RecordError: the folder is not a run, or a file cannot be written.
        ReportError: a report cannot be made from this run.
    """
    if not requests:
        return
    reports = read_folder(folder, spec_file=spec_file)
    write_reports(requests, replace(reports, verbose=verbose, suite_page=suite_page))


def write_failure_reports(
    requests: Iterable[ReportRequest], error: R2bspecError, spec: Path
) -> None:
    """Write the requested reports that can represent an error.

    Args:
        requests: the reports.
        error: why there is no run; with `diagnostics` and the document `loaded`, if it has some.
        spec: the file of the benchmark.

    Raises:
        RecordError: a file cannot be written.
    """
    diagnostics, output = tuple(getattr(error, "diagnostics", ())), ""
    if not diagnostics:
        place = Span.of_file(str(spec))
        text, output = split_output(str(error))
        diagnostics = (Diagnostic(error.code, Severity.ERROR, text, place, help=error.hint),)
    loaded = getattr(error, "loaded", None)
    sources: Mapping[str, str] = loaded.texts if loaded is not None else {}
    document = Document(
        line=f"✘ error {error.code}: nothing was measured",
        word="✘ error",
        outcome="error",
        sections=(
            Section(
                "Error",
                (
                    Verbatim(render_text(diagnostics, sources)),
                    *((Fold("Its last output", (Verbatim(output),)),) if output else ()),
                ),
            ),
        ),
    )
    for request in requests:
        if request.format == "markdown":
            from r2bspec.report.markdown import to_markdown

            content = harmless(to_markdown(document))
        elif request.format == "html":
            from r2bspec.report.html.page import to_page

            content = harmless(to_page(document).decode())
        elif request.format in {"github", "junit"}:
            content = finding_formats.render(request.format, diagnostics, sources)
        elif request.format == "json":
            content = json.dumps(failure(error), indent=2) + "\n"
        else:
            continue
        write_report(request.path, content.encode())


def failure(error: R2bspecError) -> dict[str, Any]:
    """Return an error as the JSON that replaces a result."""
    return {
        "r2bspec_error": 1,
        "code": error.code,
        "message": str(error),
        "hint": error.hint,
        "exit_status": int(error.exit_code),
    }
