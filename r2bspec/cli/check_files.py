"""Checks files, one or thousands.

Of a document only its findings are kept, and its text where they refer to it, so that memory
does not grow with the number of files. Many files are distributed among processes, one for each
CPU; the order of the results is that of the files in either case.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from r2bspec.cli.file_report import CheckOptions, FileReport
from r2bspec.diagnostics import Diagnostic
from r2bspec.diagnostics.waivers import may_contain_waiver
from r2bspec.errors import R2bspecError
from r2bspec.safe_io.looked_up_files import shared_lookups

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec

T = TypeVar("T")

MIN_PARALLEL_FILES = 100
"""From this number of files on several processes are faster than one. Starting them takes about as
long as checking ten files."""

_MIN_FILES_PER_WORKER = 16


def check_files(files: Sequence[str], options: CheckOptions) -> Iterator[FileReport]:
    """Check every file, in the order given.

    Args:
        files: by name; ``-`` is standard input.
        options: for all of them.

    Raises:
        InternalError, WorkerEndedError: the check of a file crashed; after the reports of the
            others.
    """
    # Documents are trees: frequent collection of cycles takes time and frees nothing.
    gc.set_threshold(50_000, 20, 20)
    check = partial(check_file, options=options)
    workers = min(len(os.sched_getaffinity(0)), len(files) // _MIN_FILES_PER_WORKER)
    with shared_lookups():
        if len(files) < MIN_PARALLEL_FILES or workers < 2 or "-" in files:
            yield from _one_after_another(check, files)
        else:
            yield from _in_processes(check, files, workers)


def _in_processes(
    check: Callable[[str], FileReport], files: Sequence[str], workers: int
) -> Iterator[FileReport]:
    from r2bspec.cli.internal_error import InternalError, UncheckedFiles
    from r2bspec.cli.worker_processes import map_in_processes

    # The first file imports all modules, which the forked processes then share.
    failures = UncheckedFiles()
    try:
        yield naming_the_file(check, files[0])
    except InternalError as error:
        failures.add(files[0], error)
    yield from map_in_processes(check, files[1:], workers, failures)


def _one_after_another(
    check: Callable[[str], FileReport], files: Sequence[str]
) -> Iterator[FileReport]:
    from r2bspec.cli.internal_error import InternalError, UncheckedFiles

    failures = UncheckedFiles()
    for file in files:
        try:
            report = naming_the_file(check, file)
        except InternalError as error:
            failures.add(file, error)
        else:
            yield report
    failures.raise_first()


def naming_the_file(check: Callable[[str], T], file: str) -> T:
    """The result of a check, whose unforeseen errors say which file led to them.

    Raises:
        InternalError: the check raised what no code foresaw.
    """
    try:
        return check(file)
    except (R2bspecError, click.ClickException, click.exceptions.Exit):
        raise
    except Exception as error:
        from r2bspec.cli.internal_error import Crash, InternalError

        raise InternalError(Crash.of(error, f"while checking {file!r}")) from error


def check_file(file: str, options: CheckOptions) -> FileReport:
    """Check one file; ``-`` is standard input."""
    cases = _load(Path(file), file, options)
    found = _findings(cases, options)
    if options.require_slos:
        found = [*_missing_objectives(cases), *found]
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


def _missing_objectives(cases: tuple[LoadedSpec, ...]) -> list[Diagnostic]:
    """A finding if nothing can fail in some cases. No waiver applies to it."""
    from r2bspec.compare.gate_strength import can_fail, missing_objectives
    from r2bspec.plan.compile_plan import active_objectives

    lacking = [
        each
        for each in cases
        if each.spec is not None and not can_fail(active_objectives(each.spec))
    ]
    names = [each.case for each in lacking if each.case]
    return [missing_objectives(cases[0].file, names)] if lacking else []


def _title(loaded: LoadedSpec) -> str:
    return f"{loaded.file} [{loaded.case}]" if loaded.case else loaded.file
