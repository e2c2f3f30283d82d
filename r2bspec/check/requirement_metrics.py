"""The metrics of requirements, resolved with the catalogue of `r2bspec.measure`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import msgspec

from r2bspec.check.check_context import Context
from r2bspec.check.spec_requirements import LocatedRequirement
from r2bspec.measure.metric_catalogue import MetricError, MetricInfo, resolve


class KnownMetric(msgspec.Struct, frozen=True):
    """A requirement whose metric exists; `monitor` is None if it applies to no single monitor."""

    located: LocatedRequirement
    monitor: str | None
    info: MetricInfo


class UnknownMetric(msgspec.Struct, frozen=True):
    """A requirement whose metric or monitor does not exist."""

    located: LocatedRequirement
    error: MetricError


def known_metrics(context: Context) -> Iterator[KnownMetric]:
    """The requirements whose metric and monitor exist."""
    for each in _resolved_metrics(context):
        if isinstance(each, KnownMetric):
            yield each


def unknown_metrics(context: Context) -> Iterator[UnknownMetric]:
    """The requirements whose metric or monitor does not exist."""
    for each in _resolved_metrics(context):
        if isinstance(each, UnknownMetric):
            yield each


@lru_cache(maxsize=1)  # many rules use it, one after the other, for the same spec
def _resolved_metrics(context: Context) -> tuple[KnownMetric | UnknownMetric, ...]:
    return tuple(_resolve_all(context))


def _resolve_all(context: Context) -> Iterator[KnownMetric | UnknownMetric]:
    for located in context.requirements:
        try:
            monitor, info = resolve(
                located.requirement.metric, context.spec.monitors, context.processes
            )
        except MetricError as error:
            yield UnknownMetric(located, error)
        else:
            yield KnownMetric(located, monitor, info)


def max_wrong_share(each: KnownMetric) -> float | None:
    """The share of messages that may violate the bound; None if no share decides."""
    requirement, info = each.located.requirement, each.info
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
