"""Promise: whatever is done to a run at random, its end is explained, and nothing of it is left.

Nightly; `R2BSPEC_CHAOS_MINUTES` and `R2BSPEC_CHAOS_SEED` say for how long, and with which dice.
Nothing but the processes and files of its own runs is touched.
"""

from __future__ import annotations

import contextlib
import os
import random
import re
import shutil
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import Bench, Running, assert_nothing_left, quick_input, relay_node, relay_spec

MINUTES = float(os.environ.get("R2BSPEC_CHAOS_MINUTES", "5"))
SEED = int(os.environ.get("R2BSPEC_CHAOS_SEED", "1"))
EXIT_CODES = {0, 1, 2, 3, 4, 130}
FATAL = {signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT}
"""What no program can answer."""

SLEEPER = """
import signal, subprocess, sys, time
for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(each, signal.SIG_IGN)
if len(sys.argv) > 1:
    subprocess.Popen([sys.executable, __file__], start_new_session=True)
print("word " * 100_000, flush=True)
time.sleep(600)
"""


def specs() -> list[dict[str, Any]]:
    """One node; with a preprocessor; beside a command that does not end; with a search."""
    plain = relay_spec(slos={"answers": {"at": "20 Hz", "require": ["missed == 0"]}})
    plain["benchmark"] |= {"iterations": 3, "rates": ["20 Hz", "40 Hz"]}
    prepared = relay_spec(
        preprocessors={"prepare": relay_node(remappings={"input": "loaded", "output": "made"})},
        playback={"buffer": 5, "inputs": {"input": quick_input("made")}},
    )
    sleeper = {"command": [sys.executable, "sleeper.py", "parent"]}
    crowded = relay_spec(graph={"nodes": {"relay": relay_node(), "sleeper": sleeper}})
    crowded["benchmark"] |= {"iterations": 4}
    searching = relay_spec(graph={"nodes": {"relay": relay_node(20.0)}})
    searching["benchmark"] |= {"rates": [], "search": {"min": "10 Hz", "max": "100 Hz"}}
    return [plain, prepared, crowded, searching]


@dataclass
class Attempt:
    """One run, what is done to it, and what that may end in."""

    bench: Bench
    running: Running
    dice: random.Random
    done: list[str] = field(default_factory=list)
    killed: bool = False
    spoiled: bool = False

    def processes(self) -> dict[str, psutil.Process]:
        """Those of the run, by the names of their logs, and its controller."""
        found = {"controller": psutil.Process(self.running.process.pid)}
        for process in self.bench.processes():
            with contextlib.suppress(psutil.Error, OSError):
                log = Path(f"/proc/{process.pid}/fd/1").readlink()
                if log.parent.name == "logs":
                    found.setdefault(log.stem, process)
        return found

    def send(self, number: signal.Signals, name: str = "") -> None:
        """Send a signal to one of the processes."""
        with contextlib.suppress(psutil.Error):
            there = self.processes()
            name = name or self.dice.choice(sorted(there))
            if name in there:
                there[name].send_signal(number)
                self.done.append(f"{number.name} to {name}")
                self.killed |= name == "controller" and number in FATAL


def kill(attempt: Attempt) -> None:
    deadly = (*FATAL, signal.SIGTERM, signal.SIGINT)
    for _ in range(attempt.dice.choice((1, 1, 1, 3))):
        attempt.send(attempt.dice.choice(sorted(deadly)))
        time.sleep(attempt.dice.choice((0.0, 0.05, 0.7)))


def kill_controller(attempt: Attempt) -> None:
    attempt.send(signal.SIGKILL, "controller")


def interrupt(attempt: Attempt) -> None:
    for _ in range(attempt.dice.randint(1, 2)):
        attempt.send(attempt.dice.choice((signal.SIGINT, signal.SIGTERM)), "controller")
        time.sleep(attempt.dice.choice((0.0, 0.2, 2.0)))


def starve(attempt: Attempt) -> None:
    name = attempt.dice.choice(sorted(attempt.processes()))
    for _ in range(attempt.dice.randint(1, 6)):
        attempt.send(signal.SIGSTOP, name)
        time.sleep(attempt.dice.uniform(0.05, 0.8))
        attempt.send(signal.SIGCONT, name)
        time.sleep(attempt.dice.uniform(0.0, 0.3))


def freeze(attempt: Attempt) -> None:
    """For good; but not the controller, which nobody watches for that."""
    if there := sorted(attempt.processes().keys() - {"controller"}):
        attempt.send(signal.SIGSTOP, attempt.dice.choice(there))


def corrupt(attempt: Attempt) -> None:
    """Overwrite, cut or delete a file of the run folder, or all of them."""
    files = [path for path in sorted(attempt.running.folder.rglob("*")) if path.is_file()]
    if not files:
        return
    victim = attempt.dice.choice(files)
    actions: dict[str, Callable[[], Any]] = {
        "cut": lambda: os.truncate(victim, attempt.dice.randint(0, victim.stat().st_size)),
        "delete": victim.unlink,
        "garbage": lambda: victim.write_bytes(attempt.dice.randbytes(100)),
        "remove all": lambda: shutil.rmtree(attempt.running.folder, ignore_errors=True),
    }
    how = attempt.dice.choice(sorted(actions))
    with contextlib.suppress(OSError):
        actions[how]()
        attempt.spoiled = True
        attempt.done.append(f"{how} {victim.relative_to(attempt.running.folder)}")


ACTIONS = (kill, kill, kill_controller, interrupt, interrupt, starve, freeze, corrupt)


def broken_promises(attempt: Attempt) -> list[str]:
    """What is wrong with the end of a run."""
    running = attempt.running
    status = running.process.wait(150.0)
    running.sample()
    said, wrong = running.stderr(), []
    if "Traceback (most recent call last)" in said:
        wrong.append("a stack trace")
    # A signal that comes before the program has begun, or when it has told its end, is not its.
    told = not said or "error[" in said or running.stdout()
    silent = status in {-signal.SIGINT, -signal.SIGTERM} and told
    if not attempt.killed and not silent and status not in EXIT_CODES:
        wrong.append("an unknown exit status")
    explained = re.search(r"error\[R2B\d{3} [a-z0-9-]+\]|^interrupted$", said, re.MULTILINE)
    explained = explained or re.search("INVALID", running.stdout())
    second = status == 130 and sum("controller" in each for each in attempt.done) > 1
    if (
        status in {0, 1, 3}
        and not attempt.spoiled
        and not (running.folder / "result.json").exists()
    ):
        wrong.append("no result")
    if status in {2, 4, 130} and not explained and not second:
        wrong.append("no error")
    if not attempt.spoiled and [*running.folder.glob(".*")]:
        wrong.append("hidden files in the run folder")
    # Whatever there is of a record can be read, and what was measured can be judged.
    if (running.folder / "record.json").exists():
        judged = attempt.bench.judge(running.folder, "--format", "json")
        if judged.status not in EXIT_CODES - ({2} if not attempt.spoiled else set()):
            wrong.append(f"judge ends with {judged.status}: {judged.stderr[-500:]}")
        elif not (attempt.spoiled or attempt.killed or silent or status == 130):
            invalid = status == 4 and "INVALID" in running.stdout()
            if (judged.run().record.status == "complete") != (status in {0, 1, 3} or invalid):
                wrong.append(f"the record says {judged.run().record.status}")
    return [f"{each}; exit status {status}: {said[-500:]}" for each in wrong]


@only_nightly()
@pytest.mark.timeout(60.0 * MINUTES + 300.0)
def test_every_end_is_explained_and_nothing_is_left(tmp_path: Path) -> None:
    bench, dice = Bench(tmp_path / "bench"), random.Random(SEED)  # noqa: S311 - repeatable
    (bench.folder / "sleeper.py").write_text(SLEEPER)
    deadline = time.monotonic() + 60.0 * MINUTES
    while time.monotonic() < deadline:
        with bench.start(dice.choice(specs())) as running:
            attempt = Attempt(bench, running, dice)
            patience = time.monotonic() + dice.uniform(0.0, 14.0)
            while time.monotonic() < patience and running.process.poll() is None:
                time.sleep(0.05)
            if running.process.poll() is None:
                dice.choice(ACTIONS)(attempt)
            assert broken_promises(attempt) == [], attempt.done
        assert_nothing_left()
        shutil.rmtree(running.folder, ignore_errors=True)
