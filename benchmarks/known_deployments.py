"""Whether `r2bspec tune` finds a deployment that meets the objectives, on real ROS 2.

    PYTHONPATH=tests/support python benchmarks/known_deployments.py [--trials 30] [GRAPH ...]

Twenty graphs in C and Python, each with a deployment that is known to keep its objectives
(`tunable_graphs`), are searched. What is claimed is then played once more in new pairs, of which
the search knows nothing. A row is printed as soon as a graph is done; a table in docs/tuning.md is
from it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from r2bspec import api
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.tune.machine import Terms, goal_of
from r2bspec.tune.run_search import tune
from r2bspec.tune.search import SearchSettings
from r2bspec.tune.trials import RealMachine, ThisHost
from r2bspec.tune.tuning_result import TuningResult
from r2bspec.tune.tuning_texts import claim_text
from tunable_graphs import TunableGraph, tunable_graphs, write_graph

_COLUMNS = (
    "graph",
    "deployments",
    "trials",
    "minutes",
    "met",
    "outcome",
    "proposed",
    "claim",
    "again",
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("graphs", nargs="*", type=int, help="numbers, from 0; default: all")
    parser.add_argument("--trials", type=int, default=30)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--pairs", type=int, default=8)
    chosen = parser.parse_args()
    settings = SearchSettings(
        trials=chosen.trials, budget_s=60 * chosen.minutes, pairs=chosen.pairs
    )
    graphs = list(tunable_graphs())
    _print_row(_COLUMNS)
    _print_row(["---"] * len(_COLUMNS))
    for number in chosen.graphs or range(len(graphs)):
        with tempfile.TemporaryDirectory(prefix="tunable_") as folder:
            _print_row(_row(graphs[number], Path(folder), settings))


def _row(graph: TunableGraph, folder: Path, settings: SearchSettings) -> list[str]:
    selection = SpecSelection(write_graph(graph, folder / "graph"))
    prepared = api.prepare(selection)

    def tell(line: str) -> None:
        sys.stderr.write(f"{graph.name}: {line}\n")

    result = tune(
        selection,
        prepared,
        folder / "search",
        settings,
        minimize="cpu.graph.mean",
        player=ThisHost(),
        tell=tell,
    )
    tell(f"{result.outcome}: {result.reason}")
    again = ""
    if result.is_proved and result.winner is not None:
        goal = goal_of(prepared.plan, "cpu.graph.mean")
        machine = RealMachine(selection, folder, goal, ThisHost())
        terms = Terms(limit_s=settings.budget_s)
        seen = machine.compare(result.space.today(), result.winner, settings.pairs, "again", terms)
        again = f"{claim_text(seen.gain)}; {'meets' if seen.head_meets else 'not shown to meet'}"
    return [
        graph.name,
        f"{result.space.size:,}",
        str(len(result.trials)),
        f"{result.duration_s / 60:.1f}",
        "yes" if _is_met(result) else "no",
        result.outcome,
        result.winner.text if result.winner is not None else "-",
        claim_text(result.proof) if result.proof is not None else "-",
        again or "-",
    ]


def _is_met(result: TuningResult) -> bool:
    """Whether the search ends with a deployment that is shown to meet the objectives."""
    return result.outcome in {"improved", "meets", "met today"}


def _print_row(texts: list[str] | tuple[str, ...]) -> None:
    sys.stdout.write(f"| {' | '.join(texts)} |\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
