"""Searches for the peak of nodes with bad habits: nothing is claimed that they do not sustain."""

from __future__ import annotations

from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import Bench, Finished, relay_spec

pytestmark = only_nightly()

NODES = """
import random
import time


class Habit(Node):
    # A relay that takes 5 ms a message, with a habit.
    def __init__(self, **kwargs):
        super().__init__("relay", **kwargs)
        self.loses = self.declare_parameter("loses", 0.0).value
        self.asleep_s = self.declare_parameter("asleep_s", 0.0).value
        self.every_s = self.declare_parameter("every_s", 2.0).value
        self.random = random.Random(1)
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.answer, 100)

    def answer(self, message):
        if time.monotonic() % self.every_s < self.asleep_s:
            time.sleep(self.asleep_s)
        time.sleep(0.005)
        if self.random.random() >= self.loses:
            self.out.publish(message)
"""


def spec(habit: dict[str, float], search: dict[str, Any], sustained: str) -> dict[str, Any]:
    """A search, a rate that must be sustained, and a low rate that the peak must reach."""
    return relay_spec(
        graph={"nodes": {"relay": {"python": "./nodes.py:Habit", "parameters": habit}}},
        benchmark={
            "duration": "500 ms",
            "iterations": 2,
            "warm_up": "100 ms",
            "start_timeout": "60 s",
            "search": {"min": "30 Hz"} | search,
            "gate": {"confirm": False, "interference": "tolerate"},
        },
        slos={
            "at_its_limit": {"at": "peak", "level": "info", "require": ["received >= 0"]},
            "peak": {"require": ["peak.rate >= 60 Hz"]},
            "rate": {"at": sustained, "require": ["sustained"]},
        },
    )


def run(folder: Any, habit: dict[str, float], search: dict[str, Any], sustained: str) -> Finished:
    bench = Bench(folder)
    bench.write_node("nodes.py", NODES)
    return bench.run(spec(habit, search, sustained))


def outcomes(done: Finished) -> dict[str, str]:
    return {one["objective"]: one["outcome"] for one in done.result()["verdict"]["requirements"]}


@pytest.fixture(scope="module")
def losing(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """Of a node that loses one message in ten, where none may be lost."""
    search = {"precision": "4 %", "probe": "2 s", "confirm": "2 s", "max": "300 Hz"}
    return run(tmp_path_factory.mktemp("losing"), {"loses": 0.1}, search, "60 Hz")


@pytest.fixture(scope="module")
def sleeping(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """Of a node that sleeps for 0.3 s of each second."""
    search = {"precision": "5 %", "probe": "3 s", "confirm": "3 s", "max": "300 Hz"}
    habit = {"asleep_s": 0.3, "every_s": 1.0}
    return run(tmp_path_factory.mktemp("sleeping"), habit, search, "40 Hz")


def test_a_node_that_loses_messages_passes_nothing(losing: Finished) -> None:
    found = outcomes(losing)
    assert found["peak"] != "pass"
    assert found["rate"] != "pass"


def test_and_no_peak_of_it_is_proved(losing: Finished) -> None:
    search = losing.run().record.search
    assert search is not None
    assert search.holds_hz is None or search.proof == "open"
    assert "confidence" not in losing.words.split("peak ")[1].split("probes")[0]
    played = [each for each in search.probes if not each.holds]
    assert any("dropped" in each.reason for each in played)


def test_stops_are_seen_as_what_they_are(sleeping: Finished) -> None:
    search = sleeping.run().record.search
    assert search is not None
    assert search.unsteady
    assert not search.shown
    assert "not steady: " in sleeping.words
    assert "stops for" in sleeping.words


def test_a_graph_that_stops_is_not_promised_to_sustain_what_it_reaches_in_between(
    sleeping: Finished,
) -> None:
    search = sleeping.run().record.search
    assert search is not None
    (peak,) = (
        one for one in sleeping.result()["verdict"]["requirements"] if one["objective"] == "peak"
    )
    assert "Not steady: " in peak["reason"] or peak["outcome"] != "pass"
    # It reaches 190 Hz between its stops.
    assert search.holds_hz is None or search.holds_hz < 190
