"""A history: results of the same benchmarks over time, read from files.

A folder of results is a history; nothing else is stored. Results of different machines, versions,
data, or ways of playing are not compared: a metric has change points only between results of the
same environment.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, Literal

import msgspec
import numpy as np

from r2bspec.compare.comparison import ComparedResult, MetricSeries, SeriesKey, mean_value
from r2bspec.compare.report_input import UnreadableResultError, read_result, require_there
from r2bspec.judge.measure.metric_catalogue import find_metric
from r2bspec.judge.result import Result
from r2bspec.judge.statistics.change_points import change_points
from r2bspec.record.graph_identity import MACHINE_FACTS, revision_text
from r2bspec.record.run_folder import FOLDER_ENTRIES
from r2bspec.safe_io.safe_file import is_folder

_RESULT: Final = "result.json"
_RUN_FILES: Final = frozenset({"record.json", "pairs.json"})


class HistoryResult(msgspec.Struct, frozen=True, kw_only=True):
    """A result of a history.

    Attributes:
        commit: in full; empty where it is not known.
        revision: in few digits, with ``+dirty`` for changes that were not committed.
        environment: the index of its environment.
    """

    source: str
    run_id: str
    started_at: str
    commit: str
    revision: str
    environment: int

    @property
    def called(self) -> str:
        """The revision; without a revision, the time."""
        return self.revision or self.started_at


class Change(msgspec.Struct, frozen=True, kw_only=True):
    """A change point of a metric.

    Attributes:
        before: the last result before it, of the same environment; an index of the results.
        after: the first result with it.
        mean_before: since the change before it, in the unit of the metric.
        mean_after: until the next one.
        confidence: that it is not chance.
        outcome: the outcome of both means.
    """

    before: int
    after: int
    mean_before: float
    mean_after: float
    confidence: float
    outcome: Literal["improved", "worse"]

    @property
    def ratio(self) -> float | None:
        """The growth as a share of the value before; None if that is 0."""
        return self.mean_after / self.mean_before - 1 if self.mean_before else None


class MetricHistory(msgspec.Struct, frozen=True, kw_only=True):
    """The history of a metric at one rate.

    Attributes:
        offered_hz: None for the whole run.
        values: one for each result; None where it has none, or lost messages.
        changes: in the order of time.
    """

    offered_hz: float | None
    monitor: str
    metric: str
    unit: str
    values: tuple[float | None, ...]
    changes: tuple[Change, ...]

    @property
    def last(self) -> float | None:
        """The newest value."""
        return next((value for value in reversed(self.values) if value is not None), None)


class History(msgspec.Struct, frozen=True, kw_only=True):
    """The results of one benchmark, in the order of time.

    Attributes:
        environments: what the results of one have in common, by name.
    """

    name: str
    results: tuple[HistoryResult, ...]
    environments: tuple[dict[str, str], ...]
    metrics: tuple[MetricHistory, ...]

    def first_of(self, environment: int) -> int:
        """Return the index of the first result of an environment."""
        return next(
            place for place, result in enumerate(self.results) if result.environment == environment
        )

    def environment_change(self, index: int) -> str:
        """Return what is new in an environment compared with that of the previous result."""
        first = self.first_of(index)
        if not first:
            return ""
        before = self.environments[self.results[first - 1].environment]
        return ", ".join(_differences(before, self.environments[index]))


def _differences(before: dict[str, str], after: dict[str, str]) -> Iterator[str]:
    for name in before | after:
        old, new = (facts.get(name) or "none" for facts in (before, after))
        if old != new:
            yield f"{name} {old} → {new}"


class HistoryError(UnreadableResultError):
    """There is no result to show."""

    way_out = "Name run folders or result.json files; 'r2bspec judge --write RUN' makes the latter."


def read_histories(paths: Iterable[Path]) -> tuple[list[History], list[str]]:
    """Read the results of files and folders.

    Returns: a history for each benchmark, by name, and a sentence for each file that was left out.

    Raises:
        HistoryError: none of them is a usable result.
        UnreadableResultError: one does not exist.
    """
    results: dict[str, tuple[str, Result]] = {}
    left_out = []
    for path in _files(paths):
        try:
            result = read_result(path)
        except UnreadableResultError as error:
            left_out.append(str(error).partition("\n")[0])
            continue
        if result.status != "complete":
            left_out.append(f"{path} is {result.status}: {result.reason}")
        elif result.run_id not in results:  # artifacts have the result and its report
            results[result.run_id] = str(path), result
    if not results:
        reason = f": {left_out[0]}" if left_out else ""
        raise HistoryError(f"no result was found{reason}")
    named: dict[str, list[tuple[str, Result]]] = {}
    for source, result in sorted(results.values(), key=lambda one: (one[1].started_at, one[0])):
        named.setdefault(result.name, []).append((source, result))
    return [_history(name, named[name]) for name in sorted(named)], left_out


def _files(paths: Iterable[Path]) -> Iterator[Path]:
    """Yield the files that may be results: of a run or a comparison, that of the whole alone."""
    for path in paths:
        require_there(path)
        if not is_folder(path):
            yield path
            continue
        for folder, folders, files in os.walk(path):
            entries = {*folders, *files} - {_RESULT}
            # A run that was not judged is one of the files that are left out.
            is_run = not _RUN_FILES.isdisjoint(files)
            if is_run or (_RESULT in files and not FOLDER_ENTRIES.isdisjoint(entries)):
                folders[:], files = [], [_RESULT]
            folders.sort()
            for name in sorted(files):
                if name.endswith(".json") and (name == _RESULT or name not in FOLDER_ENTRIES):
                    yield Path(folder, name)


def _history(name: str, found: Sequence[tuple[str, Result]]) -> History:
    environments: list[dict[str, str]] = []
    results = []
    series: list[dict[SeriesKey, MetricSeries]] = []
    for source, result in found:
        compared = ComparedResult(source, result)
        facts = _environment(compared)
        if facts not in environments:
            environments.append(facts)
        revision = result.identity.revision if result.identity is not None else None
        results.append(
            HistoryResult(
                source=source,
                run_id=result.run_id,
                started_at=result.started_at,
                commit=revision.commit if revision is not None else "",
                revision=revision_text(revision),
                environment=environments.index(facts),
            )
        )
        series.append(compared.series)
    keys = [*dict.fromkeys(key for values in series for key in values)]
    places = [result.environment for result in results]
    metrics = (_metric(key, [values.get(key) for values in series], places) for key in keys)
    return History(
        name=name,
        results=tuple(results),
        environments=tuple(environments),
        metrics=tuple(metric for metric in metrics if metric.last is not None),
    )


def _environment(compared: ComparedResult) -> dict[str, str]:
    result = compared.result
    machine = {name: str(value) for name in MACHINE_FACTS if (value := result.machine.get(name))}
    # The data as a digest of few digits; how it was played changes what is measured, too.
    if result.pairs is None:
        played = "alone"
    else:
        played = "by turns" if result.pairs.by_turns else "in pairs"
    return {
        **machine,
        **result.versions,
        "data": (compared.dataset or "unknown")[:12],
        "played": played,
    }


def _metric(
    key: SeriesKey, series: Sequence[MetricSeries | None], environments: Sequence[int]
) -> MetricHistory:
    rate, monitor, name = key
    values = [mean_value(one) if one is not None else None for one in series]
    info = find_metric(name)
    changes = []
    for environment in range(max(environments) + 1):
        places = [
            place
            for place, value in enumerate(values)
            if value is not None and environments[place] == environment
        ]
        for point in change_points(np.array([values[place] for place in places], dtype=float)):
            is_more = point.after > point.before
            better = is_more == info.metric.more_is_better
            changes.append(
                Change(
                    before=places[point.place - 1],
                    after=places[point.place],
                    mean_before=point.before,
                    mean_after=point.after,
                    confidence=1 - point.error,
                    outcome="improved" if better else "worse",
                )
            )
    return MetricHistory(
        offered_hz=rate,
        monitor=monitor,
        metric=name,
        unit=next(one.unit for one in series if one is not None),
        values=tuple(values),
        changes=tuple(sorted(changes, key=lambda change: change.after)),
    )
