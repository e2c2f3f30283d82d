"""``tuning.json``: a `TuningResult` as canonical JSON, and reading it for reports and to resume.

Canonical: UTF-8, sorted keys, indentation of two spaces, a newline at the end. JSON has no
infinity, which a margin has where messages were lost: it is written as `MAX_NUMBER`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any, Final

import msgspec

from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.record.files import FolderReader, RecordError, write_atomically
from r2bspec.safe_io.limits import MAX_NUMBER
from r2bspec.tune.tuning_result import TuningResult

TUNING_FILE: Final = "tuning.json"

_FILES: Final = FolderReader("search", "Give the folder of a search by 'r2bspec tune'.")


def to_json(result: TuningResult) -> bytes:
    """The canonical form of a result.

    Raises:
        ValueError: a number of it is none.
    """
    plain = _with_numbers(
        msgspec.to_builtins(result), {math.inf: MAX_NUMBER, -math.inf: -MAX_NUMBER}
    )
    text = msgspec.json.encode(plain, order="sorted")
    return escaped_json(msgspec.json.format(text, indent=2) + b"\n")


def write_tuning(folder: Path, result: TuningResult) -> None:
    """Write a result into the folder of its search, as a whole or not at all.

    Raises:
        RecordError: it cannot be written.
    """
    write_atomically(folder / TUNING_FILE, to_json(result))


def read_tuning(folder: Path) -> TuningResult:
    """Read the result of a search.

    Raises:
        RecordError: the file cannot be read, is damaged, of another version, or contradicts itself.
    """
    path = folder / TUNING_FILE
    content: dict[str, Any] = _FILES.versioned(path, dict, "r2bspec_tuning")
    plain = _with_numbers(content, {MAX_NUMBER: math.inf, -MAX_NUMBER: -math.inf})
    try:
        result = msgspec.convert(plain, TuningResult)
    except msgspec.ValidationError as error:
        raise RecordError(f"{path} is damaged: {error}", hint=_FILES.changed) from error
    for contradiction in _contradictions(result):
        raise RecordError(f"{path} is damaged: {contradiction}", hint=_FILES.changed)
    return result


def _with_numbers(value: Any, numbers: dict[float, float]) -> Any:
    """Plain data with some floating-point numbers replaced by others."""
    if isinstance(value, dict):
        return {key: _with_numbers(item, numbers) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_with_numbers(item, numbers) for item in value]
    if isinstance(value, float):
        if math.isnan(value):
            raise ValueError("not a number")
        return numbers.get(value, value)
    return value


def _contradictions(result: TuningResult) -> Iterator[str]:
    """What no search writes: a reader would resume, or open, something else."""
    if [trial.number for trial in result.trials] != list(range(len(result.trials))):
        yield "its trials are not numbered from 0"
    deployments = [trial.deployment for trial in result.trials]
    if result.winner is not None:
        deployments.append(result.winner)
    known = {
        (lever.name, place, setting)
        for lever in result.space.levers
        for place, setting in enumerate(lever.settings)
    }
    for deployment in deployments:
        for choice in deployment.choices:
            if (choice.lever, choice.place, choice.setting) not in known:
                yield f"its space has no setting {choice.place} of {choice.lever!r}"
    for trial in result.trials:
        run = PurePosixPath(trial.run)
        if run.is_absolute() or ".." in run.parts:
            yield f"the run of trial {trial.number} is outside of the folder"
