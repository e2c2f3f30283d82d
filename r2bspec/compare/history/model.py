"""An entry of a history."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class HistoryMetric:
    """A metric of a whole run: the mean of its iterations, in its SI unit.

    Attributes:
        at_hz: the offered rate; None for the whole run.
        monitor: None for a metric without one.
        value: None where an iteration had none.
    """

    at_hz: float | None
    monitor: str | None
    metric: str
    unit: str
    value: float | None


@dataclass(frozen=True, kw_only=True)
class HistoryEntry:
    """One run.

    Attributes:
        host: fingerprint of the kind of machine (`r2bspec.record.graph_identity`).
        machine: a description of it.
        plan: hash of what was measured (`r2bspec.plan.comparability.measured_hash`).
        dataset: hash of the recorded data.
        outcome: of the verdict. A run that failed is no baseline for the next, unless `accepted`.
        started_at: ISO 8601, UTC.
        identity: what the graph was made of: `GraphIdentity` as JSON; empty if not known. Runs of
            other code are what a run is compared with, so that it does not select them.
    """

    run_id: str
    name: str
    started_at: str
    host: str
    machine: str
    plan: str
    dataset: str
    version: str
    outcome: str
    accepted: bool = False
    identity: str = ""
    metrics: tuple[HistoryMetric, ...] = ()
