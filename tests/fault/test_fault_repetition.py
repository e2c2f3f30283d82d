"""Promise: a program that runs benchmark after benchmark keeps nothing of those that are over."""

from __future__ import annotations

import gc
import threading
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest

from nightly import size

pytest.importorskip("rclpy")

from r2bspec import api
from r2bspec.api import GraphMismatchError
from r2bspec.execute.states import Progress
from r2bspec.middleware.fast_dds import shm_files
from ros_runs import Bench, left_behind, note_segments, relay_spec

RUNS = size(3, 20)

NODES = """
class Broken(Node):
    def __init__(self, **kwargs):
        super().__init__("broken", **kwargs)
        self.out = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", self.out.publish, 10)
        raise ValueError("never comes up")
"""


@dataclass(frozen=True)
class Held:
    """What this process holds."""

    descriptors: int
    children: int
    threads: int

    @classmethod
    def now(cls) -> Held:
        gc.collect()
        return cls(
            descriptors=len(list(Path("/proc/self/fd").iterdir())),
            children=len(psutil.Process().children(recursive=True)),
            threads=threading.active_count(),
        )


class Noting(Progress):
    """Takes note of the shared memory of a run while it plays."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._before = set(shm_files())
        self.noted: Counter[str] = Counter()

    def phase(self, name: str, text: str) -> None:  # noqa: ARG002 - what it must look like
        if name in {"start", "play"}:
            note_segments(self._bench, self._before)
            self.noted[name] += 1


def test_run_after_run_nothing_grows(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.write_node("nodes.py", NODES)
    whole = relay_spec()
    whole["benchmark"] |= {"duration": "200 ms", "warm_up": "100 ms"}
    broken = relay_spec(graph={"nodes": {"relay": {"python": "./nodes.py:Broken"}}})
    prepared = {
        name: api.prepare(bench.write(spec, name))
        for name, spec in (("whole", whole), ("broken", broken))
    }
    progress = Noting(bench)
    before, held = Held.now(), []
    for number in range(RUNS):
        folder = tmp_path / f"run{number}"
        if number % 2:
            with pytest.raises(GraphMismatchError, match="never comes up"):
                api.run(prepared["broken"], folder, progress)
        else:
            api.run(prepared["whole"], folder, progress)
        held.append(Held.now())
    # The first two load what stays loaded: modules, and pools of threads of NumPy.
    for each in held[2:]:
        assert each.descriptors == held[1].descriptors
        assert each.children == before.children
        assert each.threads == held[1].threads
    assert progress.noted == {"play": (RUNS + 1) // 2, "start": RUNS}
    assert left_behind() == []
