"""The effect of each setting, added up: what most graphs are to a first approximation.

The logarithm of the cost, and the excess over the limits, are taken to be sums of one effect for
each setting that differs from today's. The effects are estimated by ridge regression (Hoerl and
Kennard, 1970) from the trials that worked. Of many combinations of settings that occurred, the one
with the least expected cost is proposed; an expected excess counts as cost.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.plan.tuning_space import Deployment, TuningSpace

_RIDGE: Final = 0.1
"""Of the regression: a setting that was seen once keeps nine tenths of what it showed."""

_CANDIDATES: Final = 3000
_EXCESS_WEIGHT: Final = 5.0
"""The cost, in logarithms, of each unit of expected excess: 1 % beyond a limit is as bad as 5 %."""

_MARGIN: Final = 0.03
"""The expected excess from which on it counts: effects of single starts are uncertain."""

_LEAST_COST: Final = 1e-9
"""Stands for a cost of nothing, which has no logarithm."""


def expected_best(
    space: TuningSpace,
    tried: Mapping[Deployment, tuple[float, float]],
    known: Collection[Deployment],
    chance: np.random.Generator,
) -> Deployment | None:
    """The deployment with the least expected cost that is not known; None if there is none.

    Args:
        space: of all deployments.
        tried: cost and excess of those that worked.
        known: not to be proposed.
        chance: draws the combinations.
    """
    if not tried:
        return None
    sizes = [len(lever.settings) for lever in space.levers]
    offsets = np.concatenate(([1], 1 + np.cumsum([size - 1 for size in sizes])))
    rows = np.array([_places(space, deployment) for deployment in tried])
    seen = _columns(rows, offsets)
    costs, excesses = np.array(list(tried.values())).T
    effects = _regression(seen, np.log(np.maximum(costs, _LEAST_COST)))
    over = _regression(seen, excesses)
    drawn = chance.integers(0, sizes, size=(_CANDIDATES, len(sizes)))
    candidates = _columns(drawn, offsets)
    # A setting that never occurred has no effect that anything is known of.
    usual = np.all(candidates <= (seen.sum(axis=0) > 0), axis=1)
    expected = candidates @ effects
    expected += _EXCESS_WEIGHT * np.maximum(0.0, candidates @ over + _MARGIN)
    for place in np.flatnonzero(usual)[np.argsort(expected[usual])]:
        choice = {
            lever.name: int(setting)
            for lever, setting in zip(space.levers, drawn[place], strict=True)
        }
        if (deployment := space.deployment(choice)) not in known:
            return deployment
    return None


def _places(space: TuningSpace, deployment: Deployment) -> list[int]:
    chosen = {choice.lever: choice.place for choice in deployment.choices}
    return [chosen.get(lever.name, 0) for lever in space.levers]


def _columns(places: NDArray[np.int64], offsets: NDArray[np.int64]) -> NDArray[np.float64]:
    """A column of ones, and one for each setting that is not today's; a row for each deployment."""
    found = np.zeros((len(places), int(offsets[-1])))
    found[:, 0] = 1.0
    rows, levers = np.nonzero(places)
    found[rows, offsets[levers] + places[rows, levers] - 1] = 1.0
    return found


def _regression(seen: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    penalty = _RIDGE * np.eye(seen.shape[1])
    penalty[0, 0] = 0.0
    return np.asarray(np.linalg.solve(seen.T @ seen + penalty, seen.T @ values))
