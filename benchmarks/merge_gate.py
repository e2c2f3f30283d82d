"""How often the merge gate errs on real pull requests: neutral ones, and ones 15 % slower.

Each is a repository of its own, gated by ``r2bspec gate --base main`` on real ROS 2, one after
the other. Prints a row for each kind, with the load of the machine. What a gate that ends in an
error has printed, and its run folder, are kept in a folder that is named on standard error. The
r2bspec that gates is the one that is installed: it must not change meanwhile. Usage::

    PYTHONPATH=tests/support python benchmarks/merge_gate.py [--each 10] [--pairs 5]
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import tempfile
from collections import Counter
from pathlib import Path

from measuring import options, show, table, tell

from pull_requests import SPEC, Gated, Workspace, spec

OUTCOMES = {0: "PASS", 1: "FAIL", 3: "INCONCLUSIVE"}
COST_MS = {"neutral": 20.0, "15 % slower": 23.0}


def main() -> None:
    """Gate the pull requests, and print the table."""
    parser = options(__doc__)
    parser.add_argument("--each", type=int, default=10, help="pull requests of each kind")
    parser.add_argument("--pairs", type=int, default=5)
    given = parser.parse_args()
    head = ("pull request", *OUTCOMES.values(), "error", "ratio, min … max", "load")
    for line in table(head, (row(kind, given.each, given.pairs) for kind in COST_MS)):
        show(line)


def row(kind: str, number: int, pairs: int) -> list[str]:
    """The outcomes of so many pull requests of a kind."""
    outcomes: Counter[str] = Counter()
    ratios, loads = [], []
    for _ in range(number):
        loads.append(os.getloadavg()[0])
        with tempfile.TemporaryDirectory() as folder:
            outcome, ratio = gated(Path(folder), COST_MS[kind], pairs)
        outcomes[outcome] += 1
        ratios += [ratio] if ratio is not None else []
    counts = [str(outcomes[name]) for name in (*OUTCOMES.values(), "error")]
    span = f"{min(ratios):.3f} … {max(ratios):.3f}" if ratios else ""
    return [kind, *counts, span, f"{statistics.median(loads):.1f}"]


def gated(folder: Path, cost_ms: float, pairs: int) -> tuple[str, float | None]:
    """The outcome of one pull request, and the ratio that it showed."""
    workspace = Workspace.create(folder)
    gate = {"duration": "1 s", "iterations": pairs, "rates": ["20 Hz"], "warm_up": "100 ms"}
    workspace.change({SPEC: spec(benchmark=gate)}, on_main=True)
    workspace.set_cost(cost_ms)
    if cost_ms == COST_MS["neutral"]:
        workspace.change({"README.md": "A change that changes no code.\n"})
    done = workspace.gate("--quiet")
    result = done.folder / "result.json"
    if done.status not in OUTCOMES or not result.exists():
        place = keep_output(done)
        tell(f"exit status {done.status}: its output is kept in {place}")
        return "error", None
    requirements = json.loads(result.read_text())["verdict"]["requirements"]
    ratio = next(one["estimate"] for one in requirements if one["objective"] == "fast")
    return OUTCOMES[done.status], ratio


def keep_output(done: Gated) -> Path:
    """Keep what a gate printed, and its run folder; the folder that has them."""
    place = Path(tempfile.mkdtemp(prefix="r2bspec-bench-"))
    (place / "exit_status").write_text(f"{done.status}\n")
    (place / "output").write_text(done.said)
    if done.folder.exists():
        shutil.copytree(done.folder, place / "run", symlinks=True)
    return place


if __name__ == "__main__":
    main()
