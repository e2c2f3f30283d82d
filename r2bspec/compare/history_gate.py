"""Compares a run with earlier ones: a history gates, a stored run is advisory.

Such a run is run, judged, confirmed if it fails, and stored.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import msgspec

from r2bspec.compare import comparison
from r2bspec.compare.history import HistoryEntry, HistoryMetric, open_history
from r2bspec.compare.proposals import prediction_bound
from r2bspec.compare.report_input import open_folder
from r2bspec.judge import baseline_comparison, judge_run
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.measure.anatomy_growth import LEAST_BESIDE, grown_texts
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.samples import RunSamples, starts_of
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.judge.result import Result
from r2bspec.judge.statistics.t_interval import MAX_HISTORY_RUNS
from r2bspec.plan.canonical_json import plan_hash
from r2bspec.plan.comparability import measured_hash
from r2bspec.plan.plan import Plan
from r2bspec.record import baseline_file, graph_identity
from r2bspec.record.files import RecordError, to_json, write_atomically
from r2bspec.record.run_folder import Run, RunFolder, open_run
from r2bspec.record.run_record import RunRecord
from r2bspec.safe_io.safe_file import is_folder


def history_entry(run: Run, result: Result) -> HistoryEntry:
    """The entry of a run in a history."""
    samples = read_samples(run)
    return HistoryEntry(
        run_id=run.record.run_id,
        name=run.plan.name,
        started_at=run.record.started_at,
        host=graph_identity.fingerprint(run.record.machine),
        machine=graph_identity.describe_machine(run.record.machine),
        plan=measured_hash(run.plan),
        dataset=_dataset(run.record),
        version=run.record.versions.get("r2bspec", ""),
        outcome=result.verdict.outcome,
        identity=graph_identity.encode_identity(run.record.identity),
        metrics=tuple(
            HistoryMetric(
                at_hz=at_hz,
                monitor=monitor,
                metric=info.name,
                unit=info.unit,
                value=baseline_comparison.run_value(info, monitor, at_hz, samples),
            )
            for at_hz, monitor, info in baseline_comparison.tracked_metrics(run, samples)
        ),
    )


def baseline_from_history(path: Path, run: Run) -> baseline_file.BaselineRecord:
    """The earlier runs that a run may be compared with; possibly none.

    Raises:
        HistoryError: the history cannot be read.
    """
    with open_history(path, create=True) as history:
        entries = history.comparable_runs(
            graph_identity.fingerprint(run.record.machine),
            measured_hash(run.plan),
            _dataset(run.record),
            MAX_HISTORY_RUNS,
        )
    entries = tuple(one for one in entries if one.run_id != run.record.run_id)
    values: dict[tuple[float | None, str | None, str], list[float | None]] = {}
    for number, entry in enumerate(entries):
        for stored in entry.metrics:
            column = values.setdefault(
                (stored.at_hz, stored.monitor, stored.metric), [None] * len(entries)
            )
            column[number] = stored.value
    return baseline_file.BaselineRecord(
        kind="history",
        source=str(path),
        run_ids=tuple(entry.run_id for entry in entries),
        series=tuple(
            baseline_file.BaselineSeries(
                at_hz=at_hz, monitor=monitor, metric=metric, values=tuple(column)
            )
            for (at_hz, monitor, metric), column in values.items()
        ),
        identity=graph_identity.decode_identity(entries[-1].identity) if entries else None,
    )


def baseline_from_stored_run(
    path: Path, plan: Plan, machine: Mapping[str, Any], *, force: bool
) -> baseline_file.BaselineRecord:
    """A stored run as the baseline of a run that is about to be made.

    Args:
        path: a run folder, that of a comparison (its head counts), a ``result.json``, or a report
            of ros2_benchmark.
        plan: of the new run.
        machine: of the new run.
        force: compare even with differences in load, data or machine. Graphs may differ in any
            case: the record names the differences.

    Raises:
        IncomparableError: load, data or machine differ.
        RecordError: a folder is not a run folder.
        UnreadableResultError: a file is none of these.
    """
    stored = comparison.read_compared_result(path)
    coming = comparison.ComparedResult(
        side=comparison.ComparedSource(source="this run", name=plan.name, run_id="", started_at=""),
        series={},
        plan=plan if stored.plan is not None else None,
        plan_hash=plan_hash(plan),
        dataset=plan.dataset.sha256 or stored.dataset,
        machine=dict(machine),
    )
    differences = comparison.require_comparable(stored, coming, force=force)
    series = {key: (values.values, values.starts) for key, values in stored.series.items()}
    if stored.samples is not None:
        series |= _required_values(stored.samples, plan)
    return baseline_file.BaselineRecord(
        kind="stored",
        source=str(path),
        run_ids=(stored.side.run_id,),
        differences=differences,
        series=tuple(
            baseline_file.BaselineSeries(
                at_hz=at_hz, monitor=monitor or None, metric=metric, values=values, starts=starts
            )
            for (at_hz, monitor, metric), (values, starts) in series.items()
        ),
        identity=stored.identity,
    )


def _required_values(
    samples: RunSamples, plan: Plan
) -> dict[comparison.SeriesKey, tuple[tuple[float | None, ...], tuple[int, ...]]]:
    """The metrics that the requirements of a plan name, in the iterations of a stored run.

    With each, the starts of the iterations.
    """
    return {
        (at_hz, monitor or "", info.name): (
            tuple(
                value if value is not None and math.isfinite(value) else None
                for value in baseline_comparison.iteration_values(info, monitor, at_hz, samples)
            ),
            starts_of(samples.iterations_at(at_hz)),
        )
        for at_hz, monitor, info in baseline_comparison.required_metrics(plan, samples)
    }


def write_baseline(folder: Path, baseline: baseline_file.BaselineRecord) -> None:
    """Write the baseline into the folder of the run that is compared with it.

    Raises:
        RecordError: the file cannot be written.
    """
    write_atomically(folder / baseline_file.BASELINE_FILE, to_json(baseline))


def add_to_history(path: Path, run: Run, result: Result) -> bool:
    """Add a run to a history, unless it is invalid or incomplete.

    Returns:
        Whether it was added.

    Raises:
        HistoryError: the history cannot be written.
    """
    if result.verdict.outcome in {"invalid", "incomplete"}:
        return False
    with open_history(path, create=True) as history:
        history.add(history_entry(run, result))
    return True


def _dataset(record: RunRecord) -> str:
    return str(record.dataset.get("sha256") or record.dataset.get("source") or "")


_GROWN_CONFIDENCE = 0.999
"""Of a hundred parts that did not grow, one is named in every ten runs."""

_LEAST_GROWTH = 0.03

_FOLLOWING = frozenset({"wait", "path"})


def grown_since(baseline: baseline_file.BaselineRecord, run: Run) -> tuple[str, ...]:
    """The parts of nodes and topics that grew from earlier runs to one, those first that grew most.

    A stored run is compared message by message, if it is still there; of a history the means of the
    runs are known, and a part has grown if it is beyond what one more run would have. Nothing
    without an observation from inside on both sides.

    Raises:
        RecordError: a file of the run is missing or damaged.
    """
    if not run.record.anatomies:
        return ()
    if baseline.kind == "history":
        return tuple(_grown_since_history(baseline, run))
    try:
        path = Path(baseline.source)
        earlier = open_folder(path) if is_folder(path) else None
    except RecordError:
        return ()
    return grown_texts(earlier, run) if earlier is not None else ()


_seconds = attrgetter("seconds")


@dataclass(frozen=True)
class _Growth:
    """By how much a part grew since the earlier runs, and what would be more than their scatter."""

    subject: str
    family: str
    at: str
    seconds: float
    least: float

    @property
    def text(self) -> str:
        grown = show(self.seconds, "s", digits=2)
        return f"{self.subject}: {self.family} +{grown}{self.at}"


def _growths(baseline: baseline_file.BaselineRecord, run: Run) -> Iterator[_Growth]:
    samples = read_samples(run)
    for at_hz, monitor, info in baseline_comparison.tracked_metrics(run, samples):
        if info.scope != "anatomy" or info.part not in baseline_comparison.GROWTH_PARTS:
            continue
        values = baseline.find(at_hz, monitor, info.name).values
        before = [value for value in values if value is not None]
        new = baseline_comparison.run_value(info, monitor, at_hz, samples)
        # A transport without a duration has no logarithm.
        if new is None or min(before, default=0.0) <= 0:
            continue
        bound = prediction_bound(before, _GROWN_CONFIDENCE)
        if bound is None:
            continue
        mean = math.fsum(before) / len(before)
        at = f" {at_rate(at_hz)}" if at_hz and len(samples.iterations) > 1 else ""
        family = info.series.rpartition(".")[2]
        least = max(bound - mean, _LEAST_GROWTH * mean)
        yield _Growth(info.subject, family, at, new - mean, least)


def _grown_since_history(baseline: baseline_file.BaselineRecord, run: Run) -> Iterator[str]:
    growths = [*_growths(baseline, run)]
    causes = (each.seconds for each in growths if each.family not in _FOLLOWING)
    largest = max(causes, default=0.0)
    found = [each for each in growths if each.seconds > max(each.least, LEAST_BESIDE * largest)]
    # A node that takes longer lets its messages wait, and makes the whole path longer.
    found = [each for each in found if each.family not in _FOLLOWING] or found
    # The mean of a part comes after its median, and is said where both grew.
    named = {(each.subject, each.family, each.at): each for each in found}
    yield from (each.text for each in sorted(named.values(), key=_seconds, reverse=True))


def unnamed_growth(baseline: baseline_file.BaselineRecord, run: Run) -> tuple[str, ...]:
    """Why no part is named that grew since a history, a clause; nothing where no part did grow.

    Raises:
        RecordError: a file of the run is missing or damaged.
    """
    grown = [each for each in _growths(baseline, run) if each.seconds > 0]
    causes = [each for each in grown if each.family not in _FOLLOWING] or grown
    if not causes:
        return ()
    most = max(causes, key=_seconds)
    scatter = f"the scatter of {len(baseline.run_ids)} earlier runs"
    named_from = show(most.least, "s", digits=2)
    return (f"no part grew beyond {scatter} ({most.text}, named from +{named_from})",)


RunPlan = Callable[[RunFolder, Plan], Result]
"""Runs a plan, into a folder."""


def run_with_baseline(
    run_plan: RunPlan,
    plan: Plan,
    folder: RunFolder,
    *,
    history: Path | None,
    stored: baseline_file.BaselineRecord | None,
) -> Result:
    """Run a benchmark and judge it by earlier runs.

    Args:
        run_plan: makes a run.
        plan: of the run.
        folder: of the run.
        history: gates the run, and stores it.
        stored: advisory, where there is no history.

    Raises:
        HistoryError: the history cannot be used; this is checked before the run.
        RunError: the run failed.
    """
    if history is not None:
        with open_history(history, create=True):
            pass
    result = run_plan(folder, plan)
    baseline = baseline_from_history(history, open_run(folder.path)) if history else stored
    if baseline is None:
        return result
    grown = grown_since(baseline, open_run(folder.path))
    baseline = msgspec.structs.replace(baseline, grown=grown)
    write_baseline(folder.path, baseline)
    result = _judge(folder)
    is_open = any(
        requirement.method == "prediction interval"
        and requirement.outcome != "pass"
        and not requirement.learning
        for requirement in result.verdict.requirements
    )
    if is_open and not grown and (unnamed := unnamed_growth(baseline, open_run(folder.path))):
        write_baseline(folder.path, msgspec.structs.replace(baseline, grown=unnamed))
        result = _judge(folder)
    if baseline_comparison.fails_by_history(result.verdict) and plan.gate.confirm:
        # The second run confirms the comparison with the history only.
        once = msgspec.structs.replace(plan.gate, confirm=False)
        with RunFolder.create(folder.path / baseline_file.CONFIRMATION_FOLDER) as confirmation:
            run_plan(confirmation, msgspec.structs.replace(plan, gate=once))
        result = _judge(folder)
    if history is not None:
        add_to_history(history, open_run(folder.path), result)
    return result


def _judge(folder: RunFolder) -> Result:
    result = result_of(open_run(folder.path))
    folder.write_result(judge_run.to_json(result))
    return result
