"""The result of a run, as ``result.json`` holds it and every report shows it."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from r2bspec.measure.model import RunMetrics
from r2bspec.record.model import FloorRecord, ProcessRecord
from r2bspec.slo.model import Verdict
from r2bspec.spec.model import Scalar


class ObjectiveText(msgspec.Struct, frozen=True, kw_only=True):
    """An objective as the user wrote it; `at` is empty for the search as a whole."""

    at: str
    require: tuple[str, ...]


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that a run came to: metrics and verdict, and what they rest on.

    Attributes:
        status: how the run itself went; `reason` says why, where it is not complete.
        plan_hash: names the plan that was carried out.
        floor: what harness and transport take with nothing under test; contained in every
            latency, and never subtracted.
        dataset: the recorded messages that were played, with their hash.
        machine: where the run was made.
        versions: what took part, by name.
        spec: the spec with every substitution done, as YAML.
        judged_by: the name of the other spec whose objectives were judged, or empty where they
            are the run's own.
        objectives: what was judged.
    """

    r2bspec_result: Literal[1] = 1
    name: str
    title: str
    labels: dict[str, Scalar]
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
    spec: str
    judged_by: str
    objectives: dict[str, ObjectiveText]
    metrics: RunMetrics
    verdict: Verdict
