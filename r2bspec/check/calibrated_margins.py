"""Margins of the baseline that are narrower than the noise which was calibrated beside the spec."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from r2bspec.check.check_context import Context
from r2bspec.check.requirement_metrics import KnownMetric, known_metrics
from r2bspec.measure.units import show
from r2bspec.record.calibration_file import Calibration, MetricNoise

_NUMBER = re.compile(r"\s*(?P<number>[0-9.]+)\s*%")
_LIMIT_STEP_PERCENT = 0.5
"""Percent: limits are proposed in steps of half a percent."""


MAX_LOG_MARGIN = math.log(1.5)
"""A margin that lets a graph get slower by more than half is none."""


@dataclass(frozen=True)
class NarrowMargin:
    """A requirement whose margin is below the noise.

    Attributes:
        margin: its own, as a ratio to 1: 0.03 is 3 %.
        min_margin: the smallest that can be held on the noisiest machine.
        pairs: how many pairs the spec compares.
        proposed: the limit that can be held, such as ``104.5 %``; empty where that would be so wide
            that it means nothing.
        part: offset and length of the limit in the text of the requirement.
    """

    known_metric: KnownMetric
    calibration: Calibration
    noise: MetricNoise
    margin: float
    min_margin: float
    pairs: int
    proposed: str
    part: tuple[int, int]

    @property
    def detectable_text(self) -> str:
        """What the pairs of the spec can tell, such as ``10 pairs tell no less than 4.2 %``."""
        pairs = "1 pair tells" if self.pairs == 1 else f"{self.pairs} pairs tell"
        if not self.proposed:
            return f"{pairs} not even a change by half"
        return f"{pairs} no less than {show(self.min_margin, 'share')}"


def narrow_margins(context: Context) -> Iterator[NarrowMargin]:
    """The margins that no machine which was calibrated can hold, worst machine first."""
    hosts = context.noise.benchmarks.get(context.loaded.id, {}) if context.noise else {}
    pairs = context.spec.benchmark.iterations
    for known_metric in known_metrics(context):
        found = [
            narrow
            for calibration in hosts.values()
            for noise in calibration.metrics
            if (narrow := _narrow(known_metric, calibration, noise, pairs)) is not None
        ]
        if found:
            yield max(found, key=lambda each: each.min_margin)


def _narrow(
    known_metric: KnownMetric, calibration: Calibration, noise: MetricNoise, pairs: int
) -> NarrowMargin | None:
    located = known_metric.located
    requirement, bound = located.requirement, located.requirement.bound
    if bound is None or not bound.of_baseline or requirement.windows_share is not None:
        return None
    if requirement.op not in {"<", "<=", ">", ">="} or bound.value <= 0:
        return None
    at_hz = located.at.hz if located.at is not None else None
    if (noise.metric, noise.at_hz) != (known_metric.info.name, at_hz):
        return None
    if known_metric.monitor is not None and noise.monitor != known_metric.monitor:
        return None
    ceiling = requirement.op in {"<", "<="}
    margin = math.log(bound.value) * (1 if ceiling else -1)
    min_margin = noise.margin(pairs)
    # A bound on the other side of 1 asks for an improvement, of which noise says nothing.
    if min_margin is None or margin < 0 or margin >= min_margin:
        return None
    written = _NUMBER.match(requirement.text, requirement.bound_column)
    if written is None:
        return None
    return NarrowMargin(
        known_metric=known_metric,
        calibration=calibration,
        noise=noise,
        margin=abs(bound.value - 1),
        min_margin=abs(math.exp(min_margin if ceiling else -min_margin) - 1),
        pairs=pairs,
        proposed=limit_text(min_margin, ceiling=ceiling) if min_margin <= MAX_LOG_MARGIN else "",
        part=(written.start("number"), written.end() - written.start("number")),
    )


def limit_text(margin: float, *, ceiling: bool) -> str:
    """A limit that leaves a margin, given as a logarithm, rounded away from 100 %."""
    percent = 100 * math.exp(margin if ceiling else -margin)
    steps = (
        math.ceil(percent / _LIMIT_STEP_PERCENT)
        if ceiling
        else math.floor(percent / _LIMIT_STEP_PERCENT)
    )
    return f"{steps * _LIMIT_STEP_PERCENT:g} %"
