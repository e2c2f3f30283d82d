"""The control channel and the messages on it."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from typing import NamedTuple

import msgspec
import pytest

from plans import node_plan
from r2bspec.harness.control_channel import Channel, ChannelClosedError
from r2bspec.ipc import protocol
from r2bspec.ipc.schedule import (
    BetweenMessage,
    CyclicSchedule,
    TimelineMessage,
    TimelineSchedule,
    TimelineStep,
)
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import InputPlan, MonitorPlan

INPUT = InputPlan(
    topic="/r2b/image",
    type="sensor_msgs/msg/Image",
    source="/r2b/loaded",
    bag_topic="/camera",
    qos=QoS(reliability="best_effort", depth=3),
)
MONITOR = MonitorPlan(
    name="out", topic="/r2b/out", type="sensor_msgs/msg/Image", match="order", qos=None
)
NODE = node_plan(
    "relay", parameters={"rate": 1.5, "count": 2, "names": ["a", "b"], "on": True, "text": "10"}
)
ENDPOINT = protocol.Endpoint(
    node="/r2b/relay", type="x/msg/Y", reliability="reliable", durability="volatile"
)

# Those with values of types of their own; of all others msgspec writes what it reads.
COMMANDS: list[protocol.Command] = [
    protocol.ConfigurePlayer(
        inputs=(INPUT, INPUT), buffer_dir="/b", rows="/rows", transforms=("/tf",)
    ),
    protocol.LoadSchedule(
        schedule=CyclicSchedule(steps=((0, 1), (2, 3)), between=(BetweenMessage(0.5, 2, 7, -1),))
    ),
    protocol.LoadSchedule(
        schedule=TimelineSchedule(
            steps=(TimelineStep(5, 1),),
            messages=(TimelineMessage(0, 0, 0, 3),),
            origin_ns=5,
            period_ns=10,
            stamp_period_ns=20,
            inputs=1,
        )
    ),
    protocol.ConfigureMonitor(monitors=(MONITOR,), rows_dir="/rows"),
    protocol.ConfigureHost(nodes=(NODE,), base_dir="/spec"),
    protocol.Play(rate_hz=29.97, steps=100),
    protocol.Shutdown(),
]
REPLIES: list[protocol.Reply] = [
    protocol.Ready(
        endpoints=(("/r2b/relay", "/r2b/in", "x/msg/Y", "subscribes"),),
        undeclared=(("/r2b/relay", "tpyo"),),
        parameters={"/r2b/relay": ("typo",)},
    ),
    protocol.Discovered(writers={"/a": (ENDPOINT,)}, readers={"/a": ()}),
    protocol.Failed(code="R2B633", message="line one\nline two: \N{SNOWMAN}", hint="h"),
]


class Ends(NamedTuple):
    """Those of a child and of the controller."""

    channel: Channel
    controller: socket.socket


@pytest.fixture
def ends() -> Iterator[Ends]:
    theirs, ours = socket.socketpair()
    with theirs, ours:
        ours.settimeout(30)
        yield Ends(Channel(theirs), ours)


@pytest.mark.parametrize("reply", REPLIES, ids=lambda each: type(each).__name__)
def test_every_reply_is_one_line_that_reads_back(ends: Ends, reply: protocol.Reply) -> None:
    ends.channel.send(reply)
    line = ends.controller.recv(1 << 16)
    assert line.count(b"\n") == 1
    assert line.endswith(b"\n")
    assert protocol.decode_reply(line) == reply


@pytest.mark.parametrize(
    "line",
    [b"", b"{}", b"[]", b'{"type":"Dance"}', b'{"type":"Play"}', b'{"type":"Ready"}', b"\xff"],
)
def test_what_is_no_command_is_refused(line: bytes) -> None:
    with pytest.raises((msgspec.DecodeError, UnicodeDecodeError)):
        protocol.decode_command(line)


def test_every_command_arrives_as_it_was_sent_in_pieces_and_together(ends: Ends) -> None:
    data = b"".join(protocol.encode(each) for each in COMMANDS)

    def drip() -> None:
        for start in range(0, len(data), 7):
            ends.controller.sendall(data[start : start + 7])

    thread = threading.Thread(target=drip)
    thread.start()
    assert [ends.channel.receive() for _ in COMMANDS] == COMMANDS
    thread.join()


def test_the_end_of_the_controller_is_noticed(ends: Ends) -> None:
    # Half a command is none.
    ends.controller.sendall(protocol.encode(protocol.Stop())[:-3])
    ends.controller.close()
    assert ends.channel.wait(30.0) is True
    with pytest.raises(ChannelClosedError):
        ends.channel.receive()
    with pytest.raises(ChannelClosedError):
        ends.channel.send(protocol.Ready())


def test_the_socket_is_taken_from_the_environment_once(monkeypatch: pytest.MonkeyPatch) -> None:
    theirs, ours = socket.socketpair()
    with ours:
        number = theirs.detach()
        os.set_inheritable(number, True)
        monkeypatch.setenv(protocol.CONTROL_FD_VARIABLE, str(number))
        channel = Channel.from_environment()
        # A program that a node starts gets neither the variable nor the socket.
        assert protocol.CONTROL_FD_VARIABLE not in os.environ
        assert not os.get_inheritable(number)
        ours.sendall(protocol.encode(protocol.Stop()))
        assert channel.receive() == protocol.Stop()
        channel._socket.close()
