"""A comparison as frozen values that serialise to JSON."""

from __future__ import annotations

from typing import Literal

import msgspec

Outcome = Literal["improved", "worse", "same", "can't tell"]

ADVICE = (
    "Stored results advise and do not gate: two runs of the same thing on a shared machine differ "
    "by more than their iterations show."
)
"""Said below every comparison, because its intervals do not know of the spread between runs."""


class ComparisonLine(msgspec.Struct, frozen=True, kw_only=True):
    """One metric at one rate.

    Attributes:
        offered_hz: None for the run as a whole.
        base: the metric in the base, in `unit`: the mean of its iterations, or the one value known.
        ratio: head / base; for a drop rate, of the shares that did arrive.
        lower: bound on the true ratio, one-sided, at `confidence` of the comparison; None where
            no spread is known.
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
    """A result that took part: where it was read from, and what it is."""

    source: str
    name: str
    run_id: str
    started_at: str


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """One result against the base.

    Attributes:
        differences: in what else the two differ; not empty only if that was allowed.
    """

    r2bspec_comparison: Literal[1] = 1
    base: ComparedSource
    head: ComparedSource
    confidence: float
    differences: tuple[str, ...]
    lines: tuple[ComparisonLine, ...]
