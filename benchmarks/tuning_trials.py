"""What `r2bspec tune` finds in simulated graphs, and how many trials it needs.

    PYTHONPATH=tests/support:tests/simulation python benchmarks/tuning_trials.py [--graphs 100]

The graphs are simulated, so that the best deployment of each is known. First every graph is
searched, with 30 trials in 20 minutes. Then the search, chance and a grid of all combinations try
deployments until one keeps the limit and costs less than 5 % more than the best. The tables in
docs/tuning.md are from it.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter

import numpy as np
from simulated_deployments import SETTINGS, SimulatedGraph, blank, trials_needed

from r2bspec.plan.tuning_space import Deployment
from r2bspec.tune.search import Search


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--graphs", type=int, default=100)
    seeds = range(parser.parse_args().graphs)
    counts = Counter[str]()
    for seed in seeds:
        counts.update(_searched(SimulatedGraph.drawn(seed)))
    needed = [each for seed in seeds if (each := trials_needed(seed))]
    lines = [f"| {len(seeds)} searches | |", "| --- | --- |"]
    lines += [f"| {name} | {count} |" for name, count in counts.items()]
    lines += [
        "",
        f"| trials, {len(needed)} graphs | median | 90 % of graphs |",
        "| --- | --- | --- |",
    ]
    for name in needed[0]:
        half, most = np.percentile([each[name] for each in needed], (50, 90))
        lines.append(f"| {name} | {half:.0f} | {most:.0f} |")
    sys.stdout.write("\n".join([*lines, ""]))


def _searched(graph: SimulatedGraph) -> Counter[str]:
    """What is true of the winner of a search, and of what is claimed of it."""
    found = Search(blank(graph.space), graph, SETTINGS).run()
    today = graph.space.today()
    winner = found.winner or today
    meets = graph.works(winner) and graph.true_excess(winner) <= 0
    cheaper = graph.true_cost(winner) < graph.true_cost(today)
    return Counter(
        {
            "winners that meet the objectives": int(meets),
            "winners that cost less than 5 % more than the best": int(
                graph.is_near(winner, graph.best_cost())
            ),
            "levers of winners": len(winner.choices),
            "of these, levers that give nothing": sum(
                _gives_nothing(graph, winner, choice.lever) for choice in winner.choices
            ),
            "claims": int(found.is_proved),
            "of these, wrong claims": int(
                found.is_proved and not (meets and (cheaper or found.outcome == "meets"))
            ),
        }
    )


def _gives_nothing(graph: SimulatedGraph, winner: Deployment, lever: str) -> bool:
    others = {each.lever: each.place for each in winner.choices if each.lever != lever}
    without = graph.space.deployment(others)
    costs_more = graph.true_cost(without) > graph.true_cost(winner)
    return not costs_more and graph.true_excess(without) <= 0


if __name__ == "__main__":
    main()
