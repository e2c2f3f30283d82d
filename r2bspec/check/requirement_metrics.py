"""What the metrics of a spec's requirements mean, by the catalogue of `r2bspec.measure`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from r2bspec.check.check_context import Context
from r2bspec.check.spec_requirements import Placed
from r2bspec.measure.errors import MetricError
from r2bspec.measure.metric_catalogue import MetricInfo, resolve


@dataclass(frozen=True, slots=True)
class Known:
    """A requirement whose metric exists; `monitor` is None where it belongs to no single one."""

    placed: Placed
    monitor: str | None
    info: MetricInfo


@dataclass(frozen=True, slots=True)
class Unknown:
    """A requirement whose metric, or the monitor before it, does not exist."""

    placed: Placed
    error: MetricError


def known_metrics(context: Context) -> Iterator[Known]:
    """The requirements whose metric exists."""
    for each in _resolved(context):
        if isinstance(each, Known):
            yield each


def unknown_metrics(context: Context) -> Iterator[Unknown]:
    """The others."""
    for each in _resolved(context):
        if isinstance(each, Unknown):
            yield each


@lru_cache(maxsize=1)  # many rules ask, one after the other, about the same spec
def _resolved(context: Context) -> tuple[Known | Unknown, ...]:
    return tuple(_resolve_all(context))


def _resolve_all(context: Context) -> Iterator[Known | Unknown]:
    for placed in context.requirements:
        try:
            monitor, info = resolve(
                placed.requirement.metric, context.spec.monitors, context.processes
            )
        except MetricError as error:
            yield Unknown(placed, error)
        else:
            yield Known(placed, monitor, info)
