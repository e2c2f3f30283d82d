"""`validate --fix` and `--diff`: apply safe edits to files, or show them."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from r2bspec.cli.check_files import naming_the_file
from r2bspec.diagnostics import Diagnostic
from r2bspec.diagnostics.edits import FixResult, fix, unified_diff
from r2bspec.errors import UsageError
from r2bspec.report.output import echo

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
    changed = fixes = 0
    for file in files:
        before = read_text(file)
        if before is None:
            continue  # an unreadable file is a finding of its own
        bom = _BOM if before.startswith(_BOM) else ""
        text = before.removeprefix(bom)
        fixed = naming_the_file(partial(_apply_fixes, text, check_text), file)
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
        problems = f"{fixes} problem" if fixes == 1 else f"{fixes} problems"
        echo(f"{problems} {verb} in {changed} of {len(files)} files", err=True)
    return changed


def _apply_fixes(
    text: str, check_text: Callable[[str, str], Sequence[Diagnostic]], file: str
) -> FixResult:
    return fix(text, file, lambda changed: check_text(changed, file))


def read_text(file: str) -> str | None:
    """The text of a file; None if `validate` cannot read it, or if it is a link elsewhere."""
    from r2bspec.language.document import MAX_DOCUMENT_BYTES
    from r2bspec.safe_io import safe_file

    path = Path(file)
    try:
        return safe_file.read_text(path, max_bytes=MAX_DOCUMENT_BYTES, folders=(path.parent,))
    except (OSError, ValueError):
        return None


def write_text(file: str, text: str) -> None:
    """Replace a file's content atomically; a link and the mode are kept.

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
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        mode = path.stat().st_mode
        with temporary.open("xb") as stream:
            stream.write(text.encode("utf-8"))
            stream.flush()
            os.fsync(stream.fileno())
        temporary.chmod(mode & 0o7777)
        temporary.replace(path)
    except OSError as error:
        raise UsageError(f"{file} cannot be written: {error.strerror or error}") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
