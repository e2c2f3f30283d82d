"""A comparison as frozen values that serialise to JSON."""

from __future__ import annotations

from typing import Literal

import msgspec

Outcome = Literal["improved", "worse", "same", "can't tell"]

ADVICE = (
    "Comparisons of stored results are advisory: two runs of the same graph on a shared machine "
    "differ by more than their iterations show."
)
"""Printed below every comparison, because its intervals exclude the variation between runs."""


class ComparisonLine(msgspec.Struct, frozen=True, kw_only=True):
    """One metric at one rate.

    Attributes:
        offered_hz: None for the whole run.
        base: the metric in the base, in `unit`: the mean of its iterations, or the only value.
        ratio: head / base; for a drop rate, of the shares that arrived.
        lower: bound on the true ratio, one-sided, at `confidence` of the comparison; None where
            the variation is unknown.
        upper: likewise.
        margin: how far from 1 a ratio may be and still count as the same.
    """

    offered_hz: float | None
    monitor: str
    metric: str
    unit: str
    base: float | None
    head: float | None
    ratio: float | None
    lower: float | None
    upper: float | None
    margin: float
    outcome: Outcome
    reason: str


class ComparedSource(msgspec.Struct, frozen=True, kw_only=True):
    """A result of a comparison: its file or folder, and the run."""

    source: str
    name: str
    run_id: str
    started_at: str


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """One result compared with the base.

    Attributes:
        differences: in plan, data or machine, a line each; those in load, data or machine occur
            only with ``--force``.
    """

    r2bspec_comparison: Literal[1] = 1
    base: ComparedSource
    head: ComparedSource
    confidence: float
    differences: tuple[str, ...]
    lines: tuple[ComparisonLine, ...]
