"""Features of a plan that this version cannot run yet.

`validate` and `plan` accept them; `run` does not. A feature is removed from this module when the
executor supports it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from r2bspec.plan.plan import Plan


class UnsupportedFeature(NamedTuple):
    """A feature of a plan that cannot be run, with its path in the plan."""

    path: str
    what: str


def unsupported_features(plan: Plan) -> list[UnsupportedFeature]:
    """All such features, in the order of the plan's fields; empty if the plan can be run."""
    return [*_harness(plan)]


def _harness(plan: Plan) -> Iterator[UnsupportedFeature]:
    if plan.harness.placement not in {"separate", "shared"}:
        yield UnsupportedFeature("harness.placement", f"placement {plan.harness.placement!r}")
