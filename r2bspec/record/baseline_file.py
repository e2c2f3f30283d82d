"""The baseline of a run, in its folder: ``baseline.json``.

The values are copied, so that the run can be judged again after the history has changed or the
stored run was deleted. The folder ``confirm`` contains the confirmation run after a failure.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

import msgspec

from r2bspec.record.files import RUN_FILES
from r2bspec.record.graph_identity import GraphIdentity
from r2bspec.record.run_folder import Run, open_run

BASELINE_FILE: Final = "baseline.json"
CONFIRMATION_FOLDER: Final = "confirm"


class BaselineSeries(msgspec.Struct, frozen=True, kw_only=True):
    """A metric of the baseline: one value per run of a history, or per iteration of a stored run.

    Attributes:
        at_hz: the offered rate; None for the whole run.
        monitor: None for a metric without a monitor.
        values: oldest first, in the SI unit of the metric; None if missing.
        starts: of a stored run, the start of the processes that each iteration was played in;
            empty where it is not known.
    """

    at_hz: float | None
    monitor: str | None
    metric: str
    values: tuple[float | None, ...]
    starts: tuple[int, ...] = ()


class BaselineRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The baseline of a run.

    Attributes:
        kind: a ``history`` decides; a single ``stored`` run is only informative.
        source: the file or folder, as given by the user.
        run_ids: of the runs of the baseline, oldest first.
        differences: between these runs and this one, one per line.
        series: the values.
        identity: what the graph of the stored run, or of the latest one of the history, was made
            of.
        grown: the parts of nodes and topics that grew since these runs, as `Result.grown`.
    """

    r2bspec_baseline: Literal[1] = 1
    kind: Literal["history", "stored"]
    source: str
    run_ids: tuple[str, ...]
    differences: tuple[str, ...] = ()
    series: tuple[BaselineSeries, ...]
    identity: GraphIdentity | None = None
    grown: tuple[str, ...] = ()

    def find(self, at_hz: float | None, monitor: str | None, metric: str) -> BaselineSeries:
        """A metric; without values if the baseline does not have it."""
        for series in self.series:
            if (series.at_hz, series.monitor, series.metric) == (at_hz, monitor, metric):
                return series
        return BaselineSeries(at_hz=at_hz, monitor=monitor, metric=metric, values=())


def read_baseline(folder: Path) -> BaselineRecord | None:
    """The baseline of a run folder; None if the run was not compared.

    Raises:
        RecordError: the file is damaged.
    """
    return RUN_FILES.optional(folder / BASELINE_FILE, BaselineRecord)


def read_confirmation(folder: Path) -> Run | None:
    """The confirmation run; None if there is none.

    Raises:
        RecordError: it cannot be read.
    """
    path = folder / CONFIRMATION_FOLDER
    return open_run(path) if (path / "record.json").exists() else None
