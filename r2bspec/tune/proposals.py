"""Which deployment to try next: Optuna's tree-structured Parzen estimator proposes, starts decide.

First today's deployment, then levers by themselves, the most promising ones first: most graphs
depend on a few levers, and a lever that breaks the graph shows it alone. After that two proposers
take turns. One adds up the effects that the settings have shown (`expected_best`). The other
is the estimator (Bergstra et al., "Algorithms for hyper-parameter optimization", NIPS 2011), which
knows of settings that act together; the largest excess over a limit is the constraint of a trial.
A deployment is proposed once: its noise is met by the race of the best (`r2bspec.tune.search`), and
not by chance repetitions here.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.plan.tuning_space import Deployment, TuningSpace
from r2bspec.tune.tuning_result import MAX_EXCESS

if TYPE_CHECKING:
    from optuna import Trial as OptunaTrial
    from optuna.distributions import BaseDistribution

_STARTUP_TRIALS: Final = 8
"""Trials before the estimator has a model; the single levers are among them."""

_ASKED_AGAIN: Final = 50
"""How often the estimator may propose what was tried, before chance proposes."""

_BROKEN_COST: Final = 2.0
"""Times the largest cost so far: what a deployment without a cost is said to cost."""

_RIDGE: Final = 0.1
"""Of the regression: a setting that was seen once keeps nine tenths of what it showed."""

_CANDIDATES: Final = 3000
_EXCESS_WEIGHT: Final = 5.0
"""The cost, in logarithms, of each unit of expected excess: 1 % beyond a limit is as bad as 5 %."""

_MARGIN: Final = 0.03
"""The expected excess from which on it counts: effects of single starts are uncertain."""

_LEAST_COST: Final = 1e-9
"""Stands for a cost of nothing, which has no logarithm."""


class Proposals:
    """The deployments to try, in turn; each at most once.

    Args:
        space: of all deployments.
        seed: the same one proposes the same after the same results.
        first: deployments to propose before any other, in this order.
    """

    def __init__(self, space: TuningSpace, seed: int, first: Iterable[Deployment]) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._space = space
        self._chance = np.random.default_rng(seed)
        self._study = optuna.create_study(
            sampler=optuna.samplers.TPESampler(
                seed=seed, multivariate=True, n_startup_trials=_STARTUP_TRIALS
            )
        )
        self._distributions: dict[str, BaseDistribution] = {
            lever.name: optuna.distributions.CategoricalDistribution(range(len(lever.settings)))
            for lever in space.levers
        }
        self._told: dict[Deployment, tuple[float, float]] = {}
        self._asked: dict[Deployment, OptunaTrial] = {}
        self._skipped: set[Deployment] = set()
        self._first = list(dict.fromkeys(first))
        self._turns = 0

    def next(self) -> Deployment | None:
        """A deployment that was not tried; None if there is none."""
        while self._first:
            deployment = self._first.pop(0)
            if self._is_new(deployment):
                return self._ask_for(deployment)
        if len(self._known) >= self._space.size:
            return None
        self._turns += 1
        if self._turns % 2 and (expected := self._expected_best()) is not None:
            return self._ask_for(expected)
        from optuna.trial import TrialState

        for _ in range(_ASKED_AGAIN):
            trial = self._study.ask(fixed_distributions=self._distributions)
            deployment = self._space.deployment(trial.params)
            if self._is_new(deployment):
                self._asked[deployment] = trial
                return deployment
            # So that the estimator does not propose it for ever.
            if deployment in self._asked:
                self._study.tell(trial, state=TrialState.FAIL)
            else:
                self._end(trial, *self._told.get(deployment, (self._broken_cost, MAX_EXCESS)))
        return self._by_chance()

    def skip(self, deployment: Deployment) -> None:
        """A deployment is not tried, because it cannot be the best; or nothing is known of it."""
        self._skipped.add(deployment)
        if (trial := self._asked.pop(deployment, None)) is not None:
            self._end(trial, self._broken_cost, MAX_EXCESS)

    def tell(self, deployment: Deployment, cost: float | None, excess: float) -> None:
        """The result of a trial, of one that was proposed or of any other.

        Args:
            deployment: that was tried.
            cost: that was measured; None where it did not work.
            excess: over the limit that it misses most; at most 0 where it keeps all.
        """
        trial = self._asked.pop(deployment, None)
        if trial is None:
            self._ask_for(deployment)
            trial = self._asked.pop(deployment)
        if cost is None:
            cost, excess = self._broken_cost, MAX_EXCESS
        self._told[deployment] = cost, excess
        self._end(trial, cost, excess)

    @property
    def _known(self) -> set[Deployment]:
        """The deployments that were tried, are being tried, or are not to be."""
        return {*self._told, *self._asked, *self._skipped}

    def _is_new(self, deployment: Deployment) -> bool:
        known = (self._told, self._asked, self._skipped)
        return not any(deployment in each for each in known)

    @property
    def _broken_cost(self) -> float:
        return _BROKEN_COST * max((cost for cost, _ in self._told.values()), default=1.0)

    def _end(self, trial: OptunaTrial, cost: float, excess: float) -> None:
        trial.set_constraint("excess", excess)
        self._study.tell(trial, cost)

    def _ask_for(self, deployment: Deployment) -> Deployment:
        places = {choice.lever: choice.place for choice in deployment.choices}
        self._study.enqueue_trial({name: places.get(name, 0) for name in self._distributions})
        self._asked[deployment] = self._study.ask(fixed_distributions=self._distributions)
        return deployment

    def _expected_best(self) -> Deployment | None:
        worked = {
            deployment: result
            for deployment, result in self._told.items()
            if result[1] < MAX_EXCESS
        }
        return expected_best(self._space, worked, self._known, self._chance)

    def _by_chance(self) -> Deployment | None:
        for _ in range(_ASKED_AGAIN):
            choice = {
                lever.name: int(self._chance.integers(len(lever.settings)))
                for lever in self._space.levers
            }
            if self._is_new(deployment := self._space.deployment(choice)):
                return self._ask_for(deployment)
        return None


def single_levers(space: TuningSpace) -> list[Deployment]:
    """Each setting of each lever by itself, the others being today's.

    The first setting of every lever comes before the second of any.
    """
    singles = [
        space.deployment({lever.name: place})
        for place in range(1, max((len(lever.settings) for lever in space.levers), default=1))
        for lever in space.levers
        if place < len(lever.settings)
    ]
    # A lever that has no effect with today's settings of the others is today's deployment.
    return [deployment for deployment in dict.fromkeys(singles) if deployment.choices]


def expected_best(
    space: TuningSpace,
    tried: Mapping[Deployment, tuple[float, float]],
    known: Collection[Deployment],
    chance: np.random.Generator,
) -> Deployment | None:
    """The deployment with the least expected cost that is not known; None if there is none.

    The logarithm of the cost, and the excess over the limits, are taken to be sums of one effect
    for each setting that differs from today's: most graphs are like that to a first approximation.
    The effects are estimated by ridge regression (Hoerl and Kennard, 1970) from the trials that
    worked. Of many combinations of settings that occurred, the one with the least expected cost is
    proposed; an expected excess counts as cost.

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
