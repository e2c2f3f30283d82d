"""Finds the files of specs, checks and repairs them.

Of a document only its findings are kept, and its text if they refer to it, so that memory does not
grow with the number of files.
"""

from __future__ import annotations

import contextlib
import gc
import glob
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
import msgspec

from r2bspec.diagnostics import Diagnostic
from r2bspec.diagnostics.quote import pluralize
from r2bspec.diagnostics.waivers import may_contain_waiver
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.record.files import write_atomically
from r2bspec.report.output import echo
from r2bspec.safe_io import safe_file
from r2bspec.safe_io.file_search import files_below, matching_files, path_hint
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES
from r2bspec.safe_io.safe_file import is_folder
from r2bspec.safe_io.shared_lookups import shared_lookups

if TYPE_CHECKING:
    from r2bspec.diagnostics.edits import FixResult
    from r2bspec.language.load_spec import LoadedSpec


SUFFIX = ".r2b.yaml"


def spec_files(paths: Iterable[str]) -> list[str]:
    """Return the files of `paths` once, in the given order; folders and patterns sorted by name.

    Raises:
        click.UsageError: a path that does not exist, or without a spec.
    """
    return list(dict.fromkeys(file for path in paths for file in _expand_path(path)))


def _expand_path(path: str) -> list[str]:
    if path == "-":
        return [path]
    place = Path(path)
    if is_folder(place):
        start = "" if place == Path() else str(place)
        return _require_files(
            files_below(start, f"*{SUFFIX}"),
            f"the folder {path!r} has no *{SUFFIX} file",
        )
    if os.path.lexists(place):
        return [path]
    if glob.has_magic(path):
        return _require_files(matching_files(path), f"no file matches {path!r}")
    raise click.UsageError(f"{path!r} does not exist; {path_hint(path)}")


def _require_files(files: list[str], message: str) -> list[str]:
    if not files:
        raise click.UsageError(message)
    return files


class CheckOptions(msgspec.Struct, frozen=True):
    """The options for every file."""

    values: SelectionValues = {}
    offline: bool = False
    resolved: bool = False


class FileReport(msgspec.Struct, frozen=True):
    """The result of checking a file.

    Attributes:
        file: its name for the user.
        cases: the number of checked cases; 1 without a matrix.
        complete: whether all rules were applied, which needs a well-formed document.
        findings: all findings, sorted by place.
        texts: the texts that the findings refer to, by file name.
        resolved: if requested, every case with all substitutions done, by the file's name and the
            case.
    """

    file: str
    cases: int
    complete: bool
    findings: tuple[Diagnostic, ...]
    texts: Mapping[str, str]
    resolved: Mapping[str, str] = msgspec.field(default_factory=dict)


def check_files(files: Sequence[str], options: CheckOptions) -> Iterator[FileReport]:
    """Check every file, in the order given.

    Args:
        files: by name; ``-`` is standard input.
        options: for all of them.

    Raises:
        Exception: the check of a file crashed; its name is a note.
    """
    # Documents are trees: frequent collection of cycles takes time and frees nothing.
    gc.set_threshold(50_000, 20, 20)
    with shared_lookups():
        for file in files:
            with _checking(file):
                report = check_file(file, options)
            yield report


@contextlib.contextmanager
def _checking(file: str) -> Iterator[None]:
    """Let an unforeseen error name the file that led to it."""
    try:
        yield
    except (R2bspecError, click.ClickException, click.exceptions.Exit):
        raise
    except Exception as error:
        error.add_note(f"while checking {file!r}")
        raise


def check_file(file: str, options: CheckOptions) -> FileReport:
    """Check a file; ``-`` is standard input."""
    cases = _load(Path(file), file, options)
    findings = _findings(cases, options)
    return FileReport(
        file=cases[0].file,
        cases=len(cases),
        complete=all(case.spec is not None for case in cases),
        findings=tuple(findings),
        texts={name: text for case in cases for name, text in case.texts.items()}
        if findings
        else {},
        resolved={_title(case): case.resolved_yaml() for case in cases} if options.resolved else {},
    )


def check_text(text: str, file: str, options: CheckOptions) -> list[Diagnostic]:
    """Check a text as if it were the content of a file."""
    return _findings(_load(text, file, options), options)


def _load(source: Path | str, file: str, options: CheckOptions) -> tuple[LoadedSpec, ...]:
    from r2bspec.language.load_spec import load_cases

    return load_cases(source, file=file, **options.values)


def _findings(cases: tuple[LoadedSpec, ...], options: CheckOptions) -> list[Diagnostic]:
    """Return all findings; rules are imported only where they apply."""
    # All cases have the same texts.
    waived = any(map(may_contain_waiver, {text for case in cases for text in case.texts.values()}))
    if not waived and all(case.spec is None for case in cases):
        from r2bspec.language.matrix import merge_case_findings

        return merge_case_findings(cases, [case.diagnostics for case in cases])
    from r2bspec.check.engine import check_cases

    return check_cases(cases, offline=options.offline)


def _title(loaded: LoadedSpec) -> str:
    return f"{loaded.file} [{loaded.case}]" if loaded.case else loaded.file


_BOM = "\ufeff"


def repair(
    files: Sequence[str],
    check_text: Callable[[str, str], Sequence[Diagnostic]],
    *,
    write: bool,
) -> int:
    """Repair each file by the safe edits of its findings, or print the changes.

    Args:
        files: the files to repair; no other file is touched.
        check_text: returns the findings of a text, given with the name of its file.
        write: write the files; otherwise print a unified diff of each.

    Returns:
        The number of files that were, or would be, changed.

    Raises:
        UsageError: a file cannot be written.
    """
    from r2bspec.diagnostics.edits import unified_diff

    changed = fixes = 0
    for file in files:
        before = read_text(file)
        if before is None:
            continue  # an unreadable file is a finding of its own
        bom = _BOM if before.startswith(_BOM) else ""
        text = before.removeprefix(bom)
        with _checking(file):
            fixed = _apply_fixes(text, check_text, file)
        if not fixed.applied:
            continue
        changed += 1
        fixes += len(fixed.applied)
        if write:
            write_text(file, bom + fixed.text)
        else:
            echo(unified_diff(before, bom + fixed.text, file), nl=False)
    if write or changed:
        verb = "repaired" if write else "can be repaired by --fix"
        echo(f"{pluralize(fixes, 'problem')} {verb} in {changed} of {len(files)} files", err=True)
    return changed


def _apply_fixes(
    text: str, check_text: Callable[[str, str], Sequence[Diagnostic]], file: str
) -> FixResult:
    from r2bspec.diagnostics.edits import fix

    return fix(text, file, lambda changed: check_text(changed, file))


def read_text(file: str) -> str | None:
    """Return the text of a file.

    None if `validate` cannot read it, or if it is a link elsewhere.
    """
    path = Path(file)
    try:
        return safe_file.read_text(path, max_bytes=MAX_DOCUMENT_BYTES, folders=(path.parent,))
    except (OSError, ValueError):
        return None


def write_text(file: str, text: str) -> None:
    """Replace or create a file atomically; a link and the mode are kept.

    Raises:
        UsageError: it cannot be written, or is a link to a file in another folder, which may be
            anywhere: the author of the link chose the file, not the user.
    """
    path = Path(file)
    if path.is_symlink():
        path = Path(os.path.realpath(file))
        if path.parent != Path(os.path.realpath(Path(file).parent)):
            raise UsageError(
                f"{file} is a link to {path}, in another folder, and is not written",
                hint="Name the file itself.",
            )
    try:
        mode = stat.S_IMODE(path.stat().st_mode) if path.exists() else None
        write_atomically(path, text.encode())
        if mode is not None:
            path.chmod(mode)
    except (R2bspecError, OSError) as error:
        raise UsageError(
            f"{file} cannot be written: {getattr(error, 'strerror', None) or error}",
            hint="See that you may write to it and its folder, or use --diff.",
        ) from error
