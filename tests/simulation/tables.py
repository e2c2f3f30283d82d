"""Print the tables of docs/proofs:

    PYTHONPATH=tests/support python tests/simulation/tables.py [NAME ...]

Seeds are fixed. NAME is that of a function below; without a name, all are printed. As many are made
at a time as there are processors. The exit status is 1 if a table could not be made.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import TypeVar

import numpy as np
from simulated_gates import RUN_WORLDS, Errors, RunWorld, held, pairs_errors
from simulated_starts import (
    QUANTITIES,
    RARE_WORLDS,
    errors,
    quantities_of,
    right_away_from_the_limit,
    time_to_verdict,
)
from simulated_starts import WORLDS as START_WORLDS

from r2bspec.judge.rate_decision import Criterion
from r2bspec.judge.statistics.binomial import upper_bound
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


def starts() -> None:
    """Every world, a run of 5 starts of 2 iterations of 300 messages."""
    show(
        "5 starts x 2 iterations x 300 messages, on the limit: wrong passes / fails / confirmed "
        "fails, in %; of those in bold, how many say what the run may not have met",
        ["world", *QUANTITIES],
        (
            [name, *(_cell(found, quantity) for quantity in QUANTITIES)]
            for name, found in (
                (name, errors(world, quantities_of(name), runs=400, looks=True, said=True))
                for name, world in {**START_WORLDS, **RARE_WORLDS}.items()
            )
        ),
    )


def _cell(found: Mapping[str, Errors], quantity: str) -> str:
    counts = found.get(quantity)
    if counts is None or held(counts):
        return str(counts or "")
    return f"**{counts}**, {100 * counts.said / max(1, int(counts.counts[:2].sum())):.0f} %"


def away() -> None:
    """Every world, the limit 15 % above the truth and below it."""
    quantities = [name for name in QUANTITIES if name != "drop rate 1 %"]
    rows = {
        name: [right_away_from_the_limit(world, quantity, runs=100) for quantity in quantities]
        for name, world in START_WORLDS.items()
    }
    rows["all"] = [float(value) for value in np.mean([*rows.values()], axis=0)]
    show(
        "Right verdicts where the limit is 15 % from the truth, in %",
        ["world", *quantities],
        ([name, *(f"{100 * share:.0f}" for share in row)] for name, row in rows.items()),
    )


def verdicts(runs: int = 100) -> None:
    """The figures of the verdicts: errors on the limit, and what is decided away from it."""
    most = np.zeros(3)
    met, say_so, silent = 0, 0, []
    for name, world in {**START_WORLDS, **RARE_WORLDS}.items():
        found = errors(world, quantities_of(name), runs=runs, looks=True, said=True)
        for quantity, counts in found.items():
            if held(counts):
                met, most = met + 1, np.maximum(most, counts.shares)
            elif counts.said >= 0.9 * int(counts.counts[:2].sum()):
                say_so += 1
            else:
                silent.append(f"{name}, {quantity}: {counts}")
    right = [
        right_away_from_the_limit(world, quantity, runs=runs // 4)
        for world in START_WORLDS.values()
        for quantity in ("p50", "p99", "mean, throughput")
    ]
    close, clear = (time_to_verdict(distance, 5, runs=5 * runs) for distance in (2.0, 10.0))
    show(
        f"Verdicts, {runs} runs a world",
        ["figure", "value", "aim"],
        [
            [
                f"wrong PASS / FAIL / confirmed, the most in {met} worlds and quantities",
                " / ".join(f"{100 * share:.1f}" for share in most),
                "5 / 5 / 1, and three standard errors",
            ],
            ["more, and said", say_so, ""],
            ["more, and not said", "; ".join(silent) or 0, 0],
            ["right verdict 15 % from the limit", f"{100 * float(np.mean(right)):.1f} %", "96 %"],
            ["decided at two deviations, five starts", f"{100 * close.decided:.0f} %", "90 %"],
            ["time to a clear verdict", f"{clear.seconds:.0f} s", "67 s"],
        ],
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
        return f"{100 * found.decided:.0f} %, {found.seconds:.0f} s"

    grid(
        "Means that are decided, and the seconds played (22 s a start), by the distance from the "
        "limit in deviations between starts",
        "declared",
        {
            "5 starts": (5, 5, True),
            "10 starts": (10, 10, True),
            "5 starts, extended to 24": (5, 24, True),
            "10 starts, judged once": (10, 10, False),
        },
        {f"{each:g}": each for each in (0.5, 1.0, 2.0, 3.0, 5.0, 10.0)},
        cell,
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


TABLES = {
    table.__name__: table
    for table in (
        verdicts,
        starts,
        away,
        comparisons,
        looks,
        messages,
        sustained,
        peak_worlds,
        peak_losses,
        peak_edges,
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
