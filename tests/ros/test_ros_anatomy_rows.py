"""What the processes of a graph record of themselves, with the object preloaded into real ones."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from c_nodes import c_node_spec
from r2bspec.execute.processes.prerequisites import reserved_domain
from r2bspec.middleware.middleware import SHARED_MEMORY
from r2bspec.native.build import anatomy_environment, anatomy_object
from r2bspec.record.anatomy_files import AnatomyReader, file_bytes
from r2bspec.record.run_record import AnatomyKind as Kind
from ros_runs import HANG_S, Bench, relay_node, relay_spec
from ros_runs import bench as bench

STEPS = 200
LONG_QUEUE = {"queue_depth": 2 * STEPS}
"""For all messages: the threads of rclpy sometimes stand still for seconds."""
RELAY = relay_node()
RELAY["parameters"] |= LONG_QUEUE
CHAIN = {
    "single": RELAY | {"remappings": {"output": "first"}},
    "multi": RELAY
    | {"executor": "multi_threaded", "threads": 3}
    | {"remappings": {"input": "first", "output": "second"}},
    "native": c_node_spec("relay", parameters=LONG_QUEUE, remappings={"input": "second"}),
}
ROUTE = ("/r2b/input", "/r2b/first", "/r2b/second", "/r2b/output")
"""From the player over the nodes of the chain to the monitor."""
ENDS = ("/r2bspec/player", "/r2b/single", "/r2b/multi", "/r2b/relay", "/r2bspec/monitor")
SPEC = relay_spec(environment=["FOLDER", "PROCESS", "BYTES"], graph={"nodes": CHAIN})
SPEC["environment"] = [f"R2BSPEC_ANATOMY_{name}" for name in SPEC["environment"]]
SPEC["benchmark"] |= {"rates": ["50 Hz"], "duration": f"{STEPS // 50} s", "drain_timeout": "60 s"}

SLACK_NS = 1_000_000
"""The system clock may be adjusted while it is compared with the monotonic one."""


class Recorded:
    """What was recorded in a folder."""

    def __init__(self, folder: Path) -> None:
        self.rows, self.objects, self.processes = AnatomyReader(folder).read()

    def of(self, kind: Kind, topic: str) -> Any:
        """The events of a kind about a topic or service; of takes those that took something."""
        named = np.array([False, *(each.name == topic for each in self.objects)])
        rows = self.rows[(self.rows["kind"] == kind) & named[self.rows["object"]]]
        return rows[(rows["flags"] & 1) == 0]

    def node(self, row: Any) -> str:
        return str(self.objects[row["object"] - 1].node)

    def after(self, row: Any) -> Any:
        """What the thread did after an event, until it waited or took something else."""
        same = (self.rows["process"] == row["process"]) & (self.rows["thread"] == row["thread"])
        later = self.rows[same & (self.rows["began_ns"] > row["began_ns"])]
        ends = np.isin(later["kind"], [Kind.WAIT, Kind.TAKE, Kind.TAKE_REQUEST, Kind.TIMER])
        return later[: ends.argmax() if ends.any() else None]


@pytest.fixture(scope="module")
def chain(bench: Bench) -> Iterator[Recorded]:
    with (
        tempfile.TemporaryDirectory(dir=SHARED_MEMORY) as folder,
        pytest.MonkeyPatch.context() as patch,
    ):
        # The multi-threaded executor of rclpy sometimes spins.
        size = file_bytes(5_000 * STEPS)
        for item in anatomy_environment(anatomy_object(), Path(folder), "any", size, "").items():
            patch.setenv(*item)
        done = bench.run(SPEC)
        recorded = Recorded(Path(folder))
        done.assert_counts(STEPS)
        yield recorded


def test_each_message_is_followed_from_the_player_to_the_monitor(chain: Recorded) -> None:
    assert all(each.lost == 0 for each in chain.processes)
    headers = []
    for topic, (writer, reader) in zip(ROUTE, itertools.pairwise(ENDS), strict=True):
        published, taken = chain.of(Kind.PUBLISH, topic), chain.of(Kind.TAKE, topic)
        assert {chain.node(row) for row in published} == {writer}
        assert {chain.node(row) for row in taken} == {reader}
        # The warm-up is played, too.
        assert len(published) > STEPS
        assert published["source_ns"].tolist() == taken["source_ns"].tolist()
        headers += [published["header_ns"].tolist(), taken["header_ns"].tolist()]
        source_ns = published["source_ns"] - published["clock_ns"]
        received_ns = taken["received_ns"] - taken["clock_ns"]
        assert (published["began_ns"] <= source_ns + SLACK_NS).all()
        assert (source_ns <= published["ended_ns"] + SLACK_NS).all()
        assert (source_ns <= received_ns + 2 * SLACK_NS).all()
        assert (received_ns <= taken["ended_ns"] + SLACK_NS).all()
    # Relays keep the header, whether messages are serialized, structures of C, or of Python.
    assert headers == [headers[0]] * len(headers)
    assert len(set(headers[0])) == len(headers[0])


@pytest.mark.parametrize(("hop", "number"), [("/r2b/first", 0), ("/r2b/second", 1)])
def test_the_executor_of_rclpy_triggers_before_and_after_a_callback(
    chain: Recorded, hop: str, number: int
) -> None:
    published = set(chain.of(Kind.PUBLISH, hop)["began_ns"].tolist())
    for take in chain.of(Kind.TAKE, ROUTE[number]):
        after = chain.after(take)
        assert after["kind"].tolist() == [Kind.TRIGGER, Kind.PUBLISH, Kind.TRIGGER]
        assert after["began_ns"][1] in published
        assert after["header_ns"][1] == take["header_ns"]


def test_what_a_node_in_c_does_follows_its_take(chain: Recorded) -> None:
    for take in chain.of(Kind.TAKE, "/r2b/second"):
        assert chain.after(take)["kind"].tolist() == [Kind.PUBLISH]


def test_threads_of_an_executor_are_told_apart(chain: Recorded) -> None:
    def threads(rows: Any) -> set[int]:
        return set(rows["thread"].tolist())

    waiting = chain.rows[chain.rows["kind"] == Kind.WAIT]
    single, multi = chain.of(Kind.TAKE, ROUTE[0]), chain.of(Kind.TAKE, ROUTE[1])
    assert threads(single) == threads(waiting[waiting["process"] == single["process"][0]])
    assert not threads(multi) & threads(waiting[waiting["process"] == multi["process"][0]])


CALLS = 20
CALLER = f"""
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rcl_interfaces.srv import ListParameters as Ask

rclpy.init()
node = rclpy.create_node("caller", namespace="/space")
group = ReentrantCallbackGroup()
service = node.create_service(Ask, "answer", lambda _, reply: reply, callback_group=group)
client = node.create_client(Ask, "answer", callback_group=group)
assert client.wait_for_service({HANG_S})
answers = []

def call():
    answers.append(client.call(Ask.Request()))
    if len(answers) == {CALLS}:
        rclpy.shutdown()

node.create_timer(0.001, call)
executor = MultiThreadedExecutor(3)
executor.add_node(node)
executor.spin()
"""


def test_timers_and_services_are_followed(tmp_path: Path) -> None:
    variables = anatomy_environment(anatomy_object(), tmp_path, "caller", file_bytes(10_000), "")
    with reserved_domain() as domain:
        environment = os.environ | variables | {"ROS_DOMAIN_ID": str(domain)}
        subprocess.run([sys.executable, "-c", CALLER], env=environment, timeout=HANG_S, check=True)
    found = Recorded(tmp_path)
    sent, asked, answered, taken = (
        found.of(kind, "/space/answer")
        for kind in (Kind.SEND_REQUEST, Kind.TAKE_REQUEST, Kind.SEND_RESPONSE, Kind.TAKE_RESPONSE)
    )
    assert sent["source_ns"].tolist() == [*range(1, CALLS + 1)]
    for later in (asked, answered, taken):
        assert later["source_ns"].tolist() == sent["source_ns"].tolist()
    timers = found.rows[found.rows["kind"] == Kind.TIMER]
    assert len(timers) >= CALLS
    assert {found.objects[number - 1].kind for number in timers["object"]} == {"timer"}
    for began, request in zip(timers, sent, strict=False):
        assert found.after(began)["kind"][0] == Kind.TRIGGER
        assert request["began_ns"] > began["ended_ns"]
