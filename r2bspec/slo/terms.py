"""What was agreed on before a run, or found out about it, and has a say in its verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from r2bspec.slo.looks import Looks
from r2bspec.slo.model import CONFIDENCE, Level
from r2bspec.slo.severity import Policy


@dataclass(frozen=True)
class Disturbed:
    """An iteration that the machine disturbed.

    Attributes:
        reasons: what disturbed it, in words; at least one.
        rerun: the id of the iteration that was played in its place, or empty.
    """

    reasons: tuple[str, ...]
    rerun: str = ""


@dataclass(frozen=True)
class Terms:
    """Everything that a verdict depends on besides objectives and samples.

    Attributes:
        confidence: of every decision, one-sided each way; the looks have their own.
        looks: when the run was to be looked at; None for a run of a fixed length.
        levels: of objectives, by name; ``error`` where an objective is not among them.
        inconclusive: what an inconclusive requirement does to the run.
        disturbed: the disturbed iterations, by the id of their segment.
    """

    confidence: float = CONFIDENCE
    looks: Looks | None = None
    levels: Mapping[str, Level] = field(default_factory=dict)
    inconclusive: Policy = "inconclusive"
    disturbed: Mapping[str, Disturbed] = field(default_factory=dict)
