"""Promise: a run can be ended at any moment, by anyone, and nothing of it is left but its record.

After every test it is seen, too, that no process and no shared memory stays.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time
from typing import Any

import psutil
import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import HANG_S, Bench, Finished, Running, quick_input, relay_spec

NODES = """
import os
import signal
import subprocess
import sys
import time

SLEEPER = (
    "import signal, time\\n"
    "for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):\\n"
    "    signal.signal(each, signal.SIG_IGN)\\n"
    "time.sleep(600)\\n"
)


class Nasty(Node):
    # Ignores what asks it to end, and has children that do, one in a session of its own.
    def __init__(self, **kwargs):
        super().__init__("nasty", **kwargs)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        for own in (False, True):
            subprocess.Popen([sys.executable, "-c", SLEEPER], start_new_session=own)
        self.count = 0
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.answer, 100)

    def answer(self, message):
        self.out.publish(message)
        self.count += 1
        if self.count == 25:
            time.sleep(600)


class Slow(Node):
    def __init__(self, **kwargs):
        super().__init__("slow", **kwargs)
        print("starting", flush=True)
        time.sleep(600)
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.out.publish, 10)


class Preparing(Node):
    def __init__(self, **kwargs):
        super().__init__("preparing", **kwargs)
        self.out = self.create_publisher(Image, "prepared", 10)
        self.create_subscription(Image, "loaded", self.answer, 100)

    def answer(self, message):
        print("preparing", flush=True)
        self.out.publish(message)
        time.sleep(1)
"""

NAMES = ("harness.observer", "player", "monitor", "relay")
LONG = {"iterations": 100, "duration": "1 s", "rates": ["20 Hz"]}
SECOND_ITERATION = r"iteration 2 of"


def long_spec(**changes: Any) -> dict[str, Any]:
    """A benchmark that nobody waits for the end of."""
    spec = relay_spec(**changes)
    spec["benchmark"] |= LONG
    return spec


def graph_of(name: str) -> dict[str, Any]:
    return long_spec(graph={"nodes": {"relay": {"python": f"./nodes.py:{name}"}}})


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("interruption"), {"/camera": range(0, 40 * 33, 33)})
    found.write_node("nodes.py", NODES)
    return found


def wait_until_gone(bench: Bench) -> None:
    """Promise: ten seconds after the controller was killed no process is left."""
    deadline = time.monotonic() + 10.0
    while left := bench.processes():
        assert time.monotonic() < deadline, left
        time.sleep(0.05)


def watches(process: psutil.Process, running: Running) -> bool:
    """Whether a process is the watchdog of a run."""
    with contextlib.suppress(psutil.Error):
        words = process.cmdline()
        return "r2bspec.harness.watchdog" in words and words[-1].startswith(str(running.folder))
    return False


def wait_until_said(running: Running, process: str, words: str) -> None:
    """Wait until a process has printed something."""
    log = running.folder / "logs" / f"{process}.log"
    running.wait_until(lambda: log.exists() and words in log.read_text(), repr(words))


def kept(bench: Bench, done: Finished | Running, *, iterations: int) -> str:
    """The reason that the record gives; what was measured is there and can be judged."""
    judged = bench.judge(done.folder, "--format", "json")
    # What the process ended with; one that was killed ended with nothing, and may be run again.
    assert judged.status == (done.status if isinstance(done, Finished) else 4)
    record = judged.run().record
    assert record.status == "incomplete"
    whole = [each for each in record.segments if each.kind == "iteration" and each.complete]
    assert len(whole) >= iterations
    for segment in record.segments:
        assert judged.run().playback(segment).size > 0
    # Nothing half-written, and nothing that was only needed while it ran.
    assert [each.name for each in done.folder.iterdir() if each.name.startswith(".")] == []
    return record.reason


# Being asked to end


@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=only_nightly())]
)
def test_a_run_that_is_interrupted_keeps_what_it_has(bench: Bench, number: signal.Signals) -> None:
    with bench.start(long_spec()) as running:
        running.wait_for(SECOND_ITERATION)
        # As a terminal does it: the whole group gets the signal.
        os.killpg(running.process.pid, number)
        done = running.finish()
    assert done.status == 130
    assert f"interrupted by {number.name}" in done.error
    assert number.name in kept(bench, done, iterations=1)
    assert done.result()["status"] == "incomplete"
    # Everybody had the time to leave in good order.
    assert [process.exit_code for process in done.run().record.processes] == [0, 0, 0, 0]


@only_nightly()
def test_a_run_can_be_interrupted_while_its_graph_comes_up(bench: Bench) -> None:
    with bench.start(graph_of("Slow")) as running:
        wait_until_said(running, "relay", "starting")
        os.kill(running.process.pid, signal.SIGINT)
        done = running.finish()
    assert done.status == 130
    assert kept(bench, done, iterations=0).endswith("interrupted by SIGINT")


@only_nightly()
def test_a_run_can_be_interrupted_while_it_prepares(bench: Bench) -> None:
    spec = long_spec(
        preprocessors={"prepare": {"python": "./nodes.py:Preparing"}},
        playback={"inputs": {"input": quick_input("prepared")}},
    )
    with bench.start(spec) as running:
        wait_until_said(running, "preprocess.prepare", "preparing")
        os.kill(running.process.pid, signal.SIGINT)
        done = running.finish()
    assert done.status == 130
    kept(bench, done, iterations=0)


@only_nightly()
def test_a_second_interrupt_ends_a_run_at_once(bench: Bench) -> None:
    # The node hangs and ignores what it is told, so that ending in good order takes a while.
    with bench.start(graph_of("Nasty")) as running:
        running.wait_for(SECOND_ITERATION)
        os.kill(running.process.pid, signal.SIGINT)
        time.sleep(0.5)
        assert running.process.poll() is None
        os.kill(running.process.pid, signal.SIGINT)
        assert running.process.wait(HANG_S) == 130
        wait_until_gone(bench)
        kept(bench, running, iterations=1)


# Being killed


@pytest.mark.parametrize("node", [pytest.param("relay", marks=only_nightly()), "Nasty"])
def test_nothing_outlives_a_controller_that_is_killed_in_mid_run(bench: Bench, node: str) -> None:
    spec = long_spec() if node == "relay" else graph_of(node)
    with bench.start(spec) as running:
        running.wait_for(SECOND_ITERATION)
        running.sample()
        assert len(bench.processes()) >= 5
        running.process.kill()
        running.process.wait()
        wait_until_gone(bench)
        assert kept(bench, running, iterations=1) == "R2B671: the run was killed"


@only_nightly()
def test_nothing_outlives_a_controller_that_is_killed_while_the_graph_comes_up(
    bench: Bench,
) -> None:
    with bench.start(graph_of("Slow")) as running:
        running.child("relay")
        running.process.kill()
        running.process.wait()
        wait_until_gone(bench)
        kept(bench, running, iterations=0)


@only_nightly()
def test_another_run_is_not_disturbed_when_one_is_killed(bench: Bench) -> None:
    short = relay_spec()
    short["benchmark"] |= {"iterations": 4}
    with bench.start(long_spec()) as victim, bench.start(short) as survivor:
        victim.wait_for(SECOND_ITERATION)
        survivor.wait_for("warming up")
        # Nor by the loss of its watchdog, which only those need whose controller is killed.
        (watchdog,) = [process for process in bench.processes() if watches(process, survivor)]
        watchdog.kill()
        victim.process.kill()
        done = survivor.finish()
    done.assert_counts(80)
    assert done.monitor()["unmatched"] == 0


# A part of it being killed


@pytest.mark.parametrize(
    "name",
    ["player", *(pytest.param(name, marks=only_nightly()) for name in NAMES if name != "player")],
)
def test_a_process_that_is_killed_is_named(bench: Bench, name: str) -> None:
    with bench.start(long_spec()) as running:
        running.wait_for(SECOND_ITERATION)
        running.child(name).kill()
        done = running.finish()
    assert done.status == 4
    assert f"process {name} was killed by SIGKILL" in done.error
    assert f"{name} was killed by SIGKILL" in kept(bench, done, iterations=1)
    codes = {process.name: process.exit_code for process in done.run().record.processes}
    assert codes == dict.fromkeys(NAMES, 0) | {name: -signal.SIGKILL}
