"""Single messages through services, buffers within a process, and other ways, written by hand."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
import pytest

from plans import process_plan
from r2bspec.judge.measure.anatomy import Anatomy, anatomy
from r2bspec.plan.plan import CallPlan, MonitorPlan, Plan
from r2bspec.record.run_record import AnatomyKind, AnatomyObject, AnatomyProcess, AnatomyRecord
from r2bspec.record.sample_arrays import ANATOMY_DTYPE
from simulated_anatomies import CHAIN, CLOCK_NS, plan_of

START_NS = 1_000_000_000
US = 1000


@dataclass
class Script:
    """Events, written with times in microseconds since the start."""

    rows: list[tuple[int, ...]] = field(default_factory=list)
    processes: list[str] = field(default_factory=list)
    objects: list[tuple[int, str, str, str]] = field(default_factory=list)

    def add(
        self,
        process: str,
        kind: AnatomyKind,
        began: int,
        ended: int,
        of: tuple[str, str, str] | None = None,
        *,
        source: int = 0,
        received: int | None = None,
        thread: int = 1,
        header: int = 0,
        flags: int = 0,
    ) -> None:
        if process not in self.processes:
            self.processes.append(process)
        number = self.processes.index(process)
        place = 0
        if of is not None:
            if (number, *of) not in self.objects:
                self.objects.append((number, *of))
            place = self.objects.index((number, *of)) + 1
        stamp = CLOCK_NS + START_NS
        self.rows.append(
            (
                *(place, number, thread, kind, flags),
                *(START_NS + began * US, START_NS + ended * US),
                source,
                0 if received is None else stamp + received * US,
                *(header, CLOCK_NS),
            )
        )

    def publish(self, process: str, topic: str, began: int, node: str = "", **more: Any) -> None:
        """A publication of 2 µs, whose middleware has it after one."""
        source = CLOCK_NS + START_NS + (began + 1) * US
        of = ("publisher", topic, node or f"/r2b/{process}")
        self.add(process, AnatomyKind.PUBLISH, began, began + 2, of, source=source, **more)

    def take(
        self, process: str, topic: str, began: int, sent: int, node: str = "", **more: Any
    ) -> None:
        """A take of 2 µs of a message that was sent then, and received 5 µs before the take."""
        source = CLOCK_NS + START_NS + (sent + 1) * US
        of = ("subscription", topic, node or f"/r2b/{process}")
        self.add(
            process,
            AnatomyKind.TAKE,
            began,
            began + 2,
            of,
            source=source,
            received=began - 5,
            **more,
        )

    def callback(self, process: str, began: int, ended: int, **more: Any) -> None:
        """One of rclcpp."""
        self.add(process, AnatomyKind.CALLBACK, began, ended, **more)

    def joined(self, plan: Plan | None = None) -> Anatomy:
        record = AnatomyRecord(
            start=1,
            processes=tuple(AnatomyProcess(name=name, pid=1) for name in self.processes),
            objects=tuple(
                msgspec.convert(
                    {"process": process, "kind": kind, "name": name, "node": node}, AnatomyObject
                )
                for process, kind, name, node in self.objects
            ),
        )
        rows = np.array(self.rows, ANATOMY_DTYPE)
        return anatomy(record, rows, plan or plan_of(CHAIN), (START_NS, START_NS + 10**9))


def parts(found: Anatomy, number: int = 0) -> dict[str, int]:
    """The parts of the first message of a path, in microseconds."""
    path = found.paths["out"][number]
    got: Counter[str] = Counter()
    for part in path.parts:
        if not np.isnan(part.seconds[0]):
            got[f"{part.owner} {part.name}"] += round(part.seconds[0] * 1e6)
    assert sum(got.values()) == round(path.seconds[0] * 1e6)
    return got


def end(script: Script, sent: int) -> None:
    script.take("monitor", "/out", sent + 20, sent, "/r2bspec/monitor")


def asks(script: Script, at: int, number: int) -> None:
    """A request that is sent 40 µs later, and answered by another node."""
    client, service = ("client", "/add", "/r2b/ask"), ("service", "/add", "/r2b/answer")
    for process, kind, began, took, of, received in (
        ("ask", AnatomyKind.SEND_REQUEST, at + 40, 4, client, None),
        ("answer", AnatomyKind.TAKE_REQUEST, at + 60, 2, service, at + 50),
        ("answer", AnatomyKind.SEND_RESPONSE, at + 90, 4, service, None),
        ("ask", AnatomyKind.TAKE_RESPONSE, at + 110, 2, client, at + 104),
    ):
        script.add(process, kind, began, began + took, of, source=number, received=received)
    script.callback("answer", at + 65, at + 100)


THROUGH_SERVICE = (
    *("player", "/in", "/r2b/ask", "/add", "/r2b/answer", "/add", "/r2b/ask", "/out"),
)


def test_a_path_leads_through_a_service() -> None:
    script = Script()
    script.publish("player", "/in", 0, "/r2bspec/player")
    script.take("ask", "/in", 20, 0)
    script.callback("ask", 25, 60)
    asks(script, 0, 7)
    script.callback("ask", 115, 150)
    script.publish("ask", "/out", 140)
    end(script, 140)
    found = script.joined()
    (path,) = found.paths["out"]
    assert path.hops == THROUGH_SERVICE
    got = parts(found)
    assert got["/r2b/answer callback"] == 90 - 65
    assert got["/r2b/answer wait"] == 60 - 50
    assert "not seen" not in " ".join(got)


@pytest.mark.parametrize("header", [0, 11])
def test_a_path_leads_through_a_service_whose_response_is_awaited_outside_of_callbacks(
    header: int,
) -> None:
    script = Script()
    for number in range(3):
        at, stamp = 1000 * number, header and header + number
        script.publish("player", "/in", at, "/r2bspec/player", header=stamp)
        script.take("ask", "/in", at + 20, at, header=stamp)
        script.callback("ask", at + 25, at + 60)
        asks(script, at, number)
        script.callback("ask", at + 115, at + 120)
        script.publish("ask", "/out", at + 140, header=stamp)
        end(script, at + 140)
    found = script.joined()
    path = found.paths["out"][0]
    assert path.hops == THROUGH_SERVICE
    assert path.last.tolist() == [True] * 3
    assert path.by_timer.any() == (not header)
    got = parts(found)
    assert got["/r2b/answer callback"] == 90 - 65
    assert got["/r2b/ask held"] == 140 - 120


OF_ACTION = "/plan/_action"


def ends_of_action(role: str) -> dict[str, tuple[tuple[str, str, str], tuple[str, str, str]]]:
    """The client and the service behind each call of an action."""
    return {
        what: (
            ("client", f"{OF_ACTION}/{what}", f"/r2bspec/{role}"),
            ("service", f"{OF_ACTION}/{what}", "/r2b/server"),
        )
        for what in ("send_goal", "get_result")
    }


def calls_action() -> Plan:
    """A plan whose monitors have the result, the acceptance and the feedback of an action."""
    names = ("it", "it_accepted", "it_feedback")
    call = CallPlan(
        name="it", target="/plan", type="x/action/X", request={},
        accepted="it_accepted", feedback="it_feedback",
    )  # fmt: skip
    monitors = (MonitorPlan(name=name, topic="/plan", type="", match="stamp") for name in names)
    return msgspec.structs.replace(plan_of(CHAIN), monitors=tuple(monitors), calls=(call,))


@pytest.mark.parametrize("role", ["player", "caller"])
def test_acceptance_feedback_and_result_of_an_action_have_a_path_each(role: str) -> None:
    script = Script()
    at = 0
    for what, number in (("send_goal", 1), ("get_result", 2)):
        client, service = ends_of_action(role)[what]
        script.add(role, AnatomyKind.SEND_REQUEST, at, at + 4, client, source=number)
        script.add("server", AnatomyKind.TAKE_REQUEST, at + 20, at + 22, service, source=number)
        script.callback("server", at + 25, at + 60)
        if what == "get_result":
            script.publish("server", "/plan/_action/feedback", at + 30, "/r2b/server")
            script.take(role, "/plan/_action/feedback", at + 45, at + 30, f"/r2bspec/{role}")
        script.add("server", AnatomyKind.SEND_RESPONSE, at + 50, at + 54, service, source=number)
        script.add(role, AnatomyKind.TAKE_RESPONSE, at + 70, at + 72, client, source=number)
        at += 100
    plan = calls_action()
    others = (process for process in plan.processes if process.name != role)
    plan = msgspec.structs.replace(plan, processes=(*others, process_plan(role, role)))
    found = script.joined(plan)
    ends = {name: [path.hops[-1] for path in paths] for name, paths in found.paths.items()}
    assert ends == {
        "it": ["/plan/_action/get_result"],
        "it_accepted": ["/plan/_action/send_goal"],
        "it_feedback": ["/plan/_action/feedback"],
    }


def test_rclcpp_says_no_callback_of_an_action_and_the_node_has_it_nevertheless() -> None:
    """Its thread has callbacks of timers, and executes each goal as soon as it has accepted it."""
    script = Script()
    ends = ends_of_action("player")
    (asks, serves), (wants, gives) = ends["send_goal"], ends["get_result"]
    timer = ("timer", "", "/r2b/server")
    script.add("server", AnatomyKind.TIMER, 0, 1, timer)
    script.callback("server", 1, 2, of=timer)
    script.add("server", AnatomyKind.WAIT, 3, 20)
    script.add("player", AnatomyKind.SEND_REQUEST, 10, 14, asks, source=1, header=7)
    script.add("server", AnatomyKind.TAKE_REQUEST, 20, 22, serves, source=1, header=7, received=18)
    script.add("server", AnatomyKind.SEND_RESPONSE, 30, 34, serves, source=1)
    script.add("server", AnatomyKind.WAIT, 8022, 8040)
    script.add("player", AnatomyKind.SEND_REQUEST, 40, 44, wants, source=2, header=7)
    script.add("server", AnatomyKind.TAKE_REQUEST, 8040, 8042, gives, source=2, header=7)
    script.add("server", AnatomyKind.SEND_RESPONSE, 8050, 8054, gives, source=2)
    script.add("server", AnatomyKind.WAIT, 8060, 8070)
    script.add("player", AnatomyKind.TAKE_RESPONSE, 8080, 8082, wants, source=2)
    found = script.joined(calls_action())
    (server,) = found.nodes.values()
    assert server.callback.max() == pytest.approx(0.008)
    assert server.load == pytest.approx(0.008, rel=0.01)
    (path,) = found.paths["it"]
    inside = {part.name: part.seconds[0] for part in path.parts if part.owner == server.name}
    assert inside["callback"] == pytest.approx(0.008, rel=0.01)


def test_a_path_leads_through_a_buffer_within_a_process() -> None:
    script = Script()
    script.publish("player", "/in", 0, "/r2bspec/player")
    script.take("both", "/in", 20, 0, "/r2b/first")
    script.callback("both", 25, 60)
    publisher, buffer = ("publisher", "/t", "/r2b/first"), ("buffer", "/t", "/r2b/second")
    script.add("both", AnatomyKind.PUBLISH, 40, 40, publisher, flags=2)
    script.add("both", AnatomyKind.ENQUEUE, 42, 43, buffer, source=3)
    script.add("both", AnatomyKind.DEQUEUE, 80, 81, buffer, source=3, thread=2)
    script.callback("both", 85, 120, thread=2)
    script.publish("both", "/out", 110, "/r2b/second", thread=2)
    end(script, 110)
    found = script.joined()
    (path,) = found.paths["out"]
    assert path.hops == ("player", "/in", "/r2b/first", "/t", "/r2b/second", "/out")
    got = parts(found)
    assert got["/r2b/second wait"] == 80 - 43
    assert got["/r2b/second callback"] == 110 - 85
    assert "not seen" not in " ".join(got)


@pytest.mark.parametrize("stamped_us", [None, 4, 15, -(10**8)])
def test_in_a_live_graph_a_path_begins_with_its_own_source(stamped_us: int | None) -> None:
    script = Script()
    for number in range(3):
        at = 1000 * number
        # A stamp after the publication, or of another day, is none of this clock.
        stamp = 0 if stamped_us is None else CLOCK_NS + START_NS + (at + stamped_us) * US
        script.add("camera", AnatomyKind.TIMER, at, at + 1, ("timer", "", "/r2b/camera"))
        script.callback("camera", at + 2, at + 20)
        script.publish("camera", "/image", at + 10, header=stamp)
        script.take("blur", "/image", at + 30, at + 10, header=stamp)
        script.callback("blur", at + 35, at + 60)
        script.publish("blur", "/out", at + 50)
        end(script, at + 50)
    live = msgspec.structs.replace(plan_of(CHAIN), playback_mode="live", inputs=())
    (path,) = script.joined(live).paths["out"]
    assert path.hops == ("/r2b/camera", "/image", "blur", "/out")
    assert path.seconds.size == 3
    assert parts(script.joined(live))["/r2b/camera earlier"] == (6 if stamped_us == 4 else 0)
    assert script.joined().paths["out"] == ()


def test_the_input_with_the_same_stamp_is_the_cause_and_not_the_newest() -> None:
    script = Script()
    script.publish("player", "/in", 0, "/r2bspec/player", header=11)
    script.publish("player", "/in", 30, "/r2bspec/player", header=12)
    script.take("blur", "/in", 20, 0, header=11)
    script.callback("blur", 25, 28)
    script.take("blur", "/in", 50, 30, header=12)
    script.callback("blur", 55, 58)
    # A thread of its own publishes the first one, and only then the second one.
    script.publish("blur", "/out", 70, thread=9, header=11)
    script.publish("blur", "/out", 90, thread=9, header=12)
    end(script, 70)
    end(script, 90)
    (path,) = script.joined().paths["out"]
    assert (path.began_ns - START_NS).tolist() == [0, 30 * US]
    assert not path.by_timer.any()
    got = parts(script.joined())
    assert got["blur callback"] == 3
    assert got["blur held"] == 70 - 28
