"""How often what is measured lies in the 90 % intervals of `r2bspec predict`.

    PYTHONPATH=tests/support python benchmarks/predict_coverage.py [GRAPH ...]

Each graph is played once with its anatomy, at a rate that it keeps up with, and predicted at other
rates and in other placements. Each of these is then played, and its percentiles are compared with
the intervals. Run it on a machine that has nothing else to do: after a disturbed run nothing is
known.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from r2bspec import api
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.samples import SegmentSamples
from r2bspec.judge.measure.times import percentile
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.record.run_folder import Run, open_run
from r2bspec.tune.predict import PERCENTILES, Predictor
from r2bspec.tune.prediction import Estimate
from tunable_graphs import TunableGraph, tunable_graphs, write_graph

_OBSERVED: Final = (
    "slos={}",  # at the rate of the spec
    "benchmark.starts=1",
    "benchmark.iterations=2",
    "benchmark.duration=8 s",
    "benchmark.rates=['5 Hz']",
)
_TARGETS: Final = (
    ("benchmark.rates=['3 Hz']",),
    ("benchmark.rates=['6 Hz']",),
    ("benchmark.rates=['10 Hz']",),
    ("graph.placement=shared",),
    ("graph.placement=separate",),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("graphs", nargs="*", type=int, help="numbers, from 0; default: all")
    graphs = list(tunable_graphs())
    sys.stdout.write("| graph | percentiles | known | inside |\n| --- | --- | --- | --- |\n")
    total = Counter[str]()
    for number in parser.parse_args().graphs or range(len(graphs)):
        with tempfile.TemporaryDirectory(prefix="predicted_") as folder:
            counts = _covered(graphs[number], Path(folder))
        total += counts
        _print_row(graphs[number].name, counts)
    _print_row("all", total)


def _print_row(name: str, counts: Counter[str]) -> None:
    sys.stdout.write(f"| {name} | {counts['all']} | {counts['known']} | {counts['inside']} |\n")
    sys.stdout.flush()


def _covered(graph: TunableGraph, folder: Path) -> Counter[str]:
    """Of how many percentiles something is known, and how many lie in their interval."""
    spec = write_graph(graph, folder / "graph")
    predictor = Predictor(_played(spec, _OBSERVED, folder / "run", anatomy=True))
    counts = Counter[str]()
    for number, sets in enumerate(_TARGETS):
        prepared = api.prepare(SpecSelection(spec, sets=(*_OBSERVED, *sets)))
        measured = read_samples(_played(spec, (*_OBSERVED, *sets), folder / f"{number}"))
        estimates = {
            (each.monitor, each.metric, each.rate_hz): each.estimate
            for each in predictor.predict(prepared.plan).latencies
        }
        for rate_hz, iterations in measured.iterations.items():
            for monitor in prepared.plan.monitors:
                for name in PERCENTILES:
                    key = (monitor.name, f"latency.{name}", rate_hz)
                    value = _measured(iterations, monitor.name, int(name[1:]) / 100)
                    counts.update(_held(estimates.get(key, Estimate()), value))
    return counts


def _measured(iterations: Sequence[SegmentSamples], monitor: str, share: float) -> float | None:
    seen = [one.monitors[monitor] for one in iterations]
    times = np.concatenate([each.times["latency"] for each in seen])
    return percentile(times, share, sum(each.missed for each in seen))


def _held(estimate: Estimate, value: float | None) -> Counter[str]:
    low, high = estimate.low, estimate.high
    is_known = low is not None and high is not None
    inside = low is not None and high is not None and value is not None and low <= value <= high
    return Counter({"all": 1, "known": int(is_known), "inside": int(inside)})


def _played(spec: Path, sets: tuple[str, ...], folder: Path, *, anatomy: bool = False) -> Run:
    prepared = api.prepare(SpecSelection(spec, sets=sets))
    api.run(prepared, folder, anatomy=anatomy, lock="off")
    return open_run(folder)


if __name__ == "__main__":
    main()
