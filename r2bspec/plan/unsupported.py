"""What a plan asks for that this version does not carry out yet.

Validating and planning accept it; `r2bspec run` refuses. This is the one place that says so: what
the executor learns is taken out here.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from r2bspec.plan.plan import Plan


class UnsupportedFeature(NamedTuple):
    """A part of a plan that cannot be carried out: where it stands, and what it is."""

    path: str
    what: str


def unsupported_features(plan: Plan) -> list[UnsupportedFeature]:
    """All such parts, in the order of the plan's fields; empty if the plan can be run."""
    return [*_harness(plan)]


def _harness(plan: Plan) -> Iterator[UnsupportedFeature]:
    if plan.harness.kind != "r2bspec":
        yield UnsupportedFeature("harness.kind", f"the harness {plan.harness.kind!r}")
