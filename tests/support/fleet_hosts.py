"""A fleet on this machine: a real scheduler, and workers with folders and labels of their own.

The workers share the lock of the host, so that no two of them measure at once, as three machines
would not.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from r2bspec.execute.processes.machine import DISABLED_BY
from r2bspec.fleet.journal import JOURNAL_FILE, Event, read_journal
from r2bspec.record.run_folder import Run, open_run
from ros_runs import relay_spec

RUNS = int(os.environ.get("R2BSPEC_FLEET_RUNS", "6"))
"""How many runs are made while workers are killed; 200 by hand."""

HANG_S = 240.0 + 30.0 * RUNS
"""Guards against hanging only."""

_PROGRAM = [sys.executable, "-m", "r2bspec"]


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
    """A call of ``r2bspec run --on``, under way or ended."""

    process: subprocess.Popen[str]
    folder: Path
    stdout: str = ""
    stderr: str = ""

    def finish(self) -> Client:
        """Wait for its end."""
        self.stdout, self.stderr = self.process.communicate(timeout=HANG_S)
        return self

    def kill(self) -> None:
        """End it without any chance to clean up."""
        self.process.kill()
        self.process.communicate()

    @property
    def status(self) -> int:
        return self.process.returncode

    def summary(self) -> Any:
        """What suite.json holds."""
        return json.loads((self.folder / "suite.json").read_text())

    def events(self, *states: str) -> list[Event]:
        """The events of the journal, of these states."""
        if not (self.folder / JOURNAL_FILE).exists():
            return []
        return [each for each in read_journal(self.folder) if each.state in states]

    def wait_for(self, state: str) -> None:
        """Wait for the first event of a state."""
        wait_until(lambda: bool(self.events(state)) or self.process.poll() is not None, state)
        assert self.process.poll() is None, self.finish().stderr

    def next_events(self, state: str) -> list[Event]:
        """The events of a state when there is one more, or when the client has ended."""
        before = len(self.events(state))
        wait_until(
            lambda: len(self.events(state)) > before or self.process.poll() is not None, state
        )
        return self.events(state)

    def runs(self) -> dict[str, Run]:
        """Every complete run folder, by its path in the suite."""
        found = {}
        for path in sorted(self.folder.rglob("record.json")):
            run = open_run(path.parent)
            assert run.record.status == "complete"
            found[str(path.parent.relative_to(self.folder))] = run
        return found

    def kept(self) -> dict[str, Run]:
        """The same without invalid runs, which a busy machine may cause, and which are repeated."""
        return {path: run for path, run in self.runs().items() if ".invalid-" not in path}


@dataclass
class Fleet:
    """Scheduler, workers and clients; everything ends with `close`."""

    folder: Path
    scheduler_options: Sequence[str] = ()
    scheme: str = "tcp"
    port: int = 0
    scheduler: subprocess.Popen[bytes] | None = None
    workers: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)
    clients: list[Client] = field(default_factory=list)
    worker_options: dict[str, tuple[str, ...]] = field(default_factory=dict)
    variables: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        (self.folder / "tmp").mkdir(parents=True)
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            self.port = found.getsockname()[1]

    @property
    def address(self) -> str:
        return f"{self.scheme}://127.0.0.1:{self.port}"

    def environment(self) -> dict[str, str]:
        """One lock for all of this fleet, and none for others of this machine."""
        made = {**os.environ, **self.variables, "TMPDIR": str(self.folder / "tmp")}
        made.pop(DISABLED_BY, None)
        return made

    def start_scheduler(self) -> None:
        """Start it, at the same address every time."""
        words = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
        # Its HTTP server is there without a dashboard, too.
        words += ["--dashboard-address", "127.0.0.1:0"]
        words += ["--host", self.address, *self.scheduler_options]
        self.scheduler = self._start(words, "scheduler")
        wait_until(self._answers, "the scheduler")

    def kill_scheduler(self) -> None:
        assert self.scheduler is not None
        self.scheduler.kill()
        self.scheduler.wait()

    def start_worker(
        self, name: str, *options: str, program: Sequence[str] = (), at: str = ""
    ) -> None:
        """Start a worker, with its options of the last time if there are none.

        Args:
            name: of its host.
            options: of its command line.
            program: its command line until then.
            at: where it connects instead of at `address`.
        """
        self.worker_options[name] = options or self.worker_options.get(name, ())
        words = [*(program or _PROGRAM), "fleet", "worker", at or self.address, "--name", name]
        words += ["--folder", str(self.folder / f"host-{name}"), "--no-doctor"]
        words += [*self.worker_options[name]]
        log = self.folder / f"{name}.log"
        log.write_text("")
        worker = self.workers[name] = self._start(words, name)

        def is_in_the_fleet() -> bool:
            status = worker.poll()
            said = log.read_text()
            assert status is None, f"the worker {name} has ended with {status}:\n{said}"
            return "is in the fleet" in said

        wait_until(is_in_the_fleet, f"the worker {name}")

    def kill_worker(self, name: str) -> None:
        """Without a chance for the worker to say so; its connections are closed."""
        self.workers[name].kill()
        self.workers[name].wait()

    def is_back(self, name: str, times: int) -> bool:
        """Whether a worker has joined the fleet so many times since it was started."""
        return (self.folder / f"{name}.log").read_text().count("is in the fleet") >= times

    def client(
        self, *arguments: str | Path, output: Path, at: str = "", verb: str = "run"
    ) -> Client:
        """Start ``r2bspec run --on`` this fleet; `at` is where it connects instead of there."""
        words = [*_PROGRAM, verb, *map(str, arguments), "--output", str(output)]
        process = subprocess.Popen(
            [*words, "--on", at or self.address],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            env=self.environment(),
            cwd=self.folder,
        )
        self.clients.append(Client(process, output))
        return self.clients[-1]

    def run(self, *arguments: str | Path, output: Path, at: str = "") -> Client:
        """The same, to its end."""
        return self.client(*arguments, output=output, at=at).finish()

    def spools(self) -> list[Path]:
        """What hosts still have of runs."""
        return list(self.folder.glob("host-*/spool/*"))

    def close(self) -> None:
        """End everything."""
        for client in self.clients:
            if client.process.poll() is None:
                client.kill()
        for process in (*self.workers.values(), self.scheduler):
            if process is not None and process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process in (*self.workers.values(), self.scheduler):
            if process is not None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(60)
                process.kill()
                process.wait()

    def _start(self, words: Sequence[str], name: str) -> subprocess.Popen[bytes]:
        with (self.folder / f"{name}.log").open("ab") as log:
            return subprocess.Popen(
                words,
                stdout=log,
                stderr=log,
                stdin=subprocess.DEVNULL,
                env=self.environment(),
                cwd=self.folder,
            )

    def _answers(self) -> bool:
        with socket.socket() as found:
            return found.connect_ex(("127.0.0.1", self.port)) == 0


@contextlib.contextmanager
def fleet(folder: Path, *names: str, **options: Any) -> Iterator[Fleet]:
    """A fleet with these hosts, each with its own name as the label ``robot``."""
    made = Fleet(folder, **options)
    try:
        made.start_scheduler()
        for name in names:
            made.start_worker(name, "--label", f"robot={name}")
        yield made
    finally:
        made.close()


def overlapping(runs: Sequence[Run]) -> list[tuple[str, str]]:
    """Runs that were made at the same time, as pairs of their names."""
    times = sorted((run.record.started_at, run.record.ended_at, str(run.folder)) for run in runs)
    return [
        (before[2], after[2]) for before, after in itertools.pairwise(times) if after[0] < before[1]
    ]
