"""Runs of known truth: ten iterations of messages of which a given share is bad.

Every world returns shape (runs, iterations, messages): which messages are over the limit. Whatever
the world, each message is over it with the same probability, but not independently of the others.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import signal, special

Flags = NDArray[np.bool_]
World = Callable[[np.random.Generator, tuple[int, int, int], float], Flags]


def stationary(random: np.random.Generator, shape: tuple[int, int, int], share: float) -> Flags:
    """Independent messages."""
    return random.random(shape) < share


def bursts(length: float) -> World:
    """A two-state Markov chain; bad messages come in bursts of a mean length."""

    def world(random: np.random.Generator, shape: tuple[int, int, int], share: float) -> Flags:
        leave = 1 / length
        enter = leave * share / (1 - share)
        found = np.empty(shape, dtype=np.bool_)
        state = random.random(shape[:2]) < share
        for step in range(shape[2]):
            found[:, :, step] = state
            draw = random.random(shape[:2])
            state = np.where(state, draw >= leave, draw < enter)
        return found

    return world


def autocorrelated(phi: float) -> World:
    """A latent Gaussian AR(1): latencies that remember."""

    def world(random: np.random.Generator, shape: tuple[int, int, int], share: float) -> Flags:
        warm_up = 400
        noise = random.standard_normal((*shape[:2], shape[2] + warm_up))
        latent = signal.lfilter([np.sqrt(1 - phi * phi)], [1, -phi], noise, axis=2)
        return np.asarray(latent[:, :, warm_up:] > special.ndtri(1 - share))

    return world


def drifting(random: np.random.Generator, shape: tuple[int, int, int], share: float) -> Flags:
    """The share climbs from half of what it is on average to one and a half of it."""
    along = np.linspace(0.5, 1.5, shape[1] * shape[2]).reshape(shape[1:])
    return random.random(shape) < share * along


def heavy_tailed(random: np.random.Generator, shape: tuple[int, int, int], share: float) -> Flags:
    """Pareto latencies (infinite variance) whose scale wanders: stochastic volatility."""
    warm_up = 400
    noise = random.standard_normal((*shape[:2], shape[2] + warm_up))
    scale = signal.lfilter([0.3], [1, -0.9], noise, axis=2)[:, :, warm_up:]
    latency = (1 + random.pareto(1.5, shape)) * np.exp(scale)
    return np.asarray(latency > _limit_of_heavy_tails(share))


def _limit_of_heavy_tails(share: float) -> float:
    """The latency that a share of all messages exceeds, by Gauss-Hermite quadrature."""
    nodes, weights = special.roots_hermite(80)
    scales = np.exp(np.sqrt(2) * nodes * 0.3 / np.sqrt(1 - 0.81))

    def exceeded(limit: float) -> float:
        over = np.minimum(1.0, (limit / scales) ** -1.5)
        return float((weights * over).sum() / np.sqrt(np.pi))

    low, high = 1e-3, 1e9
    while high / low > 1 + 1e-9:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if exceeded(middle) > share else (low, middle)
    return low


def uneven(random: np.random.Generator, shape: tuple[int, int, int], share: float) -> Flags:
    """Iterations that differ: the share of each is drawn anew (log-normal, sigma 0.5)."""
    factor = np.exp(0.5 * random.standard_normal((*shape[:2], 1)) - 0.125)
    return random.random(shape) < share * factor


WORLDS: dict[str, World] = {
    "stationary": stationary,
    "drifting": drifting,
    "bursts of 5": bursts(5),
    "bursts of 20": bursts(20),
    "autocorrelated, 0.5": autocorrelated(0.5),
    "autocorrelated, 0.9": autocorrelated(0.9),
    "heavy-tailed": heavy_tailed,
    "uneven iterations": uneven,
}
