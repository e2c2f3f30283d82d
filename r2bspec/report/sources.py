"""Results from wherever they are kept: a run folder, or a ``result.json`` by itself."""

from __future__ import annotations

from pathlib import Path

import msgspec

from r2bspec.record.store import Run, open_run
from r2bspec.report.errors import UnreadableResultError
from r2bspec.report.model import Result
from r2bspec.report.reported import Reported
from r2bspec.report.result import from_json, result_of


def read_reported(
    path: Path, *, spec_file: Path | None = None, baseline: Run | None = None
) -> Reported:
    """What to report: a run folder is measured and judged anew, a file is taken at its word.

    Raises:
        RecordError: a folder is no run folder.
        UnreadableResultError: a file is no result.
    """
    if path.is_dir():
        run = open_run(path)
        return Reported(result=result_of(run), run=run, spec_file=spec_file, baseline=baseline)
    return Reported(result=read_result(path), spec_file=spec_file, baseline=baseline)


def read_result(path: Path) -> Result:
    """Read a ``result.json``.

    Raises:
        UnreadableResultError: it is not there, or is none.
    """
    try:
        return from_json(path.read_bytes())
    except OSError as error:
        raise UnreadableResultError(f"{path} cannot be read: {error.strerror or error}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise UnreadableResultError(
            f"{path} is no result of this version: {error}",
            hint="Name a run folder or the result.json in it.",
        ) from error
