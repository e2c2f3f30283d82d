"""The tables of docs/verdicts.md, docs/peak_throughput.md and docs/host_interference.md:

    PYTHONPATH=tests/support python tests/simulation/tables.py [NAME ...]

Seeds are fixed. NAME is that of a function below; without a name, all are printed. As many are made
at a time as there are processors. The exit status is 1 if a table could not be made.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import TypeVar

import numpy as np
from simulated_caveats import share_told, share_told_of_wrong
from simulated_gates import (
    KINDS,
    MEAN_WORLDS,
    RUN_WORLDS,
    Errors,
    RunWorld,
    confirmed_gates,
    held,
    mean_gate,
    paired_gate,
    pairs_errors,
    share_gate,
)
from simulated_pair_load import LOAD_WORLDS, LoadWorld, PairGate
from simulated_pair_looks import HEADS, errors_of_pairs
from simulated_starts import (
    ADVICE_WORLDS,
    QUANTITIES,
    Shape,
    StartWorld,
    components,
    errors,
    follow_advice,
    limit_of,
    stored_errors,
    time_to_verdict,
)
from simulated_starts import WORLDS as START_WORLDS
from simulated_steadiness import CHANGES, PLAYED, STEADY, share_found
from simulated_waiting import fails
from simulated_worlds import WORLDS

from r2bspec.judge.rate_decision import Criterion
from r2bspec.judge.statistics.binomial import upper_bound
from r2bspec.judge.statistics.t_interval import mean_interval
from simulated_peaks import Kind, outcome
from simulated_queues import SUSTAINED, Play, Server
from simulated_queues import probe as probed
from simulated_speeds import WORLDS as SPEEDS
from simulated_speeds import Graph, World, find
from simulated_speeds import Result as SearchResult

RUNS = 2000

Row = TypeVar("Row")
Column = TypeVar("Column")


def show(title: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table."""
    lines = [title, "", f"| {' | '.join(head)} |", f"|{' --- |' * len(head)}"]
    lines += [f"| {' | '.join(map(str, row))} |" for row in rows]
    sys.stdout.write("\n".join(lines) + "\n\n")
    sys.stdout.flush()


def grid(
    title: str,
    corner: str,
    rows: Mapping[str, Row],
    columns: Mapping[str, Column],
    cell: Callable[[Row, Column], object],
) -> None:
    """Print a table of which each cell is a function of its row and its column."""
    show(
        title,
        [corner, *columns],
        ([name, *(cell(row, column) for column in columns.values())] for name, row in rows.items()),
    )


def bold(found: Errors) -> str:
    """The three shares in percent; bold where they are more than is promised."""
    return str(found) if held(found) else f"**{found}**"


def chosen(worlds: Mapping[str, Row], *names: str) -> dict[str, Row]:
    """The worlds of these names."""
    return {name: worlds[name] for name in names}


PAIR_NUMBERS = {"3 pairs": 3, "5": 5, "10": 10, "20": 20}
ITERATIONS = {"3 iterations": 3, "5": 5, "10": 10, "20": 20}


def messages() -> None:
    def least(over: int, share: float) -> str:
        n = over + 1
        while upper_bound(over, n, 0.95) > share:
            n += 1
        return f"{n:,}"

    grid(
        "Messages that pass, by how many are over the limit",
        "over the limit",
        {str(over): over for over in (0, 1, 2, 5, 10)},
        {"p50": 0.5, "p90": 0.1, "p95": 0.05, "p99": 0.01, "p99.9": 0.001},
        least,
    )


def shares() -> None:
    grid(
        "Wrong passes / wrong fails, in % of runs",
        "world",
        WORLDS,
        {
            f"{name}: {how}": (allowed, number, how == "plain")
            for name, allowed, number in (
                ("p99, 3,000", 0.01, 300),
                ("p99, 10,000", 0.01, 1000),
                ("p90, 3,000", 0.1, 300),
            )
            for how in ("plain", "effective")
        },
        lambda world, asked: (
            share_gate(
                world, asked[0], asked[0], runs=RUNS, messages=asked[1], plain=asked[2]
            ).rates
        ),
    )


def means() -> None:
    random = np.random.default_rng(1)
    grid(
        "Means: wrong passes / wrong fails, in % of runs",
        "world",
        MEAN_WORLDS,
        ITERATIONS,
        lambda world, m: mean_gate(world(random, RUNS, m)).rates,
    )


def care() -> None:
    """What it costs where iterations are independent that they might not be."""
    random = np.random.default_rng(1)

    def cell(errors_off: float, m: int) -> str:
        values = random.normal(1, 0.02, (RUNS, m)) + errors_off * 0.02 / math.sqrt(m)
        alone = np.mean([mean_interval(run, 0.95).lower >= 1 for run in values.tolist()])
        return f"{100 * alone:.0f} / {100 * mean_gate(values).failed:.0f}"

    grid(
        "Independent iterations: means that fail by t alone / as judged, in %",
        "the mean is over the limit by",
        {f"{off} standard errors": off for off in (3, 6, 12)},
        ITERATIONS,
        cell,
    )


def power() -> None:
    def caught(case: tuple[float, float], pairs: int) -> str:
        variation, loss = case
        found = paired_gate(1 - loss, 0.97, pairs=pairs, runs=600, variation=variation)
        return f"{100 * found.failed:.0f}"

    grid(
        "Interleaved pairs, limit 97 % of baseline: caught, in % of runs",
        "variation, loss",
        {
            f"{variation:.0%}, {loss:.0%}": (variation, loss)
            for variation in (0.02, 0.05)
            for loss in (0.05, 0.1, 0.2)
        },
        PAIR_NUMBERS,
        caught,
    )


def gates() -> None:
    def row(name: str) -> list[str]:
        return [
            name,
            *(f"{100 * share:.1f}" for share in confirmed_gates(KINDS[name], runs=600).shares),
        ]

    show(
        "600 A/A gates of each kind, exactly on the limit, in %",
        ["gate", "wrong passes", "wrong fails", "after confirmation"],
        map(row, KINDS),
    )


def starts() -> None:
    """Every world, a run of 5 starts of 2 iterations of 300 messages."""
    show(
        "5 starts x 2 iterations x 300 messages: wrong passes / fails / confirmed fails, in %",
        ["world", *QUANTITIES],
        (
            [name, *map(bold, errors(world, runs=400, looks=True).values())]
            for name, world in START_WORLDS.items()
        ),
    )


def caveats() -> None:
    """What wrong verdicts say, and what right ones do."""
    worlds = chosen(
        START_WORLDS,
        "starts differ by 10 %",
        "messages resemble (0.99)",
        "iterations resemble (0.8), 5 %",
        "stalls of 40 messages",
        "a stop of 0.5 s every 30 s",
        "1 iteration in 10 is slow",
        "1 start in 5 is slow",
        "the hour differs by 2.7 %",
    )
    grid(
        "Wrong passes / wrong fails on the limit that say something, in % of at most 40",
        "world",
        worlds,
        {quantity: quantity for quantity in QUANTITIES},
        lambda world, quantity: " / ".join(
            share_told_of_wrong(world, quantity, decision) or "none"
            for decision in ((1, -1) if world.hour else (1,))
        ),
    )
    steady = chosen(
        START_WORLDS, "nothing differs", "starts differ by 2.7 %", "starts differ by 5 %"
    )
    grid(
        "Right passes of a latency that are too close, in % of 100, by how much it is met",
        "world, requirement",
        {
            f"{name}, {quantity}": (world, quantity)
            for name, world in steady.items()
            for quantity in ("p50", "p99", "mean, throughput")
        },
        {f"{margin - 1:.0%}": margin for margin in (1.05, 1.1, 1.2, 1.3)},
        lambda case, margin: share_told(
            *case, limit_of(*case) * margin, 1, "met by at least", wanted=100
        ),
    )
    grid(
        "Passes of a drop rate of 1 % that say that starts differ, in % of 100, by the truth",
        "starts differ by, starts",
        {
            f"{differ}, {starts}": (START_WORLDS[f"starts differ by {differ}"], Shape(starts))
            for differ in ("2.7 %", "5 %", "10 %")
            for starts in (5, 10)
        },
        {f"{truth:.2%}": truth for truth in (0.01, 0.005, 0.003, 0.001)},
        lambda case, truth: share_told(
            case[0],
            "drop rate 1 %",
            case[0].quantile(1 - truth),
            1,
            "starts differ",
            wanted=100,
            shape=case[1],
        ),
    )


def more_starts() -> None:
    """How many starts have met what is rare."""

    def cell(world: StartWorld, starts: int) -> str:
        quantities = ("drop rate 1 %", "mean, throughput")
        found = errors(world, quantities, shape=Shape(starts), runs=200)
        return " / ".join(f"{100 * found[quantity].passed:.0f}" for quantity in quantities)

    grid(
        "Starts x 2 iterations, judged once: wrong passes of a drop rate / of a mean, in % of 200",
        "world",
        chosen(
            START_WORLDS,
            "1 start in 5 is slow",
            "1 iteration in 10 is slow",
            "stalls of 40 messages",
            "starts differ by 10 %",
        ),
        {f"{starts} starts": starts for starts in (5, 9, 14, 20)},
        cell,
    )


def shapes() -> None:
    """How many starts and iterations are needed, by 3,000 messages a run."""

    def cell(case: tuple[Shape, str], name: str) -> str:
        shape, quantity = case
        if quantity == "mean, throughput" and shape.pieces == 1:
            return "open"
        return bold(errors(START_WORLDS[name], (quantity,), shape=shape, runs=500)[quantity])

    sizes = ((1, 1), (1, 3), (1, 5), (1, 10), (2, 2), (3, 2), (5, 2), (10, 2), (20, 2))
    names = (
        "nothing differs",
        "iterations differ by 2.7 %",
        "iterations resemble (0.5), 5 %",
        "starts differ by 2.7 %",
    )
    grid(
        "Starts x iterations, 3,000 messages in all, judged once: the same",
        "starts x iterations",
        {
            f"{number} x {each}, {quantity}": (
                Shape(number, each, 3000 // (number * each)),
                quantity,
            )
            for quantity in ("p50", "mean, throughput")
            for number, each in sizes
        },
        {name: name for name in names},
        cell,
    )


def comparisons() -> None:
    """Base against head, in pairs."""
    columns: Mapping[str, Callable[[RunWorld], Errors]] = {
        f"{n} pairs": partial(pairs_errors, pairs=n, runs=RUNS) for n in (5, 10)
    }
    grid(
        "A against A, ratio and limit 1: wrong passes / fails / confirmed fails, in %",
        "world",
        RUN_WORLDS,
        columns,
        lambda world, gate: bold(gate(world)),
    )


def looks() -> None:
    """When a verdict is reached, by its distance from the limit in deviations between starts."""

    def cell(design: tuple[int, int, bool], distance: float) -> str:
        starts, most, looks = design
        found = time_to_verdict(distance, starts, most, looks=looks, runs=500)
        return f"{100 * found.decided:.0f} %, {found.starts:g}"

    grid(
        "Runs that are decided, and the median number of starts, by the distance from the limit",
        "declared",
        {
            "5 starts, judged once": (5, 5, False),
            "5 starts": (5, 5, True),
            "10 starts": (10, 10, True),
            "5 starts, extended to 20": (5, 20, True),
            "5 starts, extended to 24": (5, 24, True),
            "20 starts": (20, 20, True),
            "20 starts, judged once": (20, 20, False),
        },
        {f"{each:g}": each for each in (0.5, 1.0, 2.0, 3.0, 5.0, 10.0)},
        cell,
    )


def look_errors() -> None:
    """What it costs to end as soon as all is decided, where the rest would show something rare."""

    def cell(world: StartWorld, looks: bool) -> str:
        found = errors(world, runs=400, looks=looks).values()
        return " / ".join(f"{100 * one.passed:.0f}" for one in found)

    grid(
        f"Wrong passes of {', '.join(QUANTITIES)}, on the limit, in % of 400 runs of 5 starts",
        "world",
        chosen(
            START_WORLDS,
            "starts differ by 2.7 %",
            "starts differ by 10 %",
            "starts resemble (0.5), 2.7 %",
            "stalls of 40 messages",
            "a stop of 0.5 s every 30 s",
            "1 start in 5 is slow",
        ),
        {"judged once": False, "with looks": True},
        cell,
    )


def stored() -> None:
    """Two stored runs of one graph, by their iterations and by their starts."""
    names = (
        "nothing differs",
        "iterations differ by 2.7 %",
        "starts differ by 2.7 %",
        "both differ by 2.7 %",
        "stalls of 5 messages",
        "skewed messages (log-normal)",
        "the hour differs by 2.7 %",
    )
    grid(
        "Two stored runs, A against A: 'worse' by iterations / as compared, in %",
        "world",
        chosen(START_WORLDS, *names),
        {"1 start x 10": Shape(1, 10)}
        | {f"{number} starts": Shape(number, 2) for number in (2, 3, 5, 10)},
        lambda world, shape: " / ".join(
            f"{100 * stored_errors(world, shape, by_starts=by, runs=1000).failed:.1f}"
            for by in (False, True)
        ),
    )


def pair_load() -> None:
    """Pairs on a machine that others use, too."""
    columns: dict[str, Callable[[LoadWorld], PairGate]] = {
        "on the limit, A B B A, as played": partial(
            PairGate, limit=100.0, fixed_order=True, interference="tolerate"
        ),
        "on the limit": partial(PairGate, limit=100.0),
        "unchanged, limit 105 %": PairGate,
        "15 % slower, limit 105 %": partial(PairGate, slower=1.15),
    }
    grid(
        "10 pairs, latency.p50 <= limit: passes / fails / confirmed fails, in % of 200",
        "world",
        LOAD_WORLDS,
        columns,
        lambda world, gate: gate(world).outcomes(runs=200),
    )


def pair_numbers() -> None:
    """How many pairs it takes, by how much starts differ, under load that both sides had alike."""
    world = LOAD_WORLDS["a third is taken from both sides"]

    def cell(differ: float, pairs: int) -> str:
        same, slower = (
            100
            * PairGate(world, pairs=pairs, starts=differ, slower=slower)
            .outcomes(runs=200)
            .shares[2]
            for slower in (1.0, 1.15)
        )
        return f"{same:.1f} / {slower:.0f}"

    grid(
        "A third taken from both sides, limit 105 %: confirmed fails, same / 15 % slower, in %",
        "starts differ by",
        {f"{100 * each:g} %": each for each in (0.027, 0.05, 0.1)},
        {f"{pairs} pairs": pairs for pairs in (3, 5, 10, 20, 40)},
        cell,
    )


def pair_looks() -> None:
    """What it costs to end pairs as soon as they decide, where the head does something rarely."""

    def cell(head: str, case: tuple[str, int]) -> str:
        quantity, pairs = case
        designs = ((False, False), (True, False), (True, True))
        found = [
            errors_of_pairs(head, quantity, pairs, looks=looks, room=room, runs=400).passed
            for looks, room in designs
        ]
        return " / ".join(f"{100 * passed:.0f}" for passed in found)

    grid(
        "Pairs on the limit: wrong passes judged once / at looks / at looks with room, in % of 400",
        "head",
        {head: head for head in HEADS},
        {
            f"{quantity}, {pairs} pairs": (quantity, pairs)
            for quantity in ("mean", "p99")
            for pairs in (5, 10, 20)
        },
        cell,
    )


def advice() -> None:
    """What becomes of open runs whose advice is followed."""
    grid(
        "Open runs of 5 starts with advice (for starts) / then decided, in %",
        "world",
        ADVICE_WORLDS,
        {quantity: quantity for quantity in QUANTITIES},
        lambda world, quantity: follow_advice(world, quantity, runs=200),
    )


def budget() -> None:
    """The components of a mean, as the analysis of variance estimates them."""
    names = {
        **ADVICE_WORLDS,
        "messages resemble (0.9)": START_WORLDS["messages resemble (0.9)"],
        "messages resemble (0.99)": START_WORLDS["messages resemble (0.99)"],
    }
    grid(
        "Variance of a mean by starts, iterations, messages, in 10^-6: truth: mean ± spread",
        "world",
        names,
        {f"{number} starts": Shape(number) for number in (5, 20)},
        lambda world, shape: components(world, shape, runs=1000),
    )


def sustained() -> None:
    def cell(probe: tuple[Kind, float, int], load: float) -> str:
        kind, seconds, number = probe
        found = Counter(outcome(kind, load, seconds=seconds, seed=seed) for seed in range(number))
        valid = number - found["invalid"]
        return f"{100 * found['pass'] / valid:.0f} / {100 * found['fail'] / valid:.0f}"

    kinds: tuple[Kind, ...] = ("D/D/1", "D/M/1", "M/D/1", "M/M/1")
    grid(
        "sustained: passes / fails, in % of probes, by load",
        "queue, length of the probe",
        {
            f"{kind}, {seconds} s": (kind, seconds, number)
            for kind in kinds
            for seconds, number in ((3, 150), (10, 150), (30, 60))
        },
        {f"{load:.0%}": load for load in (0.8, 0.9, 0.95, 1.05, 1.1, 1.2)},
        cell,
    )


def peak_worlds() -> None:
    def row(name: str, number: int = 200) -> list[str]:
        found = [find(name, seed) for seed in range(number)]
        results = Counter(search.result for search in found)
        texts = Counter(text for search in found for text in search.record.unsteady)
        apart = [search.contains_apart for search in found if search.result == "unsteady"]
        shares: tuple[SearchResult, ...] = ("right", "wrong", "rarer", "unsteady")
        return [
            name,
            *(f"{100 * results[result] / number:.1f}" for result in shares),
            f"{100 * sum(apart) / len(apart):.0f}" if apart else "",
            f"{100 * (results['open'] + results['not shown']) / number:.1f}",
            f"{100 * float(np.median([search.width for search in found])):.1f} %",
            f"{np.median([search.played_s for search in found]):.0f} s",
            f"{max(search.played_s for search in found):.0f} s",
            texts.most_common(1)[0][0] if texts and results["unsteady"] > number / 2 else "",
        ]

    show(
        "peak worlds: 200 searches each, in %: brackets with 95 % that hold the truth, that do "
        "not, that do not because of what recurs too rarely, as they say, and without 95 %",
        [
            "graph",
            "right",
            "wrong",
            "rarer",
            "unsteady",
            "right apart",
            "open",
            "width",
            "played",
            "longest",
            "such as",
        ],
        map(row, SPEEDS),
    )


def peak_losses() -> None:
    def cell(loses: float, rate_hz: float) -> str:
        holds: Counter[Play | None] = Counter()
        for seed in range(200):
            server = Server(1000.0, loses=loses, seed=seed)
            for play in (None, SUSTAINED):
                holds[play] += bool(probed(server, rate_hz, play=play).judgement.holds)
        return f"{holds[None] / 2:.1f} / {holds[SUSTAINED] / 2:.1f}"

    grid(
        "peak losses: probes of the search / of objectives that find a rate sustained at which a "
        "graph loses messages, where none may be lost, in % of 200",
        "lost",
        {f"{loses:.1%}": loses for loses in (0.005, 0.02, 0.05, 0.1)},
        {f"{each:g} Hz": each for each in (10.0, 20.0, 30.0, 60.0, 120.0)},
        cell,
    )


def peak_edges() -> None:
    def cell(variation: float, load: float) -> str:
        holds = 0
        for seed in range(400):
            graph = Graph(World(variation=variation), 100.0, np.random.default_rng(seed))
            criterion = Criterion(precision=0.02)
            probe = probed(graph, 100 * load, criterion=criterion, play=SUSTAINED)
            holds += bool(probe.judgement.holds)
        return f"{holds / 4:.1f}"

    grid(
        "peak edges: objectives that find a rate sustained at this multiple of the capacity, "
        "precision 2 %, in % of 400",
        "service times",
        {f"log-normal, cv {cv:g}": cv for cv in (0.1, 0.3, 0.6)},
        {f"{each:g}": each for each in (1.005, 1.01, 1.02, 1.03, 1.04, 1.06)},
        cell,
    )


def waiting() -> None:
    def cell(load: float, case: tuple[float, float]) -> str:
        share, stricter = case
        found = fails(load, share, stricter=stricter, runs=100)
        return " / ".join(
            f"{100 * each:.0f}" for each in (found.measured, found.pressure, found.waits)
        )

    grid(
        "Fails as measured / as judged by the pressure / by the run-queue waits, in % of runs",
        "server",
        {f"offered {load:g} x what it can do": load for load in (0.5, 0.9, 1.05, 1.5, 2.0, 3.0)},
        {
            f"{share:.0%} taken: {what}": (share, stricter)
            for share in (0.1, 0.2)
            for what, stricter in (("just met alone", 1.0), ("missed by 3 x", 1 / 3))
        },
        cell,
    )


SHAPES = {
    "5 x 2": PLAYED,
    "1 x 10": Shape(1, 10, 75),
    "3 x 2": Shape(3, 2, 75),
    "10 x 2": Shape(10, 2, 75),
    "5 x 2 of 10 s": Shape(5, 2, 300),
}
"""Starts x iterations."""


def steadiness() -> None:
    """How often a part of a run is said to differ from the rest."""
    grid(
        "Steady runs in which a part is found that differs, in %",
        "world",
        STEADY,
        SHAPES,
        lambda world, shape: f"{100 * share_found(world, shape=shape, runs=1000):.1f}",
    )
    names = [*STEADY][:4]
    grid(
        "Runs of 5 x 2 with a part that differs, in which one is found, in %",
        "what differs",
        CHANGES,
        chosen(STEADY, *names),
        lambda change, world: f"{100 * share_found(world, change, runs=400):.0f}",
    )
    grid(
        "The same by the size of the run, where starts differ by 2.7 %",
        "what differs",
        CHANGES,
        SHAPES,
        lambda change, shape: (
            f"{100 * share_found(STEADY[names[1]], change, shape=shape, runs=400):.0f}"
        ),
    )


TABLES = {
    table.__name__: table
    for table in (
        starts,
        caveats,
        more_starts,
        shapes,
        advice,
        budget,
        comparisons,
        care,
        looks,
        look_errors,
        stored,
        pair_load,
        pair_numbers,
        pair_looks,
        messages,
        shares,
        means,
        power,
        gates,
        sustained,
        peak_worlds,
        peak_losses,
        peak_edges,
        waiting,
        steadiness,
    )
}


def main(names: Sequence[str]) -> int:
    """Print the tables of these names, or all."""
    if unknown := sorted({*names} - {*TABLES}):
        sys.stderr.write(
            f"no table is called {', '.join(unknown)}; there are {', '.join(TABLES)}\n"
        )
        return 2
    problems = []
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        for text, problem in pool.map(
            _made, [name for name in TABLES if name in (names or TABLES)]
        ):
            sys.stdout.write(text)
            sys.stdout.flush()
            problems += problem
    sys.stderr.writelines(problems)
    return int(bool(problems))


def _made(name: str) -> tuple[str, list[str]]:
    """What a table prints, and why it ended early, if it did."""
    problems = []
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        try:
            TABLES[name]()
        except Exception as error:  # the others are printed all the same
            problems.append(f"{name} could not be made: {type(error).__name__}: {error}\n")
    return printed.getvalue(), problems


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
