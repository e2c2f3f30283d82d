"""Nodes that go wrong in the middle of a run: who and what is said, and the rest is kept."""

from __future__ import annotations

from typing import Any

import pytest

from r2bspec.report.findings_text import code_with_slug

pytest.importorskip("rclpy")

from ros_runs import IMAGE, Bench, Finished, relay_spec
from ros_runs import nothing_left as nothing_left

NODES = """
import os
import sys


class Relay(Node):
    # Goes wrong at the message of this number; the first ten warm it up.
    def __init__(self, **kwargs):
        super().__init__("relay", **kwargs)
        self.trick = self.declare_parameter("trick", "").value
        self.at = self.declare_parameter("at", 0).value
        self.count = 0
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.answer, 100)

    def answer(self, message):
        self.count += 1
        if self.count >= self.at:
            getattr(self, self.trick)(message)
        else:
            self.out.publish(message)

    def raises(self, message):
        raise RuntimeError("lost the plot")

    def exits(self, message):
        print("out of memory", file=sys.stderr, flush=True)
        os._exit(9)

    def answers_and_exits(self, message):
        self.out.publish(message)
        os._exit(9)

    def crashes(self, message):
        os.abort()

    def falls_silent(self, message):
        pass

    def repeats(self, message):
        self.out.publish(message)
        self.out.publish(message)

    def shouts(self, message):
        print("word " * 1000, file=sys.stderr)
        self.out.publish(message)

    def restamps(self, message):
        message.header.stamp.nanosec ^= 1
        self.out.publish(message)
"""

WARM_UP = 10
STEPS = 20


def node(trick: str, at: int) -> dict[str, Any]:
    """A node that plays a trick at the message `at` after warm-up."""
    parameters = {"trick": trick, "at": WARM_UP + at}
    return {"python": "./nodes.py:Relay", "parameters": parameters}


def spec(trick: str, at: int) -> dict[str, Any]:
    """Two iterations of a second each; the trick is played at the message `at` after warm-up."""
    used = relay_spec(graph={"nodes": {"relay": node(trick, at)}})
    used["benchmark"] |= {"iterations": 2, "rates": [f"{STEPS} Hz"]}
    return used


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("misbehaviour"))
    found.write_node("nodes.py", NODES)
    return found


def pooled(done: Finished, monitor: str = "out") -> dict[str, Any]:
    """The metrics of a monitor at the only rate."""
    (rate,) = done.result()["metrics"]["rates"]
    found: dict[str, Any] = rate["pooled"]["monitors"][monitor]
    return found


@pytest.mark.parametrize(
    ("trick", "words", "code"),
    [
        ("raises", "a callback of /r2b/relay raised RuntimeError: lost the plot", "R2B634"),
        ("exits", "process relay exited with status 9", "R2B631"),
        ("crashes", "process relay was killed by SIGABRT", "R2B631"),
    ],
)
def test_a_node_that_fails_ends_the_run_and_what_was_measured_is_kept(
    bench: Bench, trick: str, words: str, code: str
) -> None:
    done = bench.run(spec(trick, STEPS + STEPS // 2))
    assert done.status == 4
    assert words in done.error
    assert done.error.startswith(f"error[{code_with_slug(code)}]")
    record = done.run().record
    assert record.status == "incomplete"
    assert words in record.reason
    # The first iteration is whole, the second is there as far as it went.
    assert [(each.id, each.complete) for each in record.segments if each.kind == "iteration"] == [
        ("rate-20Hz-001", True),
        ("rate-20Hz-002", False),
    ]
    assert 0 < done.run().playback(record.segments[-1]).size < STEPS
    assert done.result()["status"] == "incomplete"
    assert pooled(done)["answered"] == STEPS
    assert done.result()["metrics"]["incomplete"] == ["rate-20Hz-002"]
    judged = bench.judge(done.folder)
    assert "lost the plot" in judged.stdout or trick != "raises"
    assert judged.status == 4
    # What a dying node said last is shown, and where the rest of it is.
    assert "out of memory" in done.error or trick != "exits"
    assert str(done.folder / "logs" / "relay.log") in done.error


def test_a_node_that_dies_at_the_very_last_message_passes_nothing(bench: Bench) -> None:
    done = bench.run(spec("answers_and_exits", 2 * STEPS))
    assert done.status == 4
    assert done.error.startswith(
        "error[R2B631 process-ended-early]: process relay exited with status 9"
    )
    assert done.result()["verdict"]["outcome"] == "incomplete"


@pytest.fixture(scope="module")
def strange(bench: Bench) -> Finished:
    """One run of nodes that live but do not what is expected; each has a monitor of its name."""
    # Warming up may take more than one attempt, and a node may miss some of it.
    tricks = {
        "falls_silent": STEPS + STEPS // 2,
        "repeats": -WARM_UP,
        "restamps": -WARM_UP,
        "shouts": -WARM_UP,
    }
    used = spec("raises", 1)
    used["graph"]["nodes"] = {
        trick: node(trick, at) | {"remappings": {"output": f"out/{trick}"}}
        for trick, at in tricks.items()
    }
    used["monitors"] = {trick: {"topic": f"out/{trick}", "format": IMAGE} for trick in tricks}
    return bench.run(used)


def test_strange_nodes_do_not_end_a_run(strange: Finished) -> None:
    strange.assert_complete()


def test_a_node_that_falls_silent_is_measured_as_such(strange: Finished) -> None:
    found = pooled(strange, "falls_silent")
    assert found["sent"] == 2 * STEPS
    assert 0 < found["missed"] < 2 * STEPS
    assert found["answered"] == 2 * STEPS - found["missed"]


def test_an_output_that_stops_half_way_is_told_with_where_its_messages_end(
    strange: Finished,
) -> None:
    (silence,) = strange.result()["output_gaps"]
    assert (silence["topic"], silence["segment"]) == ("/r2b/out/falls_silent", "rate-20Hz-002")
    assert silence["reason"] == (
        "/r2b/falls_silent publishes nothing on /r2b/out/falls_silent, although it subscribes to "
        "/r2b/input (10 messages)"
    )
    assert "; 10 messages" in silence["way"][0]
    assert "No more messages on /r2b/out/falls_silent in rate-20Hz-002." in strange.stdout


def test_answers_that_come_twice_are_counted_as_duplicates(strange: Finished) -> None:
    found = pooled(strange, "repeats")
    assert found["missed"] == 0
    assert found["duplicates"] + found["unmatched"] == 2 * STEPS
    assert found["received"] == 4 * STEPS


def test_answers_with_another_stamp_are_counted_as_unmatched(strange: Finished) -> None:
    found = pooled(strange, "restamps")
    assert found["received"] == found["unmatched"] == 2 * STEPS
    assert found["missed"] == 2 * STEPS


def test_a_node_that_floods_its_log_blocks_nobody(strange: Finished) -> None:
    assert pooled(strange, "shouts")["answered"] == 2 * STEPS
    assert strange.log("shouts").count("word") >= 2 * STEPS * 1000


def test_a_second_run_with_the_same_folder_is_refused_at_once(bench: Bench) -> None:
    quiet = spec("falls_silent", 1_000_000)
    with bench.start(quiet) as first:
        first.wait_for("starting player and monitor")
        second = bench.run(relay_spec(), "--report", "json=second.json", output=first.folder)
        done = first.finish()
    assert second.status == 2
    assert second.error.startswith("error[R2B651 run-folder-not-writable]")
    assert str(first.folder) in second.error
    # What is in the folder is the first run's: the second reports none of it.
    assert not (bench.folder / "second.json").exists()
    done.assert_complete()
    assert done.run().plan.name == done.result()["name"]
    assert [each.name for each in done.folder.iterdir() if each.name.startswith(".")] == []


def test_two_runs_at_once_do_not_meet(bench: Bench) -> None:
    quiet = spec("falls_silent", 1_000_000)
    with bench.start(quiet) as first, bench.start(quiet) as second:
        both = [first.finish(), second.finish()]
    domains = set()
    for done in both:
        done.assert_complete()
        assert pooled(done)["unmatched"] == 0
        assert pooled(done)["received"] == pooled(done)["sent"] == 2 * STEPS
        domains.add(done.run().record.run_id)
    assert len(domains) == 2
