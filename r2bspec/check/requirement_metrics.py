"""Requirements of a spec: every one with its path, and with its metric where that exists."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import msgspec

from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.language.quantities import Rate
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.language.spec import Spec
from r2bspec.measure.metric_catalogue import MetricInfo


class LocatedRequirement(msgspec.Struct, frozen=True):
    """A requirement of an objective, or a condition of the search.

    Attributes:
        objective: the name of the objective; empty for a condition of the search.
        at: the rate of the objective.
        needs_rate: whether the objective has neither a rate nor the peak.
        confidence: the required confidence of its verdicts.
    """

    requirement: Requirement
    path: Path
    role: Literal["objective", "holds"]
    objective: str = ""
    at: Rate | None = None
    needs_rate: bool = False
    confidence: float = CONFIDENCE

    @property
    def metric_part(self) -> tuple[int, int]:
        """Offset and length of the metric in the requirement's text."""
        return (self.requirement.metric_column, len(self.requirement.metric))

    @property
    def bound_part(self) -> tuple[int, int]:
        """Offset and length of the bound in the requirement's text."""
        column = self.requirement.bound_column
        return (column, len(self.requirement.text.rstrip()) - column)

    @property
    def subject(self) -> str:
        """The key of the requirement as a subject of findings."""
        return f"requirement:{self.path}"


def located_requirements(spec: Spec) -> Iterator[LocatedRequirement]:
    """The conditions of the search, then the requirements of all objectives."""
    if spec.benchmark.search is not None:
        for index, requirement in enumerate(spec.benchmark.search.holds):
            yield LocatedRequirement(requirement, ("benchmark", "search", "holds", index), "holds")
    for name, objective in spec.slos.items():
        for index, requirement in enumerate(objective.require):
            yield LocatedRequirement(
                requirement,
                ("slos", name, "require", index),
                "objective",
                name,
                objective.at,
                needs_rate=objective.at is None and not objective.at_peak,
                confidence=(objective.confidence or spec.benchmark.gate.confidence).fraction,
            )


class KnownMetric(msgspec.Struct, frozen=True):
    """A requirement whose metric exists; `monitor` is None if it applies to no single monitor."""

    located: LocatedRequirement
    monitor: str | None
    info: MetricInfo


def max_wrong_share(metric: KnownMetric) -> float | None:
    """The share of messages that may violate the bound; None if no share decides."""
    requirement, info = metric.located.requirement, metric.info
    if requirement.bound is None or requirement.windows_share is not None:
        return None
    if requirement.bound.of_baseline or requirement.op not in {"<", "<=", ">", ">="}:
        return None
    ceiling = requirement.op in {"<", "<="}
    if info.statistic == "percentile" and info.quantile is not None:
        return 1 - info.quantile if ceiling else info.quantile
    if info.statistic == "share":
        return requirement.bound.value if ceiling else 1 - requirement.bound.value
    return None
