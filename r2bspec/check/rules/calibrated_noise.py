"""Margins of baseline requirements that are narrower than the calibrated noise of a machine."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import msgspec

from r2bspec.check.check_context import Context
from r2bspec.check.requirement_metrics import KnownMetric
from r2bspec.check.rule import Finding, Findings, rule
from r2bspec.diagnostics.quote import quote
from r2bspec.measure.units import show
from r2bspec.record.calibration_file import Calibration, MetricNoise

_NUMBER = re.compile(r"\s*(?P<number>[0-9.]+)\s*%")
_LIMIT_STEP_PERCENT = 0.5
"""Proposed limits are multiples of this, in percent."""

MAX_LOG_MARGIN = math.log(1.5)
"""The widest margin that is proposed: with it, a graph may become 50 % slower."""


class NarrowMargin(msgspec.Struct, frozen=True):
    """A requirement whose margin is below the noise.

    Attributes:
        margin: of the requirement, as a ratio: 0.03 is 3 %.
        min_margin: the smallest detectable margin on the noisiest machine.
        pairs: the number of pairs that the spec compares.
        proposed: a detectable limit, such as ``104.5 %``; empty if its margin would exceed
            MAX_LOG_MARGIN.
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
        """Such as ``10 pairs detect no change below 4.2 %``."""
        pairs = "1 pair detects" if self.pairs == 1 else f"{self.pairs} pairs detect"
        change = show(self.min_margin, "share") if self.proposed else "50 %"
        return f"{pairs} no change below {change}"


@rule("R2B523")
def margin_below_noise(context: Context) -> Findings:
    """Baseline margins below the calibrated noise."""
    for margin in narrow_margins(context):
        noise = margin.calibration
        yield Finding(
            message=f"margin of {quote(margin.known_metric.located.requirement.text)} is "
            f"{show(margin.margin, 'share')}, but {margin.detectable_text} on {noise.machine} "
            f"(calibrated {noise.started_at[:10]})",
            path=margin.known_metric.located.path,
            part=margin.part,
            help=f"{f'write {margin.proposed!r}, ' if margin.proposed else ''}increase "
            "'benchmark.iterations', or find the cause of the noise",
            machine_dependent=True,
        )


@rule("R2B524")
def calibration_file_unusable(context: Context) -> Findings:
    """A calibration file that cannot be used."""
    if context.noise_problem:
        yield Finding(
            message=context.noise_problem,
            path=("slos",),
            key=True,
            help="move it away, then run 'r2bspec calibrate' again",
        )


def narrow_margins(context: Context) -> Iterator[NarrowMargin]:
    """The margins below the noise of a calibrated machine, each with its noisiest machine."""
    hosts = context.noise.benchmarks.get(context.loaded.id, {}) if context.noise else {}
    pairs = context.spec.benchmark.iterations
    for known_metric in context.known_metrics:
        narrow_on_hosts = [
            narrow
            for calibration in hosts.values()
            for noise in calibration.metrics
            if (narrow := _narrow(known_metric, calibration, noise, pairs)) is not None
        ]
        if narrow_on_hosts:
            yield max(narrow_on_hosts, key=lambda margin: margin.min_margin)


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
    # A bound on the other side of 1 requires an improvement, to which noise does not apply.
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
    """The limit with a margin, which is given as a logarithm, rounded away from 100 %."""
    percent = 100 * math.exp(margin if ceiling else -margin)
    steps = (
        math.ceil(percent / _LIMIT_STEP_PERCENT)
        if ceiling
        else math.floor(percent / _LIMIT_STEP_PERCENT)
    )
    return f"{steps * _LIMIT_STEP_PERCENT:g} %"
