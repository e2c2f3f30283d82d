"""Runs that are steady, and runs of which a part differs: in how many is such a part found?

A run is one of `simulated_starts`, of 75 messages an iteration: the default of 2.5 s, at 30 Hz. A
change is one of the time that messages take, on top of what a steady world does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from simulated_gates import Values
from simulated_starts import Shape, StartWorld

from r2bspec.judge.steady_state import IterationLevel, UnsteadyPart, find_unsteady_part
from simulated_runs import RATE_HZ

World = Callable[[np.random.Generator, Shape], Values]
Change = Callable[[Values, Shape], Values]

PLAYED = Shape(starts=5, iterations=2, messages=75)


def _collecting(random: np.random.Generator, shape: Shape) -> Values:
    """Each 50th message takes nine times as long."""
    first = random.integers(0, 50, (shape.pieces, 1))
    places = first + np.arange(shape.messages)
    return np.asarray(NOISY.run(random, shape) + 8.0 * (places % 50 == 0))


def _bimodal(random: np.random.Generator, shape: Shape) -> Values:
    """Every other message, by chance, takes 1.6 times as long."""
    slow = random.random((shape.pieces, shape.messages)) < 0.5
    return np.asarray(NOISY.run(random, shape) * np.where(slow, 1.6, 1.0))


def _starts(share: float) -> World:
    return StartWorld(start=share, iteration=0.01).run


NOISY = StartWorld(start=0.01, iteration=0.01)

STEADY: dict[str, World] = {
    "starts differ by 1 %": _starts(0.01),
    "starts differ by 2.7 %": _starts(0.027),
    "starts differ by 5 %": _starts(0.05),
    "starts differ by 10 %": _starts(0.1),
    "iterations differ by 2.7 %": StartWorld(iteration=0.027).run,
    "messages resemble (0.95)": StartWorld(message_memory=0.95).run,
    "iterations resemble (0.5), 5 %": StartWorld(iteration=0.05, iteration_memory=0.5).run,
    "each 50th message takes 9 times as long": _collecting,
    "half of all messages take 1.6 times as long": _bimodal,
    "stalls of 20 messages": StartWorld(burst=20).run,
    "1 start in 5 is slow": StartWorld(slow_starts=0.2).run,
    "skewed messages (log-normal)": StartWorld(skewed=True).run,
}


def _longer(places: Callable[[Shape], slice], values: Values, shape: Shape) -> Values:
    changed = values.copy()
    changed[places(shape)] *= 1.5
    return changed


def _climb(rows: Callable[[Shape], int], values: Values, shape: Shape) -> Values:
    """From 1 to 1.27 times in each of so many parts of the run."""
    parts = values.reshape(rows(shape), -1)
    return np.asarray((parts * np.linspace(1.0, 1.27, parts.shape[1])).reshape(values.shape))


CHANGES: dict[str, Change] = {
    "first iteration of each start 50 % slower": partial(
        _longer, lambda shape: slice(None, None, shape.iterations)
    ),
    "climb of 27 % in each start": partial(_climb, lambda shape: shape.starts),
}


def unsteady_part(values: Values, shape: Shape) -> UnsteadyPart | None:
    """What is found in a run."""
    length_s, counted = shape.messages / RATE_HZ, math.ceil(0.9 * shape.messages)
    return find_unsteady_part(
        [
            IterationLevel(start, length_s * place, math.log(np.sort(row)[:counted].mean()))
            for place, (start, row) in enumerate(zip(shape.numbers, values, strict=True))
        ]
    )


def share_found(
    world: World, change: Change | None = None, *, shape: Shape = PLAYED, runs: int
) -> float:
    """The share of runs in which a part is found that differs."""
    random = np.random.default_rng(1)
    found = 0
    for _ in range(runs):
        values = world(random, shape)
        values = change(values, shape) if change is not None else values
        found += unsteady_part(values, shape) is not None
    return found / runs
