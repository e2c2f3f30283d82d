"""Promise: nodes that hang, will not end, or print without end, spoil a run for nobody else."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("rclpy")

from r2bspec.execute.processes.process import MAX_LOG_BYTES
from ros_runs import IMAGE, Bench, Finished, relay_node, relay_spec
from ros_runs import nothing_left as nothing_left

STEPS = 20

NODES = """
import os
import signal
import sys
import time


class Relays(Node):
    def __init__(self, **kwargs):
        super().__init__("node", **kwargs)
        self.begin()
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.answer, 100)

    def begin(self):
        pass

    def answer(self, message):
        self.out.publish(message)


class Stubborn(Relays):
    # Its callback never returns, and it does not hear what asks it to end.
    def begin(self):
        self.count = 0
        signal.signal(signal.SIGTERM, signal.SIG_IGN)

    def answer(self, message):
        super().answer(message)
        self.count += 1
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
        super().answer(message)
"""


def node(name: str) -> dict[str, Any]:
    return {"python": f"./nodes.py:{name}", "remappings": {"output": f"out/{name.lower()}"}}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """One run with all of them, and an honest node among them."""
    bench = Bench(tmp_path_factory.mktemp("nodes"))
    bench.write_node("nodes.py", NODES)
    kinds = ("Stubborn", "Daemons", "Floods")
    spec = relay_spec(
        graph={
            "nodes": {kind.lower(): node(kind) for kind in kinds}
            | {"honest": relay_node(remappings={"output": "out/honest"})}
        },
        monitors={
            name: {"topic": f"out/{name}", "format": IMAGE}
            for name in ("stubborn", "daemons", "floods", "honest")
        },
    )
    spec["benchmark"] |= {"iterations": 2}
    return bench.run(spec)


def pooled(done: Finished, monitor: str) -> dict[str, Any]:
    (rate,) = done.result()["metrics"]["rates"]
    found: dict[str, Any] = rate["pooled"]["monitors"][monitor]
    return found


def test_the_run_goes_to_its_end_and_the_honest_are_measured(done: Finished) -> None:
    done.assert_complete()
    for monitor in ("honest", "daemons", "floods"):
        found = pooled(done, monitor)
        assert found["sent"] == 2 * STEPS
        assert found["missed"] == 0, monitor


def test_a_node_that_hangs_is_measured_up_to_then_and_killed_in_the_end(done: Finished) -> None:
    found = pooled(done, "stubborn")
    assert 0 < found["missed"] < 2 * STEPS
    assert found["answered"] + found["missed"] == 2 * STEPS
    assert "hangs" in done.log("stubborn")
    codes = {each.name: each.exit_code for each in done.run().record.processes}
    assert codes["stubborn"] == -9
    # The others have left in good order.
    assert {code for name, code in codes.items() if name != "stubborn"} == {0}


def test_who_had_to_be_killed_is_told(done: Finished) -> None:
    (said,) = [
        each for each in done.events() if each.startswith("killed, because they did not exit: ")
    ]
    assert "stubborn" in said
    # The daemon has no name but that of its program.
    assert "python" in said
    assert said in done.stderr


def test_a_daemon_that_a_node_has_started_ends_with_the_run(done: Finished) -> None:
    words = done.log("daemons").split()
    pid, session = words[words.index("daemon") + 1 :][:2]
    process = next(each for each in done.run().record.processes if each.name == "daemons")
    # It had left the session of its parent; `nothing_left` has seen that it is gone.
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
