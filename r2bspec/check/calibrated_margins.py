"""Margins of the baseline that are narrower than the noise which was calibrated beside the spec."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from r2bspec.check.check_context import Context
from r2bspec.check.requirement_metrics import Known, known_metrics
from r2bspec.measure.units import show
from r2bspec.record.calibration_file import Calibration, MetricNoise

_NUMBER = re.compile(r"\s*(?P<number>[0-9.]+)\s*%")
_STEP = 0.5
"""Percent: limits are proposed in steps of half a percent."""


WIDEST = math.log(1.5)
"""A margin that lets a graph get slower by more than half is none."""


@dataclass(frozen=True)
class Narrow:
    """A requirement whose margin is below the noise.

    Attributes:
        margin: its own, as a ratio to 1: 0.03 is 3 %.
        least: the smallest that can be held on the noisiest machine.
        pairs: how many pairs the spec compares.
        proposed: the limit that can be held, such as ``104.5 %``; empty where that would be so wide
            that it means nothing.
        part: offset and length of the limit in the text of the requirement.
    """

    known: Known
    calibration: Calibration
    noise: MetricNoise
    margin: float
    least: float
    pairs: int
    proposed: str
    part: tuple[int, int]

    @property
    def told(self) -> str:
        """What the pairs of the spec can tell, such as ``10 pairs tell no less than 4.2 %``."""
        pairs = "1 pair tells" if self.pairs == 1 else f"{self.pairs} pairs tell"
        if not self.proposed:
            return f"{pairs} not even a change by half"
        return f"{pairs} no less than {show(self.least, 'share')}"


def narrow_margins(context: Context) -> Iterator[Narrow]:
    """The margins that no machine which was calibrated can hold, worst machine first."""
    hosts = context.noise.benchmarks.get(context.loaded.id, {}) if context.noise else {}
    pairs = context.spec.benchmark.iterations
    for known in known_metrics(context):
        found = [
            narrow
            for calibration in hosts.values()
            for noise in calibration.metrics
            if (narrow := _narrow(known, calibration, noise, pairs)) is not None
        ]
        if found:
            yield max(found, key=lambda each: each.least)


def _narrow(
    known: Known, calibration: Calibration, noise: MetricNoise, pairs: int
) -> Narrow | None:
    placed = known.placed
    requirement, bound = placed.requirement, placed.requirement.bound
    if bound is None or not bound.of_baseline or requirement.windows_share is not None:
        return None
    if requirement.op not in {"<", "<=", ">", ">="} or bound.value <= 0:
        return None
    at_hz = placed.at.hz if placed.at is not None else None
    if (noise.metric, noise.at_hz) != (known.info.name, at_hz):
        return None
    if known.monitor is not None and noise.monitor != known.monitor:
        return None
    ceiling = requirement.op in {"<", "<="}
    margin = math.log(bound.value) * (1 if ceiling else -1)
    least = noise.margin(pairs)
    # A bound on the other side of 1 asks for an improvement, of which noise says nothing.
    if least is None or margin < 0 or margin >= least:
        return None
    written = _NUMBER.match(requirement.text, requirement.bound_column)
    if written is None:
        return None
    return Narrow(
        known=known,
        calibration=calibration,
        noise=noise,
        margin=abs(bound.value - 1),
        least=abs(math.exp(least if ceiling else -least) - 1),
        pairs=pairs,
        proposed=limit_text(least, ceiling=ceiling) if least <= WIDEST else "",
        part=(written.start("number"), written.end() - written.start("number")),
    )


def limit_text(margin: float, *, ceiling: bool) -> str:
    """A limit that leaves a margin, given as a logarithm, rounded away from 100 %."""
    percent = 100 * math.exp(margin if ceiling else -margin)
    steps = math.ceil(percent / _STEP) if ceiling else math.floor(percent / _STEP)
    return f"{steps * _STEP:g} %"
