"""What a worker of a fleet costs the host that it waits on, and what of it a benchmark sees.

    python tests/bench/fleet_idle_cost.py [--rounds 5] [--seconds 20]

Three conditions take turns in every round, so that what else the machine does meets all of them:
no worker; the worker of `r2bspec fleet worker`; and a worker of the same slot with the settings of
Dask (`dask worker`, with its nanny). In each, CPU time and wake-ups of the processes of the worker
are counted for some seconds, and a relay is run, of which the harness overhead has the p99 of the
floor. Differences are medians of the rounds, with the range of the rounds themselves.

Prints a Markdown table. Asserts nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import psutil

from r2bspec.record.run_folder import open_run

_SPEC = Path("specs/relay.r2b.yaml")
_RATE = "30 Hz"


class Cost(NamedTuple):
    """Of one round: shares of a core, wake-ups a second, and the floor in microseconds."""

    cpu: float
    wakeups: float
    floor_us: float


def main() -> None:
    """Measure every condition in turn, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    conditions = {"none": None, "r2bspec fleet worker": _quiet, "dask worker": _default}
    found: dict[str, list[Cost]] = {name: [] for name in conditions}
    with tempfile.TemporaryDirectory() as folder, _scheduler() as address:
        for number in range(options.rounds):
            for name, words in conditions.items():
                place = Path(folder, f"{number}-{name.replace(' ', '-')}")
                found[name].append(_measure(words and words(address, place), place, options))
    sys.stdout.write("| worker | CPU | wake-ups a second | p99 of the floor | than without |\n")
    sys.stdout.write("| --- | --- | --- | --- | --- |\n")
    for name, costs in found.items():
        _print_row(name, costs, found["none"])


def _print_row(name: str, costs: list[Cost], without: list[Cost]) -> None:
    more = [each.floor_us - bare.floor_us for each, bare in zip(costs, without, strict=True)]
    low, high = min(more), max(more)
    shown = (
        "" if name == "none" else f"{statistics.median(more):+.0f} ({low:+.0f} to {high:+.0f}) µs"
    )
    sys.stdout.write(
        f"| {name} | {100 * statistics.median(each.cpu for each in costs):.2f} % "
        f"| {statistics.median(each.wakeups for each in costs):.1f} "
        f"| {statistics.median(each.floor_us for each in costs):.0f} µs | {shown} |\n"
    )


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


def _measure(words: list[str] | None, place: Path, options: argparse.Namespace) -> Cost:
    place.mkdir()
    with contextlib.ExitStack() as stack:
        idle = (0.0, 0.0)
        if words is not None:
            worker = stack.enter_context(_started(words, place))
            idle = _idle_cost(worker, options.seconds)
        return Cost(*idle, _floor_us(place))


def _idle_cost(worker: psutil.Process, seconds: float) -> tuple[float, float]:
    """CPU time per time, and wake-ups a second, of a process and its children."""
    processes = [worker, *worker.children(recursive=True)]
    began = time.monotonic()
    before = [_counters(each) for each in processes]
    time.sleep(seconds)
    after = [_counters(each) for each in processes]
    elapsed = time.monotonic() - began
    pairs = [(new[0] - old[0], new[1] - old[1]) for old, new in zip(before, after, strict=True)]
    return sum(cpu for cpu, _ in pairs) / elapsed, sum(count for _, count in pairs) / elapsed


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


def _floor_us(place: Path) -> float:
    text = _SPEC.read_text().split("\nbenchmark:")[0]
    text += f"\nbenchmark:\n  duration: 1 s\n  iterations: 1\n  starts: 1\n  rates: [{_RATE}]\n"
    spec = _SPEC.parent / f".{place.name}-{os.getpid()}.r2b.yaml"
    spec.write_text(text)
    try:
        subprocess.run(
            [
                *(sys.executable, "-m", "r2bspec", "run", str(spec), "--quiet", "--no-lock"),
                *("--output", str(place / "run")),
            ],
            check=False,
            capture_output=True,
        )
    finally:
        spec.unlink()
    floors = [each.latency_p99_ns for each in open_run(place / "run").record.floor]
    return max(each for each in floors if each is not None) / 1e3


@contextlib.contextmanager
def _scheduler() -> Iterator[str]:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{found.getsockname()[1]}"
    words = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
    with (
        tempfile.TemporaryDirectory() as folder,
        _started([*words, "--host", address], Path(folder)),
    ):
        yield address


@contextlib.contextmanager
def _started(words: list[str], place: Path) -> Iterator[psutil.Process]:
    """A process, when it has said that it is ready."""
    log = place / "log"
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
        process.wait()


if __name__ == "__main__":
    main()
