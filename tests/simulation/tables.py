"""The tables of docs/verdicts.md, docs/peak_throughput.md and docs/host_interference.md:

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
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from numpy.typing import NDArray
from scipy import signal, stats
from simulated_batches import KINDS, aa_gates, history_gates
from simulated_disturbances import Kind as Disturbance
from simulated_disturbances import Machine, outcomes
from simulated_gates import (
    Errors,
    Rates,
    bootstrap_gate,
    history_gate,
    looked_gate,
    mean_gate,
    paired_gate,
    share_gate,
    stored_gate,
)
from simulated_runs import judged
from simulated_waiting import fails
from simulated_worlds import WORLDS
from start_tables import START_TABLES, show

from compared_searches import Method, csit, probabilistic_bisection, rfc_2544
from r2bspec.judge.decision_policy import InterimLooks
from r2bspec.judge.rate_decision import Criterion
from r2bspec.judge.statistics.binomial import upper_bound
from r2bspec.judge.statistics.t_interval import smallest_detectable
from simulated_peaks import SERVERS, Kind, outcome, searched
from simulated_queues import SUSTAINED, Server
from simulated_queues import probe as probed
from simulated_speeds import WORLDS as SPEEDS
from simulated_speeds import Graph, World, find

RUNS = 2000


def messages() -> None:
    def least(over: int, share: float) -> int:
        n = over + 1
        while upper_bound(over, n, 0.95) > share:
            n += 1
        return n

    show(
        "Messages that pass, by how many are over the limit",
        ["over the limit", "p50", "p90", "p95", "p99", "p99.9"],
        (
            [over, *(f"{least(over, share):,}" for share in (0.5, 0.1, 0.05, 0.01, 0.001))]
            for over in (0, 1, 2, 5, 10)
        ),
    )


def shares() -> None:
    def row(name: str) -> Iterable[object]:
        yield name
        for allowed, number in ((0.01, 300), (0.01, 1000), (0.1, 300)):
            for plain in (True, False):
                yield share_gate(
                    WORLDS[name], allowed, allowed, runs=RUNS, messages=number, plain=plain
                )

    show(
        "Wrong passes / wrong fails, in % of runs",
        [
            "world",
            "p99, 3,000: plain",
            "effective",
            "p99, 10,000: plain",
            "effective",
            "p90, 3,000: plain",
            "effective",
        ],
        ([*row(name)] for name in WORLDS),
    )


def means() -> None:
    random = np.random.default_rng(1)

    def made(world: str, m: int) -> NDArray[np.float64]:
        shape = (RUNS // 2, m, 300)
        match world:
            case "stationary, 2 % variation":
                return random.normal(1, 0.02, (RUNS, m))
            case "drifting by 6 %":
                return random.normal(1, 0.02, (RUNS, m)) + np.linspace(-0.03, 0.03, m)
            case "each like the one before (r = 0.5)":
                noise = random.standard_normal((RUNS, m + 100))
                values = signal.lfilter([0.75**0.5], [1, -0.5], noise, axis=1)
                return np.asarray(1 + values[:, 100:])
            case "log-normal messages (sigma 1), 300 each":
                return np.asarray(np.exp(random.normal(0, 1, shape) - 0.5).mean(axis=2))
        return np.asarray((2 * random.pareto(3, shape)).mean(axis=2))

    worlds = (
        "stationary, 2 % variation",
        "drifting by 6 %",
        "each like the one before (r = 0.5)",
        "log-normal messages (sigma 1), 300 each",
        "Pareto messages (index 3), 300 each",
    )
    show(
        "Means: wrong passes / wrong fails, in % of runs",
        ["world", "3 iterations", "5", "10", "20"],
        ([name, *(mean_gate(made(name, m), 1.0) for m in (3, 5, 10, 20))] for name in worlds),
    )


def power() -> None:
    random = np.random.default_rng(2)
    p99_ms = float(stats.lognorm.ppf(0.99, 0.3)) * 20

    def caught(loss: float, variation: float, pairs: int) -> str:
        found = paired_gate(1 - loss, 0.97, pairs=pairs, runs=600, variation=variation)
        return f"{100 * found.failed:.0f}"

    def failed(slower: float, iterations: int) -> str:
        made = [
            judged(
                stats.lognorm.rvs(
                    0.3, scale=0.02 * slower, size=(iterations, 300), random_state=random
                ),
                f"latency.p99 < {1.03 * p99_ms:.5f} ms",
            ).outcome
            for _ in range(60)
        ]
        return f"{100 * made.count('fail') / 60:.0f}"

    show(
        "latency.p99, limit 3 % above what it was: caught, in % of runs",
        ["slower by", "3 iterations", "5", "10", "20"],
        (
            [f"{round(100 * (slower - 1))} %", *(failed(slower, m) for m in (3, 5, 10, 20))]
            for slower in (1.05, 1.1, 1.2)
        ),
    )
    show(
        "Interleaved pairs, limit 97 % of baseline: caught, in % of runs",
        ["loss", "variation", "3 pairs", "5", "10", "20"],
        (
            [
                f"{loss:.0%}",
                f"{variation:.0%}",
                *(caught(loss, variation, n) for n in (3, 5, 10, 20)),
            ]
            for variation in (0.02, 0.05)
            for loss in (0.05, 0.1, 0.2)
        ),
    )
    show(
        "Smallest regression beyond the limit that is found nine times in ten",
        ["noise floor", "5 pairs", "10", "20", "40"],
        (
            [
                f"{floor:.0%}",
                *(
                    f"{100 * np.expm1(smallest_detectable(floor, n, 0.95)):.1f} %"
                    for n in (5, 10, 20, 40)
                ),
            ]
            for floor in (0.01, 0.02, 0.03, 0.05)
        ),
    )


def looks() -> None:
    plan = InterimLooks((10, 20, 40))
    names = ("stationary", "bursts of 5", "autocorrelated, 0.9", "heavy-tailed")

    def row(name: str) -> Iterable[object]:
        flags = WORLDS[name](np.random.default_rng(3), (RUNS, 40, 75), 0.1)
        yield name
        for planned in (False, True):
            yield looked_gate(flags, 0.1, plan, planned=planned)[0]

    show(
        "Looks at 10, 20 and 40 iterations: wrong passes / wrong fails, in % of runs",
        ["world", "unplanned: each at 95 %", "planned: the error divided"],
        ([*row(name)] for name in names),
    )


def gates() -> None:
    def row(name: str, found: Errors) -> Iterable[object]:
        return name, *(f"{100 * share:.1f}" for share in found.shares)

    show(
        "600 A/A gates of each kind, exactly on the limit, in %",
        ["gate", "wrong passes", "wrong fails", "after confirmation"],
        [
            *([*row(name, aa_gates(batch))] for name, batch in KINDS.items()),
            [*row("history of ten runs, no margin", history_gates())],
        ],
    )


def baselines() -> None:
    methods: dict[str, Callable[[int], Rates]] = {
        "pairs, paired t on logs, no margin": lambda n: paired_gate(1, 1, pairs=n, runs=RUNS),
        "pairs, paired t on logs, 5 % margin": lambda n: paired_gate(1, 0.95, pairs=n, runs=RUNS),
        "pairs, bootstrap of the ratio, no margin": lambda n: bootstrap_gate(1, pairs=n, runs=1000),
        "two stored runs of one start, Welch, no margin": lambda n: stored_gate(n, runs=RUNS),
        "history of so many runs, no margin": lambda n: history_gate(1, 1, history=n, runs=RUNS),
        "history of so many runs, 5 % margin": lambda n: history_gate(
            1, 0.95, history=n, runs=RUNS
        ),
    }
    show(
        "A against A: 'worse', in % of comparisons",
        ["method", "5", "10", "30"],
        (
            [name, *(f"{100 * gate(n).failed:.1f}" for n in (5, 10, 30))]
            for name, gate in methods.items()
        ),
    )


def sustained() -> None:
    def cell(kind: Kind, load: float, seconds: float, number: int) -> str:
        found = Counter(outcome(kind, load, seconds=seconds, seed=seed) for seed in range(number))
        valid = number - found["invalid"]
        return f"{100 * found['pass'] / valid:.0f} / {100 * found['fail'] / valid:.0f}"

    loads = (0.8, 0.9, 0.95, 1.05, 1.1, 1.2)
    kinds: tuple[Kind, ...] = ("D/D/1", "D/M/1", "M/D/1", "M/M/1")
    show(
        "sustained: passes / fails, in % of probes, by load",
        ["queue, length of the probe", *(f"{load:.0%}" for load in loads)],
        (
            [f"{kind}, {seconds} s", *(cell(kind, load, seconds, number) for load in loads)]
            for kind in kinds
            for seconds, number in ((3, 150), (10, 150), (30, 60))
        ),
    )


def peaks() -> None:
    def quantiles(values: list[float]) -> str:
        low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
        return f"{low:.3f}, {middle:.3f}, {high:.3f}"

    def row(world: str, about_hz: float, number: int) -> list[str]:
        found = [searched(world, about_hz, seed) for seed in range(number)]
        return [
            f"{world}, {about_hz:g} Hz",
            quantiles([each.lower for each in found]),
            quantiles([min(each.upper, 5.0) for each in found]),
            f"{100 * sum(each.contains for each in found) / number:.1f} %",
            f"{sum(len(each.record.probes) for each in found) / number:.1f}",
            f"{sum(each.played_s for each in found) / number:.0f} s",
        ]

    show(
        "peaks: highest rate that held and lowest that did not, in shares of the capacity",
        ["servers", "held: 5 %, 50 %, 95 %", "did not", "holds the capacity", "probes", "played"],
        (row(world, about_hz, 100) for world in SERVERS for about_hz in (20.0, 100.0, 400.0)),
    )


def peak_worlds() -> None:
    def row(name: str, number: int = 200) -> list[str]:
        found = [find(name, seed) for seed in range(number)]
        results = Counter(each.result for each in found)
        texts = Counter(text for each in found for text in each.record.unsteady)
        return [
            name,
            *(f"{100 * results[each] / number:.1f}" for each in ("right", "wrong", "unsteady")),
            f"{100 * (results['open'] + results['not shown']) / number:.1f}",
            f"{100 * float(np.median([each.width for each in found])):.1f} %",
            f"{np.median([each.played_s for each in found]):.0f} s",
            texts.most_common(1)[0][0] if texts and results["unsteady"] > number / 2 else "",
        ]

    show(
        "peak worlds: 200 searches each, in %: brackets with 95 % that hold the truth, that do "
        "not, and without 95 %",
        ["graph", "right", "wrong", "unsteady", "open", "width", "played", "such as"],
        (row(name) for name in SPEEDS),
    )


def peak_methods() -> None:
    number = 40

    def own(name: str) -> str:
        found = [find(name, seed) for seed in range(number)]
        results = Counter(each.result for each in found)
        said = number - results["right"] - results["wrong"]
        right = f"{100 * results['right'] / number:.0f} %"
        return _method_cell(
            f"{100 * said / number:.0f} % unsteady or open" if 2 * said > number else right,
            [each.width for each in found],
            [each.played_s for each in found],
        )

    def other(method: Method, name: str) -> str:
        found = [method(name, seed) for seed in range(number)]
        return _method_cell(
            f"{100 * sum(each.contains for each in found) / number:.0f} %",
            [each.width for each in found],
            [each.played_s for each in found],
        )

    others = {
        "MLRsearch, RFC 2544": rfc_2544,
        "MLRsearch, CSIT": csit,
        "probabilistic bisection": probabilistic_bisection,
    }
    worlds = [name for name in SPEEDS if not name.startswith("loses")]
    show(
        "peak methods: truth in the bracket, median width, median time played, of 40 searches each",
        ["graph", "r2bspec", *others],
        ([name, own(name), *(other(each, name) for each in others.values())] for name in worlds),
    )


def _method_cell(right: str, widths: Sequence[float], times_s: Sequence[float]) -> str:
    return f"{right}, {100 * float(np.median(widths)):.1f} %, {np.median(times_s):.0f} s"


def peak_losses() -> None:
    def cell(loses: float, rate_hz: float) -> str:
        holds = {"probe": 0, "sustained": 0}
        for seed in range(200):
            server = Server(1000.0, loses=loses, seed=seed)
            criterion = Criterion(precision=0.02)
            short = probed(server, rate_hz, criterion=criterion)
            whole = probed(server, rate_hz, criterion=criterion, play=SUSTAINED)
            holds["probe"] += bool(short.judgement.holds)
            holds["sustained"] += bool(whole.judgement.holds)
        return f"{holds['probe'] / 2:.1f} / {holds['sustained'] / 2:.1f}"

    rates = (10.0, 20.0, 30.0, 60.0, 120.0)
    show(
        "peak losses: probes of the search / of objectives that find a rate sustained at which a "
        "graph loses messages, where none may be lost, in % of 200",
        ["lost", *(f"{each:g} Hz" for each in rates)],
        (
            [f"{loses:.1%}", *(cell(loses, each) for each in rates)]
            for loses in (0.005, 0.02, 0.05, 0.1)
        ),
    )


def peak_edges() -> None:
    def cell(variation: float, load: float) -> str:
        holds = 0
        for seed in range(400):
            graph = Graph(World(variation=variation), 100.0, np.random.default_rng(seed))
            criterion = Criterion(precision=0.02)
            judged = probed(graph, 100 * load, criterion=criterion, play=SUSTAINED).judgement
            holds += bool(judged.holds)
        return f"{holds / 4:.1f}"

    loads = (1.005, 1.01, 1.02, 1.03, 1.04, 1.06)
    show(
        "peak edges: objectives that find a rate sustained at this multiple of the capacity, "
        "precision 2 %, in % of 400",
        ["service times", *(f"{each:g}" for each in loads)],
        ([f"log-normal, cv {cv:g}", *(cell(cv, each) for each in loads)] for cv in (0.1, 0.3, 0.6)),
    )


def disturbances() -> None:
    def cell(kind: Disturbance, share: float, slower: float) -> str:
        played, known = outcomes(Machine(kind, share), runs=200, slower=slower).fails()
        return f"{100 * played:.0f} / {100 * known:.0f}"

    kinds: tuple[Disturbance, ...] = ("stalls", "contention")
    slower = (0.5, 1.8, 2.5, 5.0, 14.0)
    show(
        "Fails as it was played / as it is judged, in % of runs, by how slow the graph is",
        ["machine", "half the limit", "on the limit", "1.3 x", "2.5 x", "7 x"],
        (
            [f"{kind} in {share:.0%} of iterations", *(cell(kind, share, each) for each in slower)]
            for kind in kinds
            for share in (0.3, 1.0)
        ),
    )


def waiting() -> None:
    def cell(load: float, share: float, stricter: float) -> str:
        found = fails(load, share, stricter=stricter, runs=100)
        return " / ".join(
            f"{100 * each:.0f}" for each in (found.measured, found.pressure, found.waits)
        )

    show(
        "Fails as measured / as judged by the pressure / by the run-queue waits, in % of runs",
        ["server", *(f"{share:.0%} taken: {what}" for share in (0.1, 0.2) for what in _ASKED)],
        (
            [
                f"offered {load:g} x what it can do",
                *(cell(load, share, each) for share in (0.1, 0.2) for each in _ASKED.values()),
            ]
            for load in (0.5, 0.9, 1.05, 1.5, 2.0, 3.0)
        ),
    )


_ASKED = {"just met alone": 1.0, "missed by 3 x": 1 / 3}


TABLES = (
    *START_TABLES,
    messages,
    shares,
    means,
    power,
    looks,
    gates,
    baselines,
    sustained,
    peaks,
    peak_worlds,
    peak_methods,
    peak_losses,
    peak_edges,
    disturbances,
    waiting,
)


def main(names: Sequence[str]) -> int:
    """Print the tables of these names, or all."""
    known = [table.__name__ for table in TABLES]
    if unknown := sorted({*names} - {*known}):
        sys.stderr.write(f"no table is called {', '.join(unknown)}; there are {', '.join(known)}\n")
        return 2
    problems = []
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        for text, problem in pool.map(_made, [name for name in known if name in (names or known)]):
            sys.stdout.write(text)
            sys.stdout.flush()
            problems += problem
    sys.stderr.writelines(problems)
    return int(bool(problems))


def _made(name: str) -> tuple[str, list[str]]:
    """What a table prints, and why it ended early, if it did."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        try:
            next(table for table in TABLES if table.__name__ == name)()
        except Exception as error:  # the others are printed all the same
            return printed.getvalue(), [
                f"{name} could not be made: {type(error).__name__}: {error}\n"
            ]
    return printed.getvalue(), []


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
