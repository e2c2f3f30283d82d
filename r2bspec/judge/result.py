"""The result of a run, as ``result.json`` stores it and every report shows it."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from r2bspec.judge.measure.anatomy_summary import AnatomySummary
from r2bspec.judge.measure.metrics import RunMetrics
from r2bspec.judge.verdict import Verdict
from r2bspec.language.spec import Scalar
from r2bspec.record.comparison_folder import PairRecord
from r2bspec.record.graph_identity import GraphIdentity, check_machine_facts
from r2bspec.record.run_record import (
    Difference,
    OutputGapRecord,
    ProcessRecord,
    ProfileRecord,
    StartRecord,
    UnplayedMessages,
)


class ObjectiveText(msgspec.Struct, frozen=True, kw_only=True):
    """An objective as the user wrote it; `at` is empty for the search as a whole."""

    at: str
    require: tuple[str, ...]


class PairsResult(msgspec.Struct, frozen=True, kw_only=True):
    """How base and head were compared, in interleaved runs.

    Attributes:
        against: the base, as the user named it; empty where the head is compared with itself.
        control: whether base and head are the same, so that every difference is noise.
        base_plan: hash of the plan of the base.
        differences: from the plan of the base to that of the head, a line each.
        environment: variables of the base that differ; empty for one that it lacked.
        planned: the largest number of pairs; fewer are played where they decide.
        used: the number of pairs that the verdicts are based on.
        pairs: every pair that was played, with the folders of its runs.
        notes: decisions made during the comparison, a sentence each.
        by_turns: whether a pair is a start of both sides, which were played by turns.
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
    by_turns: bool = False


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a run: metrics and verdict, and what they are based on.

    Attributes:
        status: how the run itself went; `reason` says why, where it is not complete.
        plan_hash: the hash of the plan that was run.
        output_gaps: outputs that stopped, and the node at which their messages end.
        differences: between the running graph and the spec.
        dataset: the recorded messages that were played, with their hash.
        machine: where the run was made.
        versions: the versions of the software involved, by name.
        spec: the spec with every substitution done, as YAML.
        judged_by: the name of the other spec whose objectives and gate counted, or empty where they
            are the run's own.
        objectives: what was judged.
        monitor_labels: the labels of monitors that have one, by monitor.
        pairs: how base and head were compared, if this is a comparison: metrics are then those
            of the head.
        left_out: planned parts that were not played, a sentence each.
        starts: of all processes, with what each took; empty where it is not known.
        unplayed: messages of inputs that were not played.
        profiles: the files of profilers, of an iteration that does not count.
        anatomies: where the messages of an iteration spent their time, at each rate that was
            observed from inside.
        identity: what the graph was made of, with the revision; None where it is not known, or
            was not the same in all runs.
        base_identity: the identity of the base, if this is a comparison.
        changes: from the base to this run, such as ``blur.py changed``; nodes first.
        gate: what the reader has to know of the gate itself, a sentence each.
        load: how the load differs from messages at equal intervals within one machine, in words.
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
    output_gaps: tuple[OutputGapRecord, ...] = ()
    differences: tuple[Difference, ...] = ()
    spec: str
    judged_by: str
    objectives: dict[str, ObjectiveText]
    metrics: RunMetrics
    verdict: Verdict
    pairs: PairsResult | None = None
    left_out: tuple[str, ...] = ()
    starts: tuple[StartRecord, ...] = ()
    unplayed: tuple[UnplayedMessages, ...] = ()
    profiles: tuple[ProfileRecord, ...] = ()
    anatomies: tuple[AnatomySummary, ...] | msgspec.UnsetType = msgspec.UNSET
    load: tuple[str, ...] | msgspec.UnsetType = msgspec.UNSET
    identity: GraphIdentity | None = None
    base_identity: GraphIdentity | None = None
    changes: tuple[str, ...] = ()
    gate: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_machine_facts(self.machine)

    def monitor_title(self, name: str) -> str:
        """Return the title of a monitor: its label and its name, or its name alone."""
        label = self.monitor_labels.get(name, "")
        return f"{label} ({name})" if label and label != name else name
