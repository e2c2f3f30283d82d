"""What the merge gate makes of pull requests beside busy programs.

    python benchmarks/merge_gate.py [--count 10] [--busy 0 2 3] [--node python c]

Each pull request changes a node that computes for each image: its loop is 15 % longer, or as long
as before. `r2bspec gate` compares it with the branch it left, beside programs that keep a processor
busy. Prints Markdown, of which docs/gate.md has a part; asserts nothing. Ten of each kind take
about ten minutes for each number of busy programs and each node.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from measuring import machine, options, show, table, tell

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/support"))

import yaml

from busy_programs import busy_programs
from c_nodes import c_node
from git_repositories import commit, git
from ros_runs import IMAGE, NODE_IMPORTS, WORKER, quick_input, write_bag

STEPS = {"python": 100_000, "c": 10_000_000}
"""Of the loop for each image: 5 to 10 ms."""

KINDS = {"15 % more work": 1.15, "neutral": 1.0}
SPEC = "bench/worker.r2b.yaml"


@dataclass(frozen=True)
class Gated:
    """What a pull request came to.

    Attributes:
        status: the exit status of the gate.
        ratio: of the work, head to base; None if nothing was compared.
        starts: of both sides.
        seconds: from the call to the verdict.
    """

    status: int
    ratio: float | None
    starts: int
    seconds: float


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--count", type=int, default=10, help="pull requests of each kind")
    parser.add_argument("--busy", type=int, nargs="+", default=[0, 2, 3], help="busy programs")
    parser.add_argument("--node", choices=STEPS, nargs="+", default=["python"])
    given = parser.parse_args()
    head = (
        "node",
        "busy programs",
        *KINDS,
        "work of both kinds",
        "starts",
        "time: median, longest",
    )
    show(f"{machine()}; {given.count} pull requests of each kind.", "")
    show(*table(head, list(_rows(given))))


def _rows(given: argparse.Namespace) -> Iterator[list[str]]:
    for node in given.node:
        for busy in given.busy:
            came_to: dict[str, list[Gated]] = {kind: [] for kind in KINDS}
            with tempfile.TemporaryDirectory() as folder, busy_programs(busy):
                top = Path(folder) / "workspace"
                _create(top, node)
                for number in range(given.count):
                    for kind, factor in KINDS.items():
                        _change(top, node, factor, number)
                        gated = _gate(top)
                        came_to[kind].append(gated)
                        tell(f"{node}, {busy} busy, {kind} {number + 1}: {gated}")
            yield _row(node, busy, came_to)


def _row(node: str, busy: int, came_to: dict[str, list[Gated]]) -> list[str]:
    every = [gated for several in came_to.values() for gated in several]
    cells = [node, str(busy)]
    names = {0: "PASS", 1: "FAIL", 2: "error", 3: "open", 4: "error"}
    for several in came_to.values():
        outcomes = [names.get(gated.status, "error") for gated in several]
        counts = {name: outcomes.count(name) for name in dict.fromkeys(outcomes)}
        cells.append(", ".join(f"{count} {name}" for name, count in counts.items()))
    ratios = [
        f"{statistics.median(known):.2f}"
        for several in came_to.values()
        if (known := [gated.ratio for gated in several if gated.ratio is not None])
    ]
    seconds = [gated.seconds for gated in every]
    cells += [", ".join(ratios), f"{statistics.median(gated.starts for gated in every):.0f}"]
    cells.append(f"{statistics.median(seconds):.0f} s, {max(seconds):.0f} s")
    return cells


def _create(top: Path, node: str) -> None:
    """Make a repository with the base on ``main``, and check out a branch of it."""
    write_bag(top / "bench/drive", {"/camera": [50 * at for at in range(20)]})
    worker: dict[str, Any] = {"parameters": "../config/worker.yaml"}
    if node == "python":
        worker["python"] = "../src/worker.py:Worker"
    else:
        worker |= {"command": ["../bin/worker"]}
        worker |= {"subscribes": {"input": IMAGE}, "publishes": {"output": IMAGE}}
        (top / "bin").mkdir()
        shutil.copy2(c_node("relay"), top / "bin/worker")
    spec = {
        "r2bspec": 1,
        "name": "worker",
        "data_loader": {"bag": "./drive", "topics": {"/camera": "loaded"}},
        "playback": {"buffer": 5, "inputs": {"input": quick_input("loaded")}},
        "graph": {"nodes": {"worker": worker}},
        "monitors": {"out": {"topic": "output", "format": IMAGE}},
        "benchmark": {
            "duration": "1 s",
            "iterations": 3,
            "rates": ["20 Hz"],
            "warm_up": "300 ms",
        },
        "slos": {
            "cost": {"at": "20 Hz", "require": ["work.graph.p50 <= 105 % of baseline"]},
            "fast": {"at": "20 Hz", "require": ["latency.p90 < 500 ms"]},
        },
    }
    commit(
        top,
        {
            "src/worker.py": NODE_IMPORTS + WORKER,
            SPEC: yaml.safe_dump(spec),
            ".gitignore": "runs/\n",
        },
    )
    _change(top, node, 1.0, -1)
    git(top, "checkout", "--quiet", "-b", "change")


def _change(top: Path, node: str, factor: float, number: int) -> None:
    """Commit the cost of an image, and a comment that differs from that of the base."""
    parameters = f"# {number}\n/**:\n  ros__parameters:\n    steps: {round(STEPS[node] * factor)}\n"
    commit(top, {"config/worker.yaml": parameters})


def _gate(top: Path) -> Gated:
    out = top / "runs"
    shutil.rmtree(out, ignore_errors=True)
    begin = time.monotonic()
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "r2bspec",
            "gate",
            SPEC,
            "--base",
            "main",
            "--no-lock",
            "-o",
            str(out),
        ],
        cwd=top,
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.monotonic() - begin
    try:
        (path,) = out.rglob("result.json")
        work = json.loads(path.read_text())["verdict"]["requirements"][0]
    except ValueError:
        tell(done.stderr)
        return Gated(done.returncode, None, 0, seconds)
    return Gated(done.returncode, work["estimate"], len(work["compared"]["head_values"]), seconds)


if __name__ == "__main__":
    main()
