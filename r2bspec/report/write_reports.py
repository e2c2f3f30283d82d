"""Reports where they were asked for: ``FORMAT=PATH``, with ``-`` for standard output.

A file appears whole or not at all; its folders are made.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from r2bspec.compare.report_input import Reported
from r2bspec.measure.units import rate_name
from r2bspec.record.atomic_files import write_whole
from r2bspec.record.errors import RUN_UNWRITABLE, RecordError
from r2bspec.report.errors import ReportError, ReportUsageError
from r2bspec.report.format_registry import check_installed, find, renderer

STDOUT = "-"


@dataclass(frozen=True, slots=True)
class Asked:
    """A report that was asked for; `path` may be ``-``."""

    format: str
    path: str


def parse_asked(options: Iterable[str]) -> tuple[Asked, ...]:
    """Read ``FORMAT=PATH`` options, and see before anything runs that each can be made.

    Raises:
        ReportUsageError: one has no equals sign or no path, names no format, or two of them
            want standard output, or the same file.
        ReportError: a library that one of them needs is missing.
    """
    asked = [_parse(option) for option in options]
    for one in asked:
        check_installed(one.format)
    paths = [one.path for one in asked]
    for path in paths:
        if paths.count(path) > 1:
            where = "standard output" if path == STDOUT else repr(path)
            raise ReportUsageError(f"two reports cannot both go to {where}")
    return tuple(asked)


def _parse(option: str) -> Asked:
    name, equals, path = option.partition("=")
    if not equals or not path:
        raise ReportUsageError(
            f"--report takes FORMAT=PATH, not {option!r}",
            hint="For example --report html=report.html, or --report markdown=- for standard "
            "output.",
        )
    find(name)
    return Asked(name, path)


def takes_stdout(asked: Sequence[Asked]) -> bool:
    """Whether one of the reports goes to standard output, so that nothing else should."""
    return any(one.path == STDOUT for one in asked)


def write_reports(asked: Iterable[Asked], reported: Reported) -> None:
    """Make each report and put it where it was asked for.

    Raises:
        ReportError: one cannot be made from this run.
        RecordError: the file system refuses.
    """
    for one in asked:
        for path, content in _contents(one, reported):
            _put(path, content)


def _contents(asked: Asked, reported: Reported) -> Iterator[tuple[str, bytes]]:
    render = renderer(asked.format)
    if not find(asked.format).single or "{" not in asked.path:
        yield asked.path, render(reported)
        return
    for rate in reported.result.metrics.rates:
        for monitor in rate.pooled.monitors:
            one = replace(reported, monitor=monitor, rate_hz=rate.offered_hz)
            path = asked.path.replace("{monitor}", monitor)
            yield path.replace("{rate}", rate_name(rate.offered_hz, rate.pace)), render(one)


def _put(path: str, content: bytes) -> None:
    if path == STDOUT:
        sys.stdout.flush()
        sys.stdout.buffer.write(content)
        sys.stdout.flush()
        return
    place = Path(path)
    if place.is_dir():
        raise ReportError(f"{path} is a folder; a report needs the name of a file")
    if place.exists() and not place.is_file():
        # A pipe or a device, such as /dev/stderr, is written to; a rename would replace it.
        try:
            place.write_bytes(content)
        except OSError as error:
            raise RecordError(
                f"{path} cannot be written: {error.strerror or error}", code=RUN_UNWRITABLE
            ) from error
        return
    write_whole(place, content)


def write_of_folder(asked: Sequence[Asked], folder: Path, spec_file: Path | None) -> None:
    """Make the reports of a run folder; it is not even opened if none is asked for.

    Raises:
        RecordError: the folder is no run, or the file system refuses.
        ReportError: a report cannot be made from this run.
    """
    if not asked:
        return
    from r2bspec.compare.load_results import read_folder

    write_reports(asked, read_folder(folder, spec_file=spec_file))
