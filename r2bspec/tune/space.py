"""The combinations of values that a search may try, and which to try next.

A combination has a place for each path of ``tune.values``: 0 is the value of the spec, 1 the first
of those that are listed. It is put into the spec as ``--set`` does it, so a combination is checked
and compiled by the same code as every spec.

First every listed value alone is proposed, in at most half of the trials: most graphs depend on a
few keys, and a value that breaks the graph shows it alone. Then Optuna's tree-structured Parzen
estimator (Bergstra et al., "Algorithms for hyper-parameter optimization", NIPS 2011) proposes, with
the furthest miss of a limit as its constraint. No combination is proposed twice: the noise of a
start is met by further starts of the best (`r2bspec.tune.search`).
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from r2bspec.diagnostics.diagnostic import format_path
from r2bspec.language.variables import parse_path

if TYPE_CHECKING:
    from optuna import Trial
    from optuna.distributions import BaseDistribution

Combination = tuple[int, ...]

TODAY: Final = "today's"
"""What the combination without a change is called."""


@dataclass(frozen=True)
class Space:
    """The values to try, by the paths of their keys."""

    values: Mapping[str, Sequence[Any]]

    @property
    def sizes(self) -> tuple[int, ...]:
        """The number of values of each path, including that of the spec."""
        return tuple(1 + len(values) for values in self.values.values())

    @property
    def today(self) -> Combination:
        """The combination of the spec as it is."""
        return (0,) * len(self.values)

    def changes(self, combination: Combination) -> dict[str, Any]:
        """Return the values that differ from the spec, by path."""
        return {
            path: values[place - 1]
            for (path, values), place in zip(self.values.items(), combination, strict=True)
            if place
        }

    def single_changes(self) -> list[Combination]:
        """Return every listed value alone: the first of each path before the second of any."""
        return [
            tuple(place if path == changed else 0 for path in range(len(self.sizes)))
            for place in range(1, max(self.sizes, default=1))
            for changed, size in enumerate(self.sizes)
            if place < size
        ]


def assignments(changes: Mapping[str, Any]) -> list[str]:
    """Return the changes in the form of ``--set``."""
    return [f"{path}={json.dumps(value, ensure_ascii=False)}" for path, value in changes.items()]


def changes_text(changes: Mapping[str, Any], paths: Iterable[str]) -> str:
    """Return the changes in one line, with the shortest unambiguous ends of `paths`."""
    names = _short_names(paths)
    texts = (f"{names[path]} {value_text(value)}" for path, value in changes.items())
    return ", ".join(texts) or TODAY


def value_text(value: object) -> str:
    """Return a value as a user writes it."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _short_names(paths: Iterable[str]) -> dict[str, str]:
    steps = {path: parse_path(path) for path in paths}
    names = {}
    for path, own in steps.items():
        length = 1
        while sum(own[-length:] == other[-length:] for other in steps.values()) > 1:
            length += 1
        names[path] = format_path(own[-length:])
    return names


_STARTUP_TRIALS: Final = 8
"""Trials before the estimator has a model; the single changes are among them."""

_ASKED_AGAIN: Final = 20
"""How often the estimator may propose what was tried, before the next combination is taken."""

MAX_EXCESS: Final = 3.0
"""The excess of what does not work, and the largest of what does."""


class Proposals:
    """The combinations to try, each once; that of today is known.

    Args:
        space: the space of all combinations.
        trials: that are planned.
    """

    def __init__(self, space: Space, trials: int) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._study = optuna.create_study(
            sampler=optuna.samplers.TPESampler(
                seed=0, multivariate=True, n_startup_trials=_STARTUP_TRIALS
            )
        )
        self._distributions: dict[str, BaseDistribution] = {
            str(path): optuna.distributions.CategoricalDistribution(range(size))
            for path, size in enumerate(space.sizes)
        }
        self._rest = itertools.product(*map(range, space.sizes))
        self._first = space.single_changes()[: trials // 2]
        self._results: dict[Combination, tuple[float, float]] = {}
        self._asked: dict[Combination, Trial] = {}

    def next(self) -> Combination | None:
        """Return a combination that was not tried; None if all were."""
        while self._first:
            if (combination := self._first.pop(0)) not in self._results:
                return combination
        for _ in range(_ASKED_AGAIN):
            trial = self._study.ask(fixed_distributions=self._distributions)
            combination = tuple(trial.params[name] for name in self._distributions)
            if combination not in self._results:
                self._asked[combination] = trial
                return combination
            # The estimator has to learn again what it proposes again, or it would do so for ever.
            self._end(trial, combination)
        return next((one for one in self._rest if one not in self._results), None)

    def tell(self, combination: Combination, cost: float | None, excess: float) -> None:
        """Record the result of a trial.

        Args:
            combination: the combination that was tried.
            cost: the cost that was measured; None where it did not work.
            excess: the excess over the limit that it misses most; at most 0 if it keeps all.
        """
        known = [cost for cost, _ in self._results.values()]
        broken = 2 * max(known, default=1.0), MAX_EXCESS
        self._results[combination] = broken if cost is None else (cost, excess)
        trial = self._asked.pop(combination, None)
        if trial is None:
            self._study.enqueue_trial(dict(zip(self._distributions, combination, strict=True)))
            trial = self._study.ask(fixed_distributions=self._distributions)
        self._end(trial, combination)

    def _end(self, trial: Trial, combination: Combination) -> None:
        cost, excess = self._results[combination]
        trial.set_constraint("excess", excess)
        self._study.tell(trial, cost)
