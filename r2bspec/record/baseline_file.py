"""The earlier runs that a run was compared with, kept in its folder: ``baseline.json``.

The values are copied, so that the run can be judged again when the history has moved on and the
stored run is gone. The folder ``confirm`` beside it is a fresh run that was made after a failure.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

import msgspec

from r2bspec.record.errors import RecordError
from r2bspec.record.run_folder import Run, open_run
from r2bspec.untrusted.safe_json import read_json

BASELINE_FILE: Final = "baseline.json"
CONFIRMATION_FOLDER: Final = "confirm"


class BaselineSeries(msgspec.Struct, frozen=True, kw_only=True):
    """A metric in earlier runs: one value for each of them, or, of a stored run, each iteration.

    Attributes:
        at_hz: the offered rate; None for the run as a whole.
        monitor: None for a metric that belongs to none.
        values: oldest first, in the metric's SI unit; None where there is none.
    """

    at_hz: float | None
    monitor: str | None
    metric: str
    values: tuple[float | None, ...]


class BaselineRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Earlier runs.

    Attributes:
        kind: a ``history`` decides, a single ``stored`` run only advises.
        source: the file or folder, as the user named it.
        run_ids: of the earlier runs, oldest first.
        differences: in what they differ from this run, a line each.
        series: their values.
    """

    r2bspec_baseline: Literal[1] = 1
    kind: Literal["history", "stored"]
    source: str
    run_ids: tuple[str, ...]
    differences: tuple[str, ...] = ()
    series: tuple[BaselineSeries, ...]

    def find(
        self, at_hz: float | None, monitor: str | None, metric: str
    ) -> tuple[float | None, ...]:
        """The values of a metric; none if the earlier runs do not have it."""
        for one in self.series:
            if (one.at_hz, one.monitor, one.metric) == (at_hz, monitor, metric):
                return one.values
        return ()


def to_json(record: BaselineRecord) -> bytes:
    """The content of ``baseline.json``."""
    return msgspec.json.format(msgspec.json.encode(record), indent=1) + b"\n"


def read_baseline(folder: Path) -> BaselineRecord | None:
    """The earlier runs that a run folder names; None if it was not compared.

    Raises:
        RecordError: the file is damaged.
    """
    path = folder / BASELINE_FILE
    try:
        return read_json(path, BaselineRecord)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.DecodeError) as error:
        raise RecordError(
            f"{path} is damaged: {error}",
            hint="The folder was changed after the run, or is not one that r2bspec wrote.",
        ) from error


def read_confirmation(folder: Path) -> Run | None:
    """The fresh run that was made after a failure; None if there is none.

    Raises:
        RecordError: it cannot be read.
    """
    path = folder / CONFIRMATION_FOLDER
    return open_run(path) if (path / "record.json").exists() else None
