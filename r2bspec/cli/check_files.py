"""Checks files, one or thousands.

Of a document only its findings are kept, and its text where they refer to it, so that memory
does not grow with the number of files. Many files are distributed among processes, one for each
CPU; the order of the results is that of the files in either case. What checks a document is
imported with the first one: where the cache knows them all, nothing of it is needed.
"""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import click

from r2bspec.cli.file_report import CheckOptions, FileReport
from r2bspec.diagnostics import Diagnostic
from r2bspec.diagnostics.waivers import may_contain_waiver
from r2bspec.errors import R2bspecError
from r2bspec.untrusted.looked_up_files import looked_up_files, shared_lookups

if TYPE_CHECKING:
    from r2bspec.cli.report_cache import Dependencies, ReportCache
    from r2bspec.language.load_spec import LoadedSpec

T = TypeVar("T")

MIN_PARALLEL_FILES = 100
"""From this number of files on several processes are faster than one. Starting them takes about as
long as checking ten files."""

_MIN_FILES_PER_WORKER = 16


class _Checked(NamedTuple):
    """The report of a file as it was named, and what it depends on, for the cache."""

    file: str
    report: FileReport
    dependencies: Dependencies | None = None


def check_files(
    files: Sequence[str], options: CheckOptions, cache: ReportCache | None = None
) -> Iterator[FileReport]:
    """Check every file, in the order given.

    Args:
        files: by name; ``-`` is standard input.
        options: for all of them.
        cache: has the reports of files that are as they were, and gets the others.

    Raises:
        InternalError, WorkerEndedError: the check of a file crashed; after the reports of the
            others.
    """
    from r2bspec.cli.internal_error import InternalError, WorkerEndedError

    known = {} if cache is None else {file: cache.get(file) for file in files}
    rest = [file for file in files if known.get(file) is None]
    # Documents are trees: frequent collection of cycles takes time and frees nothing.
    gc.set_threshold(50_000, 20, 20)
    check_one = partial(_check_noting, options=options, cache=cache, started_ns=time.time_ns())
    checked = _checked(check_one, rest)
    following = iter(files)
    failure: R2bspecError | None = None
    try:
        with shared_lookups():
            for each in checked:
                yield from _reports_before(each.file, following, known)
                if cache is not None:
                    cache.put(*each)
                yield each.report
    except (InternalError, WorkerEndedError) as error:
        failure = error
    finally:
        if cache is not None:
            cache.write()
    yield from _reports_before(None, following, known)
    if failure is not None:
        raise failure


def _reports_before(
    file: str | None, files: Iterator[str], known: Mapping[str, FileReport | None]
) -> Iterator[FileReport]:
    """The known reports of the files up to one; that one is taken from the files, too."""
    for each in files:
        if each == file:
            return
        report = known.get(each)
        if report is not None:
            yield report


def _check_noting(
    file: str, options: CheckOptions, cache: ReportCache | None, started_ns: int
) -> _Checked:
    if cache is None:
        return _Checked(file, check_file(file, options))
    with looked_up_files() as seen:
        report = check_file(file, options)
    return _Checked(file, report, cache.dependencies(seen, started_ns))


def _checked(check_one: Callable[[str], _Checked], files: Sequence[str]) -> Iterator[_Checked]:
    workers = min(len(os.sched_getaffinity(0)), len(files) // _MIN_FILES_PER_WORKER)
    if len(files) < MIN_PARALLEL_FILES or workers < 2 or "-" in files:
        yield from _one_after_another(check_one, files)
        return
    from r2bspec.cli.internal_error import InternalError, UncheckedFiles
    from r2bspec.cli.worker_processes import map_in_processes

    # The first file imports all modules, which the forked processes then share.
    failures = UncheckedFiles()
    try:
        yield naming_the_file(check_one, files[0])
    except InternalError as error:
        failures.add(files[0], error)
    yield from map_in_processes(check_one, files[1:], workers, failures)


def _one_after_another(
    check_one: Callable[[str], _Checked], files: Sequence[str]
) -> Iterator[_Checked]:
    from r2bspec.cli.internal_error import InternalError, UncheckedFiles

    failures = UncheckedFiles()
    for file in files:
        try:
            report = naming_the_file(check_one, file)
        except InternalError as error:
            failures.add(file, error)
        else:
            yield report
    failures.raise_first()


def naming_the_file(check_one: Callable[[str], T], file: str) -> T:
    """The result of a check, whose unforeseen errors say which file led to them.

    Raises:
        InternalError: the check raised what no code foresaw.
    """
    try:
        return check_one(file)
    except (R2bspecError, click.ClickException, click.exceptions.Exit):
        raise
    except Exception as error:
        from r2bspec.cli.internal_error import Crash, InternalError

        raise InternalError(Crash.of(error, f"while checking {file!r}")) from error


def check_file(file: str, options: CheckOptions) -> FileReport:
    """Check one file; ``-`` is standard input."""
    cases = _load(Path(file), file, options)
    found = _findings(cases, options)
    return FileReport(
        file=cases[0].file,
        cases=len(cases),
        complete=all(each.spec is not None for each in cases),
        findings=tuple(found),
        texts={name: text for each in cases for name, text in each.texts.items()} if found else {},
        resolved={_title(each): each.resolved_yaml() for each in cases} if options.resolved else {},
    )


def check_text(text: str, file: str, options: CheckOptions) -> list[Diagnostic]:
    """Check a text as if it were the content of a file."""
    return _findings(_load(text, file, options), options)


def _load(source: Path | str, file: str, options: CheckOptions) -> tuple[LoadedSpec, ...]:
    from r2bspec.language.load_spec import load_cases

    return load_cases(
        source,
        file=file,
        sets=options.sets,
        variables=options.variables,
        case=options.case,
        allow_paths=options.allow_paths,
        untrusted=options.untrusted,
    )


def _findings(cases: tuple[LoadedSpec, ...], options: CheckOptions) -> list[Diagnostic]:
    """All findings; rules are imported only where they apply."""
    # All cases have the same texts.
    waived = any(map(may_contain_waiver, {text for one in cases for text in one.texts.values()}))
    if not waived and all(each.spec is None for each in cases):
        from r2bspec.language.matrix import merge_case_findings

        return merge_case_findings(cases, [each.diagnostics for each in cases])
    from r2bspec.check.engine import check_cases

    return check_cases(cases, offline=options.offline)


def _title(loaded: LoadedSpec) -> str:
    return f"{loaded.file} [{loaded.case}]" if loaded.case else loaded.file
