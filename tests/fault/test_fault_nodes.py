"""Promise: nodes that hang, will not end, print without end or fall silent spoil a run for nobody.

One run with all of them, and an honest node among them; each has a monitor of its name.
"""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy")

from r2bspec.execute.processes.process import MAX_LOG_BYTES
from ros_runs import IMAGE, Bench, Finished, relay_spec

STEPS = 20
ALL = 2 * STEPS

NODES = """
import os
import signal
import sys
import time


class Relays(Node):
    def __init__(self, **kwargs):
        super().__init__("node", **kwargs)
        self.count = 0
        self.begin()
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.take, 100)

    def begin(self):
        pass

    def take(self, message):
        self.count += 1
        self.answer(message)

    def answer(self, message):
        self.out.publish(message)


class Stubborn(Relays):
    # Its callback never returns, and it does not hear what asks it to end.
    def begin(self):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)

    def answer(self, message):
        self.out.publish(message)
        if self.count == 25:
            print("hangs", flush=True)
            time.sleep(600)


class Daemons(Relays):
    # Starts a daemon as daemons start: forked twice, in a session of its own, deaf to signals.
    def begin(self):
        if os.fork() == 0:
            os.setsid()
            if os.fork() != 0:
                os._exit(0)
            for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                signal.signal(each, signal.SIG_IGN)
            print("daemon", os.getpid(), os.getsid(0), flush=True)
            time.sleep(600)
            os._exit(0)
        os.wait()


class Floods(Relays):
    # More than a log may hold, with every message.
    def answer(self, message):
        words = b"word " * (1 << 20)
        for _ in range(2):
            os.write(2, words)
        self.out.publish(message)


class Silent(Relays):
    # In the middle of the second iteration, after ten messages of warm-up.
    def answer(self, message):
        if self.count < 40:
            self.out.publish(message)
"""
APART = ("Stubborn", "Daemons", "Floods")
TOGETHER = ("Silent", "Relays")


def node(kind: str, **changes: Any) -> dict[str, Any]:
    return {"python": f"./nodes.py:{kind}", "remappings": {"output": f"out/{kind}"}} | changes


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    bench = Bench(tmp_path_factory.mktemp("nodes"))
    bench.write_node("nodes.py", NODES)
    nodes = {kind.lower(): node(kind) for kind in APART}
    nodes |= {kind.lower(): node(kind, container="box") for kind in TOGETHER}
    spec = relay_spec(
        containers={"box": {"executable": "python"}},
        graph={"nodes": nodes},
        monitors={kind: {"topic": f"out/{kind}", "format": IMAGE} for kind in (*APART, *TOGETHER)},
    )
    spec["benchmark"] |= {"iterations": 2, "rates": [f"{STEPS} Hz"], "drain_timeout": "2 s"}
    return bench.run(spec)


@pytest.mark.parametrize("monitor", ["Relays", "Daemons", "Floods"])
def test_the_run_goes_to_its_end_and_the_honest_are_measured(done: Finished, monitor: str) -> None:
    done.assert_counts(ALL, monitor)


def test_a_node_that_hangs_is_measured_up_to_then_and_killed_in_the_end(done: Finished) -> None:
    found = done.monitor("Stubborn")
    assert 0 < found["missed"] < ALL
    assert found["answered"] + found["missed"] == ALL
    assert "hangs" in done.log("stubborn")
    codes = {process.name: process.exit_code for process in done.run().record.processes}
    assert codes["stubborn"] == -9
    # The others have left in good order.
    assert {code for name, code in codes.items() if name != "stubborn"} == {0}


def test_who_had_to_be_killed_is_told(done: Finished) -> None:
    (said,) = [
        event for event in done.events() if event.startswith("killed, because they did not exit: ")
    ]
    assert "stubborn" in said
    # The daemon has no name but that of its program.
    assert "python" in said
    assert said in done.stderr


def test_a_daemon_that_a_node_has_started_ends_with_the_run(done: Finished) -> None:
    words = done.log("daemons").split()
    pid, session = words[words.index("daemon") + 1 :][:2]
    process = next(listed for listed in done.run().record.processes if listed.name == "daemons")
    # It had left the session of its parent; that it is gone is seen after each test.
    assert int(session) not in {process.pid, int(pid)}


def test_a_log_without_end_is_cut_and_the_run_says_so(done: Finished) -> None:
    log = done.folder / "logs" / "floods.log"
    assert log.stat().st_size <= MAX_LOG_BYTES
    text = log.read_bytes()
    assert text.startswith(b"word word ")
    # It may have been cut while a word was being written.
    assert text[-5:] in b"word word "
    assert text.count(b" MiB of this log here]\n") == 1
    assert "truncated large logs: floods.log" in done.events()


def test_a_node_that_falls_silent_is_measured_as_such(done: Finished) -> None:
    found = done.monitor("Silent")
    assert found["sent"] == ALL
    assert 0 < found["missed"] < ALL
    assert found["answered"] == ALL - found["missed"]


def test_an_output_that_stops_half_way_is_told_with_where_its_messages_end(done: Finished) -> None:
    (gap,) = [each for each in done.result()["output_gaps"] if each["topic"] == "/r2b/out/Silent"]
    assert gap["segment"] == "rate-20Hz-002"
    assert gap["reason"] == (
        "/r2b/silent publishes nothing on /r2b/out/Silent, although it subscribes to "
        "/r2b/input (10 messages)"
    )
    assert "; 10 messages" in gap["way"][0]
    assert "No more messages on /r2b/out/Silent in rate-20Hz-002." in done.stdout
