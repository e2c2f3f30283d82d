"""Chaos: kills, stops, starves and corrupts runs at random, and sees that the promises hold.

Run by hand, for as long as there is patience:

    python tests/fault/chaos.py --minutes 60 --seed 1

Nothing but the processes and files of its own runs is touched. A line is printed for each run; what
broke a promise is said at the end, with the folder that shows it, and makes the exit status 1.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

_ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(_ROOT), str(_ROOT / "tests" / "support")]
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
)

from r2bspec.record.run_folder import open_run  # noqa: E402 - found through the path above
from ros_runs import (  # noqa: E402
    IMAGE,
    Bench,
    Running,
    processes_left,
    quick_input,
    relay_node,
    relay_spec,
    segments_left,
)

_FATAL = {signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT}
"""What no program can answer."""

EXIT_CODES = {0, 1, 2, 3, 4, 130}
HANG_S = 150.0
GONE_S = 20.0
"""What a watchdog may take on a machine that is busy."""

SLEEPER = """
import os, signal, subprocess, sys, time
for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(each, signal.SIG_IGN)
if len(sys.argv) > 1:
    subprocess.Popen([sys.executable, __file__], start_new_session=True)
print("word " * 100_000, flush=True)
time.sleep(600)
"""


def plain() -> dict[str, Any]:
    """One node, two rates."""
    spec = relay_spec(slos={"answers": {"at": "20 Hz", "require": ["missed == 0"]}})
    spec["benchmark"] |= {"iterations": 3, "rates": ["20 Hz", "40 Hz"]}
    return spec


def chain() -> dict[str, Any]:
    """Two nodes in a row."""
    nodes = {
        "first": relay_node(remappings={"output": "between"}),
        "relay": relay_node(remappings={"input": "between"}),
    }
    spec = relay_spec(graph={"nodes": nodes})
    spec["benchmark"] |= {"iterations": 4}
    return spec


def prepared() -> dict[str, Any]:
    """With a preprocessor."""
    spec = relay_spec(
        preprocessors={"prepare": relay_node(remappings={"input": "loaded", "output": "made"})},
        playback={"buffer": 5, "inputs": {"input": quick_input("made")}},
    )
    spec["benchmark"] |= {"iterations": 3}
    return spec


def crowded() -> dict[str, Any]:
    """Beside a command that does not end when asked, and has a child in another session."""
    spec = plain()
    spec["graph"]["nodes"]["sleeper"] = {"command": [sys.executable, "sleeper.py", "parent"]}
    return spec


def searching() -> dict[str, Any]:
    """With a search for the peak rate."""
    spec = relay_spec(graph={"nodes": {"relay": relay_node(20.0)}})
    spec["benchmark"] |= {"rates": [], "search": {"min": "10 Hz", "max": "100 Hz"}}
    spec["monitors"] = {"out": {"topic": "output", "format": IMAGE}}
    return spec


SPECS = (plain, chain, prepared, crowded, searching)


@dataclass
class Attempt:
    """One run, what is done to it, and what that may end in."""

    bench: Bench
    running: Running
    dice: random.Random
    done: list[str] = field(default_factory=list)
    killed: bool = False
    named: str = ""
    spoiled: bool = False

    def processes(self) -> dict[str, psutil.Process]:
        """Those of the run, by the names of their logs; the controller and the watchdog too."""
        found = {"controller": psutil.Process(self.running.process.pid)}
        for each in self.bench.processes():
            with contextlib.suppress(psutil.Error, OSError):
                if "r2bspec.harness.watchdog" in each.cmdline():
                    found["watchdog"] = each
                    continue
                log = Path(f"/proc/{each.pid}/fd/1").readlink()
                if log.parent.name == "logs" and log.stem not in found:
                    found[log.stem] = each
        return found

    def send(self, number: signal.Signals, name: str = "") -> None:
        """Send a signal to one of the processes."""
        with contextlib.suppress(psutil.Error):
            there = self.processes()
            name = name or self.dice.choice(sorted(there))
            if name in there:
                there[name].send_signal(number)
                self.done.append(f"{number.name} to {name}")
                if name == "controller" and number in _FATAL:
                    self.killed = True


def kill_one(attempt: Attempt) -> None:
    """Kill any process, in any way."""
    deadly = (signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV, signal.SIGINT, signal.SIGABRT)
    attempt.send(attempt.dice.choice(deadly))


def kill_several(attempt: Attempt) -> None:
    """Kill some, shortly after each other."""
    for _ in range(attempt.dice.randint(2, 4)):
        kill_one(attempt)
        time.sleep(attempt.dice.choice((0.0, 0.05, 0.7)))


def kill_controller_and_watchdog(attempt: Attempt) -> None:
    """The controller alone: its watchdog has to clean up."""
    attempt.send(signal.SIGKILL, "controller")


def interrupt(attempt: Attempt) -> None:
    """Ctrl-C, once or twice, as a terminal sends it."""
    for _ in range(attempt.dice.randint(1, 2)):
        attempt.send(attempt.dice.choice((signal.SIGINT, signal.SIGTERM)), "controller")
        time.sleep(attempt.dice.choice((0.0, 0.2, 0.8, 2.0)))


def starve(attempt: Attempt) -> None:
    """Stop a process again and again, as a machine does that has no time for it."""
    there = attempt.processes()
    name = attempt.dice.choice(sorted(there))
    for _ in range(attempt.dice.randint(1, 6)):
        attempt.send(signal.SIGSTOP, name)
        time.sleep(attempt.dice.uniform(0.05, 0.8))
        attempt.send(signal.SIGCONT, name)
        time.sleep(attempt.dice.uniform(0.0, 0.3))


def freeze(attempt: Attempt) -> None:
    """Stop a process for good; but not the controller, which nobody watches for that."""
    there = sorted(set(attempt.processes()) - {"controller", "watchdog"})
    if there:
        attempt.send(signal.SIGSTOP, attempt.dice.choice(there))


def corrupt(attempt: Attempt) -> None:
    """Overwrite, cut or delete a file of the run folder."""
    files = [each for each in sorted(attempt.running.folder.rglob("*")) if each.is_file()]
    if not files:
        return
    victim = attempt.dice.choice(files)
    how = attempt.dice.choice(("cut", "delete", "garbage"))
    with contextlib.suppress(OSError):
        if how == "cut":
            with victim.open("rb+") as file:
                file.truncate(attempt.dice.randint(0, max(1, victim.stat().st_size)))
        elif how == "delete":
            victim.unlink()
        else:
            victim.write_bytes(attempt.dice.randbytes(100))
        attempt.spoiled = True
        attempt.done.append(f"{how} {victim.relative_to(attempt.running.folder)}")


def remove_folder(attempt: Attempt) -> None:
    """Remove the whole run folder."""
    shutil.rmtree(attempt.running.folder, ignore_errors=True)
    attempt.spoiled = True
    attempt.done.append("removed the run folder")


def nothing(attempt: Attempt) -> None:
    """Leave it alone: runs beside it are being hurt."""
    attempt.done.append("nothing")


ACTIONS: tuple[Callable[[Attempt], None], ...] = (
    kill_one,
    kill_one,
    kill_one,
    kill_several,
    kill_controller_and_watchdog,
    interrupt,
    interrupt,
    starve,
    starve,
    freeze,
    corrupt,
    corrupt,
    remove_folder,
    nothing,
)


@contextlib.contextmanager
def small_disk(folder: Path, dice: random.Random) -> Iterator[str]:
    """Now and then, the run folder is on a disk that is too small."""
    if dice.random() > 0.1:
        yield ""
        return
    kibibytes = round(2 ** dice.uniform(4, 12))
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={kibibytes}k", "tmpfs", str(folder)]
    if subprocess.run(mount, check=False, capture_output=True).returncode:
        yield ""
        return
    try:
        yield f"disk of {kibibytes} KiB"
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)  # noqa: S607


@contextlib.contextmanager
def damaged_bag(bench: Bench, dice: random.Random) -> Iterator[str]:
    """Now and then, the bag is cut off or has a hole."""
    (storage,) = bench.bag.glob("*.db3")
    whole = storage.read_bytes()
    if dice.random() > 0.1:
        yield ""
        return
    place = dice.randrange(len(whole))
    if dice.random() < 0.5:
        storage.write_bytes(whole[:place])
        said = f"bag cut at {place}"
    else:
        storage.write_bytes(whole[:place] + dice.randbytes(200) + whole[place + 200 :])
        said = f"bag damaged at {place}"
    try:
        yield said
    finally:
        storage.write_bytes(whole)


def _why(running: Running) -> str:
    """The first line of what the user was told."""
    found = re.search(r"^(error\[.*|interrupted)$", running.stderr(), re.MULTILINE)
    return f" {found[0][:100]}" if found else ""


class Worker:
    """Makes one run after another, each with its own fate."""

    def __init__(self, folder: Path, seed: int, report: Callable[[str], None]) -> None:
        self._bench = Bench(folder)
        (folder / "sleeper.py").write_text(SLEEPER)
        self._dice = random.Random(seed)  # noqa: S311 - it must be repeatable
        self._report = report
        self._number = 0
        self.ends: Counter[int] = Counter()
        self.broken: list[str] = []

    def work(self, deadline_s: float) -> None:
        """Go on until the time is up."""
        while time.monotonic() < deadline_s:
            self._number += 1
            self._once()

    def _once(self) -> None:
        dice, bench = self._dice, self._bench
        make, act = dice.choice(SPECS), dice.choice(ACTIONS)
        disk = bench.folder / f"disk{self._number}"
        with small_disk(disk, dice) as small, damaged_bag(bench, dice) as damaged:
            folder = disk / "run" if small else bench.folder / f"chaos{self._number}"
            with bench.start(make(), output=folder) as running:
                attempt = Attempt(bench, running, dice)
                attempt.done += [each for each in (small, damaged) if each]
                patience = time.monotonic() + dice.uniform(0.0, 14.0)
                while time.monotonic() < patience and running.process.poll() is None:
                    time.sleep(0.05)
                if running.process.poll() is None:
                    act(attempt)
                wrong = self._see(attempt)
            if not wrong and not small:
                shutil.rmtree(folder, ignore_errors=True)
        where = f"{bench.folder.name} {self._number}"
        what = ", ".join(attempt.done) or f"too late to {act.__name__}"
        self._report(
            f"{where}: {make.__name__}; {what}; {running.process.returncode}{_why(running)}"
        )
        for each in wrong:
            self._report(f"  BROKEN: {each}")
            self.broken.append(f"{folder}: {each}")

    def _see(self, attempt: Attempt) -> list[str]:
        """Wait for the end, and say which promises are broken."""
        running = attempt.running
        try:
            status = running.process.wait(HANG_S)
        except subprocess.TimeoutExpired:
            return [f"it hangs; the last it said: {running.stderr()[-300:]!r}"]
        running.sample()
        self.ends[status] += 1
        said = running.stderr()
        wrong = []
        if "Traceback (most recent call last)" in said:
            wrong.append(f"a stack trace: {said[-1500:]}")
        # A signal that comes before the program has begun, or when it has told its end, is not its.
        silent = status in {-signal.SIGINT, -signal.SIGTERM} and (not said or "error[" in said)
        if not attempt.killed and not silent and status not in EXIT_CODES:
            wrong.append(f"exit status {status}: {said[-500:]}")
        explained = re.search(r"error\[R2B\d{3} [a-z0-9-]+\]|^interrupted$", said, re.MULTILINE)
        explained = explained or re.search("INVALID", running.stdout())
        second = status == 130 and sum("controller" in each for each in attempt.done) > 1
        judged = (running.folder / "result.json").exists() or attempt.spoiled
        if status in {0, 1, 3} and not judged:
            wrong.append(f"exit status {status} without a result: {said[-500:]}")
        if status in {2, 4, 130} and not explained and not second:
            wrong.append(f"exit status {status} without an error: {said[-500:]}")
        wrong += self._left(attempt)
        wrong += self._judged(attempt, status)
        return wrong

    def _left(self, attempt: Attempt) -> list[str]:
        deadline = time.monotonic() + GONE_S
        while left := [*processes_left(self._bench), *segments_left(self._bench)]:
            if time.monotonic() > deadline:
                return [f"left behind: {', '.join(left)}"]
            time.sleep(0.2)
        folder = attempt.running.folder
        hidden = [each.name for each in folder.glob(".*")] if folder.is_dir() else []
        return [f"left in the run folder: {hidden}"] if hidden and not attempt.spoiled else []

    def _judged(self, attempt: Attempt, status: int) -> list[str]:
        """Whatever there is of a record can be read, and what was measured can be judged."""
        folder = attempt.running.folder
        if not (folder / "record.json").exists():
            return []
        done = self._bench.judge(folder, "--format", "json")
        if done.status not in EXIT_CODES or "Traceback" in done.stderr:
            return [f"judge ends with {done.status}: {done.stderr[-800:]}"]
        if attempt.spoiled:
            return []
        if done.status == 2:
            return [f"the record cannot be read: {done.stderr[-500:]}"]
        record = open_run(folder).record
        finished = status in {0, 1, 3} or (status == 4 and "INVALID" in attempt.running.stdout())
        # One that is interrupted while it is judged was complete by then.
        known = not attempt.killed and status != 130
        if known and (record.status == "complete") != finished:
            return [f"exit status {status}, but the record says {record.status}"]
        json.loads(done.stdout)
        return []


def main() -> int:
    """Hurt runs until the time is up; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=15.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2, help="runs at the same time")
    options = parser.parse_args()
    lab = Path(tempfile.mkdtemp(prefix="r2bspec-chaos-"))
    lock = threading.Lock()

    def report(line: str) -> None:
        with lock:
            sys.stdout.write(f"{time.strftime('%H:%M:%S')} {line}\n")
            sys.stdout.flush()

    workers = [
        Worker(lab / f"worker{number}", options.seed * 1000 + number, report)
        for number in range(options.workers)
    ]
    deadline = time.monotonic() + 60.0 * options.minutes
    threads = [threading.Thread(target=each.work, args=(deadline,)) for each in workers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    ends = sum((each.ends for each in workers), Counter[int]())
    broken = [each for worker in workers for each in worker.broken]
    report(f"{ends.total()} runs; exit statuses {dict(sorted(ends.items()))}")
    for each in broken:
        report(f"BROKEN {each}")
    if not broken:
        shutil.rmtree(lab, ignore_errors=True)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
