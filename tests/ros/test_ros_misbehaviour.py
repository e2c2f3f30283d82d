"""Nodes that end in the middle of a run: who and what is said, and the rest is kept."""

from __future__ import annotations

from typing import Any

import pytest

from nightly import only_nightly
from r2bspec.report.findings_text import code_with_slug

pytest.importorskip("rclpy")

from ros_runs import Bench, relay_spec
from ros_runs import bench as bench

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
"""

WARM_UP = 10
STEPS = 20


def spec(trick: str, at: int) -> dict[str, Any]:
    """Two iterations of a second each; the trick is played at the message `at` after warm-up."""
    parameters = {"trick": trick, "at": WARM_UP + at}
    node = {"python": "./nodes.py:Relay", "parameters": parameters}
    used = relay_spec(graph={"nodes": {"relay": node}})
    used["benchmark"] |= {"iterations": 2, "rates": [f"{STEPS} Hz"]}
    return used


@pytest.mark.parametrize(
    ("trick", "words", "code"),
    [
        (
            "raises",
            "a callback of /r2b/relay raised RuntimeError: lost the plot (nodes.py:",
            "R2B634",
        ),
        *(
            pytest.param(trick, f"process relay {words}", "R2B631", marks=only_nightly())
            for trick, words in (
                ("exits", "exited with status 9"),
                ("crashes", "was killed by SIGABRT"),
            )
        ),
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
    assert record.status == done.result()["status"] == "incomplete"
    assert words in record.reason
    # The first iteration is whole, the second is there as far as it went.
    assert [(segment.id, segment.complete) for segment in done.segments()] == [
        ("rate-20Hz-001", True),
        ("rate-20Hz-002", False),
    ]
    assert 0 < done.run().playback(record.segments[-1]).size < STEPS
    assert done.monitor()["answered"] == STEPS
    assert done.result()["metrics"]["incomplete"] == ["rate-20Hz-002"]
    judged = bench.judge(done.folder)
    assert "lost the plot" in judged.stdout or trick != "raises"
    assert judged.status == 4
    # What a dying node said last is shown, and where the rest of it is.
    assert "out of memory" in done.error or trick != "exits"
    assert str(done.folder / "logs" / "relay.log") in done.error


@only_nightly()
def test_a_node_that_dies_at_the_very_last_message_passes_nothing(bench: Bench) -> None:
    done = bench.run(spec("answers_and_exits", 2 * STEPS))
    assert done.status == 4
    assert done.error.startswith(
        "error[R2B631 process-ended-early]: process relay exited with status 9"
    )
    assert done.result()["verdict"]["outcome"] == "incomplete"


def test_two_runs_at_once_do_not_meet_and_a_folder_belongs_to_one(bench: Bench) -> None:
    quiet = spec("raises", 1_000_000)
    with bench.start(quiet) as first, bench.start(quiet) as second:
        first.wait_for("starting player and monitor")
        refused = bench.run(relay_spec(), "--report", "json=refused.json", output=first.folder)
        both = [first.finish(), second.finish()]
    assert refused.status == 2
    assert refused.error.startswith("error[R2B651 run-folder-not-writable]")
    assert str(first.folder) in refused.error
    # What is in the folder is the first run's: the one that is refused reports none of it.
    assert not (bench.folder / "refused.json").exists()
    for done in both:
        done.assert_counts(2 * STEPS)
        assert done.monitor()["unmatched"] == 0
        assert [each.name for each in done.folder.iterdir() if each.name.startswith(".")] == []
    assert len({done.run().record.run_id for done in both}) == 2
