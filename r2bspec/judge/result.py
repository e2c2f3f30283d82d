"""The result of a run, as ``result.json`` holds it and every report shows it."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from r2bspec.judge.verdict import Verdict
from r2bspec.language.spec import Scalar
from r2bspec.measure.metrics import RunMetrics
from r2bspec.record.comparison_folder import PairRecord
from r2bspec.record.run_record import Difference, FloorRecord, ProcessRecord, SilenceRecord


class ObjectiveText(msgspec.Struct, frozen=True, kw_only=True):
    """An objective as the user wrote it; `at` is empty for the search as a whole."""

    at: str
    require: tuple[str, ...]


class PairsResult(msgspec.Struct, frozen=True, kw_only=True):
    """How base and head were compared, in interleaved runs.

    Attributes:
        against: what the base is, as the user named it; empty where the head runs against itself.
        control: whether base and head are the same, so that every difference is noise.
        base_plan: names the plan of the base.
        differences: in what it differs from that of the head, a line each.
        environment: the variables that the base had otherwise; empty for one that it lacked.
        planned: how many pairs were asked for.
        used: how many of them the verdicts rest on.
        pairs: every pair that was played, with the folders of its runs.
        notes: what was decided on the way, a sentence each.
    """

    against: str
    control: bool
    base_plan: str
    differences: tuple[str, ...]
    environment: dict[str, str]
    planned: int
    used: int
    pairs: tuple[PairRecord, ...]
    notes: tuple[str, ...]


class BaselineResult(msgspec.Struct, frozen=True, kw_only=True):
    """What earlier runs a run was compared with.

    Attributes:
        kind: a ``history`` decides, a single ``stored`` run only advises.
        source: the file or folder, as the user named it.
        run_ids: of the earlier runs, oldest first.
        differences: in what they differ, a line each; not empty only if that was allowed.
        confirmed: whether a fresh run was made after a failure, which is in the folder
            ``confirm``.
    """

    kind: Literal["history", "stored"]
    source: str
    run_ids: tuple[str, ...]
    differences: tuple[str, ...]
    confirmed: bool


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that a run came to: metrics and verdict, and what they rest on.

    Attributes:
        status: how the run itself went; `reason` says why, where it is not complete.
        plan_hash: names the plan that was carried out.
        floor: what harness and transport take with nothing under test; contained in every
            latency, and never subtracted.
        silences: outputs that stopped, and where their messages stop.
        differences: what of the real graph was not as the spec says.
        dataset: the recorded messages that were played, with their hash.
        machine: where the run was made.
        versions: what took part, by name.
        spec: the spec with every substitution done, as YAML.
        judged_by: the name of the other spec whose objectives were judged, or empty where they
            are the run's own.
        objectives: what was judged.
        monitor_labels: what reports call the monitors that have a label, by name.
        pairs: how base and head were compared, where this is a comparison: metrics are then those
            of the head.
        baseline: the earlier runs that this one was compared with, if it was.
        left_out: what the verdict might have used and was not played, a sentence each.
    """

    r2bspec_result: Literal[1] = 1
    name: str
    title: str
    labels: dict[str, Scalar]
    monitor_labels: dict[str, str] = {}
    run_id: str
    status: Literal["complete", "incomplete", "invalid"]
    reason: str
    started_at: str
    ended_at: str
    plan_hash: str
    dataset: dict[str, Any]
    machine: dict[str, Any]
    versions: dict[str, str]
    processes: tuple[ProcessRecord, ...]
    floor: tuple[FloorRecord, ...] = ()
    silences: tuple[SilenceRecord, ...] = ()
    differences: tuple[Difference, ...] = ()
    spec: str
    judged_by: str
    objectives: dict[str, ObjectiveText]
    metrics: RunMetrics
    verdict: Verdict
    pairs: PairsResult | None = None
    baseline: BaselineResult | None = None
    left_out: tuple[str, ...] = ()

    def monitor_title(self, name: str) -> str:
        """What a heading calls a monitor: its label and its name, or its name alone."""
        label = self.monitor_labels.get(name, "")
        return f"{label} ({name})" if label and label != name else name
