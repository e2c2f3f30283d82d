"""Checking files, one or thousands: what `validate` needs to know of each, and nothing more.

Of a document only its findings are kept, and its text where they point into it, so that memory
does not grow with the number of files. Many files are shared out among processes, one for each
CPU; the order of the results is that of the files in either case.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from r2bspec.diagnostics import Diagnostic
from r2bspec.diagnostics.waivers import may_waive
from r2bspec.language.case_findings import findings_of_cases
from r2bspec.language.load_spec import Loaded, load_cases

FEWEST = 100
"""Files from which on several processes are faster than one. Starting them takes about as long as
checking some ten files."""

_AT_ONCE = 16  # files that a process takes at a time


@dataclass(frozen=True, slots=True)
class Options:
    """What is asked of every file."""

    sets: tuple[str, ...] = ()
    variables: Mapping[str, str] | None = None
    case: str = ""
    allow_paths: tuple[Path, ...] = ()
    offline: bool = False
    resolved: bool = False


@dataclass(frozen=True, slots=True)
class Checked:
    """One file after its check.

    Attributes:
        file: its name for the user.
        cases: how many cases of it were checked; 1 where it has no matrix.
        complete: whether all rules were applied, which takes a document that is right itself.
        found: everything that is wrong with it, sorted by place.
        texts: the texts that the findings point into, by file name.
        resolved: if that was asked for, every case with all written out, by the file's name and
            the case.
    """

    file: str
    cases: int
    complete: bool
    found: tuple[Diagnostic, ...]
    texts: Mapping[str, str]
    resolved: Mapping[str, str] = field(default_factory=dict)


def check_files(files: Sequence[str], options: Options) -> Iterator[Checked]:
    """Check every file, in the order given."""
    # Documents are trees without cycles: looking for cycles often finds nothing, and takes time.
    gc.set_threshold(50_000, 20, 20)
    check_one = partial(check_file, options=options)
    workers = min(len(os.sched_getaffinity(0)), len(files) // _AT_ONCE)
    if len(files) < FEWEST or workers < 2 or "-" in files:
        yield from map(check_one, files)
        return
    import multiprocessing

    # The first file brings in all modules, which the processes then have from the beginning.
    yield check_one(files[0])
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        yield from pool.imap(check_one, files[1:], chunksize=_AT_ONCE)


def check_file(file: str, options: Options) -> Checked:
    """Check one file; ``-`` is standard input."""
    cases = _load(Path(file), file, options)
    found = _findings(cases, options)
    return Checked(
        file=cases[0].file,
        cases=len(cases),
        complete=all(each.spec is not None for each in cases),
        found=tuple(found),
        texts={name: text for each in cases for name, text in each.texts.items()} if found else {},
        resolved={_title(each): each.resolved_yaml() for each in cases} if options.resolved else {},
    )


def check_text(text: str, file: str, options: Options) -> list[Diagnostic]:
    """Check a text as if it were the content of a file."""
    return _findings(_load(text, file, options), options)


def _load(source: Path | str, file: str, options: Options) -> tuple[Loaded, ...]:
    return load_cases(
        source,
        file=file,
        sets=options.sets,
        variables=options.variables,
        case=options.case,
        allow_paths=options.allow_paths,
    )


def _findings(cases: tuple[Loaded, ...], options: Options) -> list[Diagnostic]:
    """Everything that is wrong; rules are imported only where there is something for them."""
    waived = any(may_waive(text) for each in cases for text in each.texts.values())
    if not waived and all(each.spec is None for each in cases):
        return findings_of_cases(cases, [each.diagnostics for each in cases])
    from r2bspec.check.engine import check_cases

    return check_cases(cases, offline=options.offline)


def _title(loaded: Loaded) -> str:
    return f"{loaded.file} [{loaded.case}]" if loaded.case else loaded.file
