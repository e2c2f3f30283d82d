"""A fleet on this machine: a real scheduler and workers, which share the lock of the host."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from r2bspec.execute.host_queue import DISABLED_BY
from ros_runs import relay_spec

HANG_S = 400.0
"""Guards against hanging only."""


def wait_until(is_so: Callable[[], bool], what: str) -> None:
    """Wait for something observable."""
    deadline = time.monotonic() + HANG_S
    while not is_so():
        assert time.monotonic() < deadline, f"never came: {what}"
        time.sleep(0.05)


def quick_spec(name: str = "relay", **changes: Any) -> dict[str, Any]:
    """A spec that takes little more than its start, and passes on any machine."""
    benchmark = {**relay_spec()["benchmark"], "duration": "200 ms", "warm_up": "0 s"}
    slos = {"received": {"at": "20 Hz", "require": ["received > 0"]}}
    return relay_spec(name=name, slos=slos, benchmark=benchmark, **changes)


@dataclass
class Client:
    """A call of ``r2bspec run --on`` that has ended."""

    folder: Path
    status: int
    stdout: str
    stderr: str

    def runs(self) -> dict[str, Any]:
        """The rows of suite.json by their names and hosts."""
        summary = json.loads((self.folder / "suite.json").read_text())
        return {f"{run['name']} on {run['host']}": run for run in summary["runs"]}


@dataclass
class Hosts:
    """Scheduler, workers and clients; everything ends with `close`."""

    folder: Path
    port: int = 0
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        (self.folder / "tmp").mkdir(parents=True)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def environment(self, **variables: str) -> dict[str, str]:
        """One lock for all of this fleet, and none for others of this machine."""
        made = {**os.environ, "TMPDIR": str(self.folder / "tmp"), **variables}
        made.pop(DISABLED_BY, None)
        return made

    def start_scheduler(self) -> None:
        words = ["--no-dashboard", "--dashboard-address", "127.0.0.1:0", "--host", self.address]
        self._start("scheduler", *words)

    def start_worker(self, name: str, **variables: str) -> None:
        words = [self.address, "--name", name, "--nthreads", "1", "--resources", "r2bspec=1"]
        words += ["--no-nanny", "--no-dashboard", "--memory-limit", "0"]
        words += ["--local-directory", str(self.folder / name)]
        self._start("worker", *words, name=name, **{"R2BSPEC_LABELS": f"robot={name}", **variables})
        log = self.folder / f"{name}.log"
        wait_until(lambda: "Registered to" in log.read_text(), f"the worker {name}")

    def kill_worker(self, name: str) -> None:
        """Without a chance for the worker to say so."""
        self.processes[name].kill()
        self.processes[name].wait()

    def playing(self) -> list[str]:
        """The names of the hosts that play a run now."""
        plans = self.folder.glob("*/dask-scratch-space/*/*/run/plan.json")
        return [plan.parents[4].name for plan in plans]

    def start_client(self, *arguments: str | Path, output: Path) -> subprocess.Popen[str]:
        """Start ``r2bspec fleet run`` on this fleet."""
        words = [sys.executable, "-m", "r2bspec", "fleet", "run", *map(str, arguments)]
        words += ["--output", str(output), "--on", self.address]
        return subprocess.Popen(
            words,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            env=self.environment(),
            cwd=self.folder,
        )

    def finish(self, client: subprocess.Popen[str], output: Path) -> Client:
        """Wait for the end of a client."""
        stdout, stderr = client.communicate(timeout=HANG_S)
        return Client(output, client.returncode, stdout, stderr)

    def run(self, *arguments: str | Path, output: Path) -> Client:
        """Call ``r2bspec run --on`` this fleet."""
        return self.finish(self.start_client(*arguments, output=output), output)

    def close(self) -> None:
        """End everything."""
        for process in self.processes.values():
            process.send_signal(signal.SIGTERM)
        for process in self.processes.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(60)
            process.kill()
            process.wait()

    def _start(self, program: str, *words: str, name: str = "", **variables: str) -> None:
        name = name or program
        with (self.folder / f"{name}.log").open("ab") as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.dask_{program}", *words],
                stdout=log,
                stderr=log,
                stdin=subprocess.DEVNULL,
                env=self.environment(**variables),
                cwd=self.folder,
            )


@contextlib.contextmanager
def fleet(folder: Path, *names: str) -> Iterator[Hosts]:
    """A fleet with these hosts, each with its own name as the label ``robot``."""
    hosts = Hosts(folder)
    try:
        hosts.start_scheduler()
        for name in names:
            hosts.start_worker(name)
        yield hosts
    finally:
        hosts.close()
