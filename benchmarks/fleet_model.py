"""A night of 1,000 hosts and 10,000 runs on paper, with costs per run that are measured here.

    python benchmarks/fleet_model.py [--requests 200] [--hosts 1000] [--runs 10000] [--hours 8]

Measured on a real scheduler with one real worker: CPU time of scheduler, client and worker for a
request, for a mebibyte that passes, and for a heartbeat; and for a run of specs/relay.r2b.yaml, the
size of its archive and the CPU time with which a client unpacks, measures and judges it again.

The model multiplies. A run takes one offer, one play, the pieces of its archive and one drop.
What client and hosts exchange goes through the scheduler, so each byte passes its link twice.

Prints a table of costs, and one of shares of a night. Asserts nothing.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import math
import socket
import subprocess
import sys
import tarfile
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import psutil

from r2bspec.compare.report_input import read_folder
from r2bspec.fleet.bundle import SentFile
from r2bspec.fleet.client import FleetClient
from r2bspec.fleet.hosts import Host
from r2bspec.fleet.security import fleet_address
from r2bspec.fleet.transfer import PIECE_BYTES
from r2bspec.fleet.worker import HEARTBEAT_S

_LINK_MB_S = 117.0
"""A gigabit network, without its headers."""

_MIB = 1 << 20


class Costs(NamedTuple):
    """CPU seconds of scheduler, client and worker."""

    scheduler: float
    client: float
    worker: float

    def __truediv__(self, number: float) -> Costs:
        return Costs(*(each / number for each in self))


def main() -> None:
    """Measure, and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--requests", type=int, default=200)
    parser.add_argument("--hosts", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--hours", type=float, default=8.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        archive_bytes, judge_s = _run_costs(Path(folder))
        request, piece, info, heartbeat = _fleet_costs(Path(folder), options.requests)
    _print_costs(request, piece, info, heartbeat, archive_bytes, judge_s)
    _print_night(options, request, piece, info, heartbeat, archive_bytes, judge_s)


def _run_costs(folder: Path) -> tuple[int, float]:
    """The size of the archive of a run, and the CPU seconds with which a client judges it."""
    run = folder / "run"
    text = Path("specs/relay.r2b.yaml").read_text().split("\nbenchmark:")[0]
    text += "\nbenchmark: {duration: 1 s, iterations: 10, starts: 1, rates: [30 Hz]}\n"
    spec = Path("specs") / f".{folder.name}.r2b.yaml"
    spec.write_text(text)
    words = [sys.executable, "-m", "r2bspec", "run", str(spec), "--quiet", "--no-lock"]
    try:
        subprocess.run([*words, "--output", str(run)], check=False, capture_output=True)
    finally:
        spec.unlink()
    archive = folder / "run.tar.gz"
    with tarfile.open(archive, "w:gz", compresslevel=1) as tar:
        tar.add(run, arcname=".")
    read_folder(run)  # imports
    began = time.process_time()
    with tarfile.open(archive) as tar:
        tar.extractall(folder / "unpacked", filter="data")
    read_folder(folder / "unpacked")
    return archive.stat().st_size, time.process_time() - began


def _fleet_costs(folder: Path, number: int) -> tuple[Costs, Costs, float, float]:
    """CPU of a request, of a mebibyte, of asking for one host, and of a heartbeat."""
    with _processes(folder) as (address, scheduler, worker):
        with FleetClient(fleet_address(address)) as client:
            host = client.hosts["model"]
            client.submit(host, "drop", "none").result()

            def ask_often() -> None:
                for _ in range(number):
                    client.submit(host, "drop", "none").result()

            request = _cpu(scheduler, worker, ask_often) / number
            pieces = 8
            passing = _cpu(scheduler, worker, lambda: _send(client, host, pieces))
            whole = Costs(*(a - pieces * b for a, b in zip(passing, request, strict=True)))
            piece = whole / (pieces * PIECE_BYTES / _MIB)
            asked = _cpu(scheduler, worker, lambda: [client.refresh() for _ in range(number)])
            info = asked.scheduler / number
        heartbeat = _heartbeat_cost(address, scheduler, number)
    return request, piece, info, heartbeat


def _send(client: FleetClient, host: Host, pieces: int) -> None:
    content = bytes(PIECE_BYTES)
    file = SentFile(path="model", size=2 * pieces * PIECE_BYTES, sha256="0" * 64)
    for number in range(pieces):
        client.submit(host, "put", file, number * PIECE_BYTES, content).result()


def _cpu(scheduler: psutil.Process, worker: psutil.Process, work: Callable[[], object]) -> Costs:
    parts = (scheduler, psutil.Process(), worker)
    before = [sum(each.cpu_times()[:2]) for each in parts]
    work()
    return Costs(
        *(sum(each.cpu_times()[:2]) - old for each, old in zip(parts, before, strict=True))
    )


def _heartbeat_cost(address: str, scheduler: psutil.Process, number: int) -> float:
    """CPU seconds of the scheduler for a heartbeat, from workers that send nothing else."""

    async def beat() -> float:
        from distributed import Worker

        async with Worker(address, nthreads=1, memory_limit=0, dashboard=False) as worker:
            before = sum(scheduler.cpu_times()[:2])
            for _ in range(number):
                await worker.heartbeat()
            return (sum(scheduler.cpu_times()[:2]) - before) / number

    found: list[float] = []
    thread = threading.Thread(target=lambda: found.append(asyncio.run(beat())))
    thread.start()
    thread.join()
    return found[0]


@contextlib.contextmanager
def _processes(folder: Path) -> Iterator[tuple[str, psutil.Process, psutil.Process]]:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{found.getsockname()[1]}"
    log = (folder / "log").open("wb")
    words = [
        [*(sys.executable, "-m", "distributed.cli.dask_scheduler"), "--no-dashboard"],
        [*(sys.executable, "-m", "r2bspec", "fleet", "worker", address), "--name", "model"],
    ]
    words[0] += ["--dashboard-address", "127.0.0.1:0", "--host", address]
    words[1] += ["--folder", str(folder / "host"), "--no-doctor"]
    with log, contextlib.ExitStack() as stack:
        started = []
        for each in words:
            process = subprocess.Popen(each, stdout=log, stderr=log)
            stack.callback(process.wait)
            stack.callback(process.terminate)
            started.append(psutil.Process(process.pid))
        while "is in the fleet" not in (folder / "log").read_text():
            time.sleep(0.1)
        yield address, started[0], started[1]


def _print_costs(
    request: Costs, piece: Costs, info: float, heartbeat: float, archive_bytes: int, judge_s: float
) -> None:
    sys.stdout.write("| cost | scheduler | client | worker |\n| --- | --- | --- | --- |\n")
    for name, costs in (("a request", request), ("a MiB that passes", piece)):
        shown = " | ".join(f"{1000 * each:.2f} ms" for each in costs)
        sys.stdout.write(f"| {name} | {shown} |\n")
    sys.stdout.write(f"| a heartbeat | {1000 * heartbeat:.2f} ms | - | - |\n")
    sys.stdout.write(f"| the state of one host | {1000 * info:.2f} ms | - | - |\n")
    sys.stdout.write(f"| judging a run again | - | {1000 * judge_s:.0f} ms | - |\n")
    sys.stdout.write(f"\nThe archive of a run has {archive_bytes / 1000:.0f} kB.\n\n")


def _print_night(
    options: argparse.Namespace,
    request: Costs,
    piece: Costs,
    info: float,
    heartbeat: float,
    archive_bytes: int,
    judge_s: float,
) -> None:
    night_s = options.hours * 3600
    requests = 3 + math.ceil(archive_bytes / PIECE_BYTES)
    mib = archive_bytes / _MIB
    beats = night_s / HEARTBEAT_S * options.hosts
    asked = night_s * 50
    scheduler_s = (
        options.runs * (requests * request.scheduler + mib * piece.scheduler)
        + beats * heartbeat
        + asked * info
    )
    client_s = options.runs * (requests * request.client + mib * piece.client + judge_s)
    link_s = options.runs * 2 * archive_bytes / 1e6 / _LINK_MB_S
    recording_s = options.hosts * 2 * 1000 / _LINK_MB_S
    rows = (
        ("runs: requests and archives, scheduler", scheduler_s - beats * heartbeat - asked * info),
        ("heartbeats, scheduler", beats * heartbeat),
        ("states for the table of one client, scheduler", asked * info),
        ("scheduler together", scheduler_s),
        ("client", client_s),
        ("link of the scheduler, archives", link_s),
        ("link of the scheduler, a recording of 1 GB to every host", recording_s),
    )
    sys.stdout.write("| part | busy | share of the night |\n| --- | --- | --- |\n")
    for name, seconds in rows:
        sys.stdout.write(f"| {name} | {seconds:.0f} s | {100 * seconds / night_s:.1f} % |\n")


if __name__ == "__main__":
    main()
