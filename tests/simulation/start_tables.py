"""The tables of errors in a world of worlds; printed by `tables.py`."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from simulated_comparisons import RUN_WORLDS, history_errors, pairs_errors, stored_errors
from simulated_gates import Errors, mean_gate
from simulated_pair_load import LOAD_WORLDS, LoadWorld, PairGate
from simulated_starts import QUANTITIES, WINDOWS, WORLDS, Shape, errors
from simulated_words import SAID, said

from r2bspec.judge.decision_policy import InterimLooks
from r2bspec.judge.statistics.t_interval import mean_interval

RUNS = 1000


def chance(promise: float, runs: int) -> float:
    """What a promised share comes to in so many runs with bad luck: three standard errors more."""
    return promise + 3 * math.sqrt(promise * (1 - promise) / runs)


def held(found: Errors) -> bool:
    """Whether the three shares are what is promised, or more by chance."""
    passed, failed, confirmed = found.shares
    most = chance(0.05, found.runs)
    return passed <= most and failed <= most and confirmed <= chance(0.01, found.runs)


def cell(found: Errors) -> str:
    """The three shares in percent; bold where they are more than is promised."""
    return str(found) if held(found) else f"**{found}**"


def show(title: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    lines = [title, "", f"| {' | '.join(head)} |", f"|{' --- |' * len(head)}"]
    lines += [f"| {' | '.join(map(str, row))} |" for row in rows]
    sys.stdout.write("\n".join(lines) + "\n\n")
    sys.stdout.flush()


def starts() -> None:
    """Every world, a run of 5 starts of 2 iterations of 300 messages."""
    show(
        "5 starts x 2 iterations x 300 messages: wrong passes / fails / confirmed fails, in %",
        ["world", *QUANTITIES],
        ([name, *map(cell, errors(world, runs=RUNS).values())] for name, world in WORLDS.items()),
    )


SHAPES = ((1, 1), (1, 3), (1, 5), (1, 10), (2, 2), (3, 2), (5, 2), (10, 2), (20, 2))
SHAPE_WORLDS = (
    "nothing differs",
    "iterations differ by 2.7 %",
    "iterations resemble (0.5), 5 %",
    "starts differ by 2.7 %",
)


def shapes() -> None:
    """How many starts and iterations are needed, by 3,000 messages a run."""

    def row(starts: int, iterations: int, quantity: str) -> Iterable[object]:
        yield f"{starts} x {iterations}, {quantity}"
        for name in SHAPE_WORLDS:
            shape = Shape(starts, iterations, 3000 // (starts * iterations))
            if quantity == "mean, throughput" and shape.pieces == 1:
                yield "open"
            else:
                yield cell(errors(WORLDS[name], (quantity,), shape=shape, runs=500)[quantity])

    show(
        "Starts x iterations, 3,000 messages in all: the same",
        ["starts x iterations", *SHAPE_WORLDS],
        ([*row(*shape, quantity)] for quantity in ("p50", "mean, throughput") for shape in SHAPES),
    )


def looked_starts() -> None:
    """Looks after 5, 10 and 20 starts."""
    looks = InterimLooks((10, 20, 40))
    names = ("nothing differs", "starts differ by 2.7 %", "iterations resemble (0.5), 5 %")
    show(
        "Looks after 5, 10 and 20 starts of 2 iterations x 75 messages: the same",
        ["world", "p50", "p90", "mean, throughput"],
        (
            [
                name,
                *map(
                    cell,
                    errors(
                        WORLDS[name],
                        ("p50", "p90", "mean, throughput"),
                        shape=Shape(20, 2, 75),
                        looks=looks,
                        runs=RUNS,
                    ).values(),
                ),
            ]
            for name in names
        ),
    )


def comparisons() -> None:
    """Base against head, in pairs and with a history."""
    show(
        "A against A, ratio and limit 1: wrong passes / fails / confirmed fails, in %",
        ["world", "5 pairs", "10 pairs", "history of 5", "of 10", "of 30"],
        (
            [
                name,
                *(cell(pairs_errors(world, pairs=n, runs=2 * RUNS)) for n in (5, 10)),
                *(cell(history_errors(world, history=n, runs=2 * RUNS)) for n in (5, 10, 30)),
            ]
            for name, world in RUN_WORLDS.items()
        ),
    )


def care() -> None:
    """What it costs where iterations are independent that they might not be."""
    random = np.random.default_rng(1)

    def found(m: int, errors_off: float) -> str:
        values = random.normal(1, 0.02, (2 * RUNS, m)) + errors_off * 0.02 / math.sqrt(m)
        alone = np.mean([mean_interval(run, 0.95).lower >= 1 for run in values.tolist()])
        judged = mean_gate(values, 1.0).failed
        return f"{100 * alone:.0f} / {100 * judged:.0f}"

    show(
        "Independent iterations: means that fail by t alone / as judged, in %",
        ["the mean is over the limit by", "3 iterations", "5", "10", "20"],
        (
            [f"{off} standard errors", *(found(m, off) for m in (3, 5, 10, 20))]
            for off in (3, 6, 12)
        ),
    )


def windows() -> None:
    """Every world again, for the means of 1 s windows of 30 messages."""
    show(
        "90 % of 1 s windows: wrong passes / fails / confirmed fails, in %",
        ["world", WINDOWS],
        (
            [name, cell(errors(world, (WINDOWS,), runs=RUNS)[WINDOWS])]
            for name, world in WORLDS.items()
        ),
    )


STORED_SHAPES = (Shape(2, 2), Shape(3, 2), Shape(5, 2), Shape(10, 2))
STORED_WORLDS = (
    "nothing differs",
    "iterations differ by 2.7 %",
    "starts differ by 2.7 %",
    "both differ by 2.7 %",
    "stalls of 5 messages",
    "skewed messages (log-normal)",
    "the hour differs by 2.7 %",
)


def stored() -> None:
    """Two stored runs of one graph, by their iterations and by their starts."""

    def row(name: str) -> Iterable[object]:
        yield name
        for shape in STORED_SHAPES:
            plain, judged = (
                100 * stored_errors(WORLDS[name], shape, by_starts=by, runs=RUNS).shares[1]
                for by in (False, True)
            )
            yield f"{plain:.1f} / {judged:.1f}"

    show(
        "Two stored runs, A against A: 'worse' by iterations / as compared, in %",
        ["world", *(f"{shape.starts} starts" for shape in STORED_SHAPES)],
        ([*row(name)] for name in STORED_WORLDS),
    )


def words() -> None:
    """What is held, and where it is not, how many wrong verdicts say what they cannot know."""

    def one(name: str, quantity: str) -> str:
        if quantity not in SAID.get(name, {}):
            return "held"
        found = said(name, quantity, wrong=40)
        return f"said ({found.told} of {found.wrong})"

    show(
        "Held, or said: wrong verdicts with the words",
        ["world", *QUANTITIES],
        ([name, *(one(name, quantity) for quantity in QUANTITIES)] for name in WORLDS),
    )


def pair_load() -> None:
    """Pairs on a machine that others use, too."""

    def cell(world: LoadWorld, **others: Any) -> str:
        return str(PairGate(world, **others).outcomes(runs=200))

    show(
        "10 pairs, latency.p50 <= limit: passes / fails / confirmed fails, in % of 200",
        [
            "world",
            "on the limit, A B B A, as played",
            "on the limit",
            "unchanged, limit 105 %",
            "15 % slower, limit 105 %",
        ],
        (
            [
                name,
                cell(world, limit=100.0, fixed_order=True, interference="tolerate"),
                cell(world, limit=100.0),
                cell(world),
                cell(world, slower=1.15),
            ]
            for name, world in LOAD_WORLDS.items()
        ),
    )


def pair_numbers() -> None:
    """How many pairs it takes, by how much starts differ, under load that both sides had alike."""
    world = LOAD_WORLDS["a third is taken from both sides"]
    numbers = (3, 5, 10, 20, 40)

    def cell(starts: float, pairs: int) -> str:
        same, slower = (
            PairGate(world, pairs=pairs, starts=starts, slower=slower).outcomes(runs=200).shares[2]
            for slower in (1.0, 1.15)
        )
        return f"{100 * same:.1f} / {100 * slower:.0f}"

    show(
        "A third taken from both sides, limit 105 %: confirmed fails, same / 15 % slower, in %",
        ["starts differ by", *(f"{pairs} pairs" for pairs in numbers)],
        (
            [f"{100 * starts:g} %", *(cell(starts, pairs) for pairs in numbers)]
            for starts in (0.027, 0.05, 0.1)
        ),
    )


START_TABLES = (
    starts,
    shapes,
    looked_starts,
    comparisons,
    care,
    windows,
    stored,
    words,
    pair_load,
    pair_numbers,
)
