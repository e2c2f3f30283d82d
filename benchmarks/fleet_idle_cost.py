"""What a worker of a fleet costs the host that it waits on, and what of it a benchmark sees.

    python benchmarks/fleet_idle_cost.py [--rounds 24] [--seconds 2.5] [--idle 30]

Takes about five minutes, and needs a machine that does nothing else. A worker of
`r2bspec fleet worker` and one with the settings of Dask (`dask worker`, with its nanny) wait for
the same scheduler.

First their CPU time and wake-ups are counted for `--idle` seconds. Then player and monitor play to
each other, with nothing between them, in slots of `--seconds`. In every round each condition has
one slot, in random order: no worker, no worker once more, and each of the two. A worker whose slot
it is not is stopped by a signal, and has no wake-ups then; when it goes on, what is overdue comes
first. So each slot of r2bspec has a heartbeat, which is four times as many as usual.

A ratio is that of a slot to the slot without a worker of the same round. Its interval is one of
the median, from the ranks of the ratios: it has at least 95 % confidence whatever their
distribution, as in the sign test. "within noise" says that it contains 1; the second slot without
a worker shows how wide noise is here.

Prints a Markdown table. Asserts nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import psutil
from floor_figures import Figures
from floor_harness import Floor, floor
from floor_workloads import WORKLOADS
from scipy.stats import binom

NONE, AGAIN, QUIET, DASK = "none", "none, again", "r2bspec fleet worker", "dask worker"

_WORKLOAD = WORKLOADS[1]
_CONFIDENCE = 0.95


class Idle(NamedTuple):
    """CPU time per time, and wake-ups a second."""

    cpu: float
    wakeups: float


class Interval(NamedTuple):
    """Of the median of ratios."""

    low: float
    median: float
    high: float

    def __str__(self) -> str:
        return f"{self.median:.3f} ({self.low:.3f} to {self.high:.3f})"

    @property
    def is_noise(self) -> bool:
        """Whether a ratio of 1 is possible."""
        return self.low <= 1 <= self.high


def main() -> None:
    """Count, play, and print the table."""
    options = _options()
    began = time.monotonic()
    loads = [os.getloadavg()[0]]
    with contextlib.ExitStack() as stack:
        place = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        address = stack.enter_context(_scheduler())
        workers = {
            name: stack.enter_context(_started(words(address, place / name[:4]), place))
            for name, words in ((QUIET, _quiet), (DASK, _default))
        }
        idle = _idle_costs(workers, options.idle)
        with floor(_WORKLOAD, "shared_memory", "two processes") as ready:
            found = _slots(ready, workers, options, loads)
    for line in _table(idle, found):
        sys.stdout.write(f"{line}\n")
    sys.stdout.write(
        f"\n{options.rounds} rounds of {options.seconds:g} s, {_WORKLOAD.name}; "
        f"{len(os.sched_getaffinity(0))} cores, load average {statistics.median(loads):.1f} "
        f"(median), {max(loads):.1f} (most); took {time.monotonic() - began:.0f} s.\n"
    )


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=2.5)
    parser.add_argument("--idle", type=float, default=30.0)
    return parser.parse_args()


def _slots(
    ready: Floor,
    workers: dict[str, psutil.Process],
    options: argparse.Namespace,
    loads: list[float],
) -> dict[str, list[Figures]]:
    """The figures of every slot, by condition, in the order of the rounds."""
    found: dict[str, list[Figures]] = {name: [] for name in (NONE, AGAIN, QUIET, DASK)}
    order = random.Random(1)  # noqa: S311 - any order will do
    for number in range(options.rounds):
        for name in order.sample(list(found), len(found)):
            with _only(workers, name):
                found[name].append(ready.measure(_WORKLOAD.rate_hz, options.seconds))
        loads.append(os.getloadavg()[0])
        sys.stderr.write(f"round {number + 1} of {options.rounds}\n")
    return found


@contextlib.contextmanager
def _only(workers: dict[str, psutil.Process], name: str) -> Iterator[None]:
    """Let this worker wait as usual, and stop the others; all go on in the end."""
    stopped = [each for other, worker in workers.items() if other != name for each in _tree(worker)]
    try:
        for each in stopped:
            each.send_signal(signal.SIGSTOP)
        yield
    finally:
        for each in stopped:
            each.send_signal(signal.SIGCONT)


def _table(idle: dict[str, Idle], found: dict[str, list[Figures]]) -> Iterator[str]:
    yield "| worker | CPU | wake-ups a second | floor p50 | p99 | p50 to none | p99 to none |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for name, figures in found.items():
        cost = idle.get(name)
        cells = [name, *(("-", "-") if cost is None else _idle_cells(cost))]
        for which in ("received_p50", "received_p99"):
            median_ms = statistics.median(getattr(each, which) for each in figures)
            cells.append(f"{1000 * median_ms:.0f} µs")
        for which in ("received_p50", "received_p99"):
            ratios = [
                getattr(each, which) / getattr(bare, which)
                for each, bare in zip(figures, found[NONE], strict=True)
            ]
            cells.append("1" if name == NONE else _shown(ratio_interval(ratios)))
        yield f"| {' | '.join(cells)} |"


def _idle_cells(cost: Idle) -> tuple[str, str]:
    return f"{100 * cost.cpu:.2f} %", f"{cost.wakeups:.1f}"


def _shown(ratio: Interval) -> str:
    return f"{ratio}, {'within noise' if ratio.is_noise else 'differs'}"


def ratio_interval(ratios: Sequence[float]) -> Interval:
    """The median of ratios with an interval from their ranks; all of them if they are too few."""
    ordered = sorted(ratios)
    left_out = max(0, int(binom.ppf((1 - _CONFIDENCE) / 2, len(ordered), 0.5)) - 1)
    return Interval(ordered[left_out], statistics.median(ordered), ordered[-1 - left_out])


def _quiet(address: str, place: Path) -> list[str]:
    return [
        *(sys.executable, "-m", "r2bspec", "fleet", "worker", address),
        *("--name", place.name, "--folder", str(place / "host"), "--no-doctor"),
    ]


def _default(address: str, place: Path) -> list[str]:
    return [
        *(sys.executable, "-m", "distributed.cli.dask_worker", address),
        *("--name", place.name, "--nthreads", "1", "--local-directory", str(place / "host")),
        *("--no-dashboard", "--resources", "r2bspec-host=1"),
    ]


def _tree(worker: psutil.Process) -> list[psutil.Process]:
    return [worker, *worker.children(recursive=True)]


def _idle_costs(workers: dict[str, psutil.Process], seconds: float) -> dict[str, Idle]:
    """What every worker uses with its children, in the same seconds."""
    trees = {name: _tree(worker) for name, worker in workers.items()}
    began = time.monotonic()
    before = {name: [_counters(each) for each in tree] for name, tree in trees.items()}
    time.sleep(seconds)
    after = {name: [_counters(each) for each in tree] for name, tree in trees.items()}
    elapsed = time.monotonic() - began
    found = {}
    for name in trees:
        pairs = list(zip(before[name], after[name], strict=True))
        found[name] = Idle(
            sum(new[0] - old[0] for old, new in pairs) / elapsed,
            sum(new[1] - old[1] for old, new in pairs) / elapsed,
        )
    return found


def _counters(process: psutil.Process) -> tuple[float, int]:
    """CPU seconds, and how often the threads of a process gave up their CPU to wait."""
    wakeups = 0
    for status in Path(f"/proc/{process.pid}/task").glob("*/status"):
        for line in status.read_text().splitlines():
            if line.startswith("voluntary_ctxt_switches:"):
                wakeups += int(line.split()[1])
    # Finer than the ticks of `stat`: nanoseconds of the scheduler.
    run_ns = sum(
        int(each.read_text().split()[0])
        for each in Path(f"/proc/{process.pid}/task").glob("*/schedstat")
    )
    return run_ns / 1e9, wakeups


@contextlib.contextmanager
def _scheduler() -> Iterator[str]:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{found.getsockname()[1]}"
    words = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
    words += ["--dashboard-address", "127.0.0.1:0"]
    with (
        tempfile.TemporaryDirectory() as folder,
        _started([*words, "--host", address], Path(folder)),
    ):
        yield address


@contextlib.contextmanager
def _started(words: list[str], place: Path) -> Iterator[psutil.Process]:
    """A process, when it has said that it is ready."""
    log = place / f"log-{time.monotonic_ns()}"
    with log.open("wb") as output:
        process = subprocess.Popen(words, stdout=output, stderr=output)
    try:
        while not any(
            each in log.read_text() for each in ("is in the fleet", "Registered to", "Scheduler at")
        ):
            time.sleep(0.1)
            if process.poll() is not None:
                raise RuntimeError(log.read_text())
        time.sleep(2)  # what a start still does
        yield psutil.Process(process.pid)
    finally:
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


if __name__ == "__main__":
    main()
