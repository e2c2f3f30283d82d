"""Monitors in several processes are commanded as one."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from r2bspec.execute.bringup.harness_processes import MonitorGroup
from r2bspec.execute.processes.process import ManagedProcess
from r2bspec.ipc import protocol
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import MonitorPlan

LOG = Path("log")


class Member:
    """A monitor of which the test is the other end of its channel."""

    def __init__(self, process: Any) -> None:
        ours, self.theirs = socket.socketpair()
        self.managed = ManagedProcess("monitor", "monitor", process, LOG, ours)
        self.theirs.setblocking(False)

    def close(self) -> None:
        self.theirs.close()
        assert self.managed.connection is not None
        self.managed.connection.close()

    def commands(self) -> list[protocol.Command]:
        try:
            received = self.theirs.recv(1 << 16)
        except BlockingIOError:
            return []
        return [protocol.decode_command(line) for line in received.splitlines()]

    def reply(self, message: Any) -> None:
        self.theirs.sendall(protocol.encode(message))
        self.managed.read()


@pytest.fixture
def members() -> Iterator[list[Member]]:
    found = [Member(object()) for _ in range(2)]
    yield found
    for each in found:
        each.close()


@pytest.fixture
def group(members: list[Member]) -> MonitorGroup:
    return MonitorGroup(
        [(each.managed, frozenset({name})) for each, name in zip(members, "ab", strict=True)]
    )


def test_the_answer_is_complete_with_that_of_the_last(
    group: MonitorGroup, members: list[Member]
) -> None:
    group.send(protocol.CountMatches())
    assert [member.commands() for member in members] == [[protocol.CountMatches()]] * 2
    members[1].reply(protocol.Matched(counts={"/b": 2}))
    assert not group.inbox
    members[0].reply(protocol.Matched(counts={"/a": 1}))
    assert [*group.inbox] == [protocol.Matched(counts={"/a": 1, "/b": 2})]


def test_each_subscribes_to_its_own_topics(group: MonitorGroup, members: list[Member]) -> None:
    a, b = (
        MonitorPlan(name=name, topic=f"/{name}", type="std_msgs/msg/Int8", match="order", qos=QoS())
        for name in "ab"
    )
    group.send(protocol.Subscribe(monitors=(b,)))
    assert [asked.commands() for asked in members] == [[], [protocol.Subscribe(monitors=(b,))]]
    members[1].reply(protocol.Matched(counts={"/b": 0}))
    group.send(protocol.Subscribe(monitors=(a, b)))
    assert [asked.commands() for asked in members] == [
        [protocol.Subscribe(monitors=(each,))] for each in (a, b)
    ]
    for member in members:
        member.reply(protocol.Matched(counts={}))
    assert len(group.inbox) == 2


def test_the_error_of_one_stays_with_it(group: MonitorGroup, members: list[Member]) -> None:
    failed = protocol.Failed(code="R2B630", message="lost")
    members[1].reply(failed)
    assert [*members[1].managed.inbox] == [failed]
    assert not group.inbox
