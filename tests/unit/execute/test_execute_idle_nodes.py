"""When a start is not waited for any longer: its nodes are idle, answer, and nothing changes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest

from r2bspec.execute.bringup.graph_matching import EarlyDiagnosis
from r2bspec.execute.bringup.observe_graph import GraphFacts
from r2bspec.execute.bringup.readiness import IdleNodes, all_answer, patience_s
from r2bspec.ipc.protocol import ParameterLists
from r2bspec.language.quantities import Duration
from r2bspec.plan.plan import NodePlan, ProcessPlan
from run_simulation import Simulation


def node(name: str) -> NodePlan:
    return NodePlan(
        name=f"/r2b/{name}", node=name, namespace="/r2b", target="", parameters={}, remappings={}
    )


def process(role: Any, *names: str, argv: tuple[str, ...] = ()) -> ProcessPlan:
    return ProcessPlan(
        name=names[0],
        role=role,
        phase="measure",
        argv=argv,
        env={},
        nodes=tuple(map(node, names)),
    )


def answers(*names: str, lifecycle: tuple[str, ...] = ()) -> ParameterLists:
    return ParameterLists(parameters=dict.fromkeys(names, ()), lifecycle=lifecycle)


def test_every_node_has_to_answer() -> None:
    hosts = [process("host", "a", "b")]
    assert all_answer(hosts, answers("/r2b/a", "/r2b/b"))
    assert not all_answer(hosts, answers("/r2b/a"))
    assert not all_answer(hosts, answers("/r2b/a", "/r2b/c"))


def test_a_lifecycle_node_may_wait_for_its_configuration() -> None:
    found = answers("/r2b/a", lifecycle=("/r2b/a",))
    assert not all_answer([process("command", "a", argv=("p", "__node:=a"))], found)


def test_a_program_has_nodes_of_any_name() -> None:
    programs = [process("command", "a", argv=("p", "__node:=a")), process("command", "b")]
    assert all_answer(programs, answers("/r2b/a", "/its_own"))
    assert not all_answer(programs, answers("/r2b/a"))
    # That of a container is none of them.
    container = process("container", "c", argv=("x", "__node:=box", "__ns:=/r2b"))
    assert not all_answer([*programs, container], answers("/r2b/a", "/r2b/c", "/r2b/box"))
    assert all_answer([*programs, container], answers("/r2b/a", "/r2b/c", "/r2b/box", "/own"))


def diagnosis(now: list[float], **ways: Any) -> EarlyDiagnosis:
    facts = GraphFacts(topics={}, inputs=())
    plan = msgspec.structs.replace(Simulation().plan(), start_timeout=Duration(30 * 10**9))
    return EarlyDiagnosis(plan, (), lambda: facts, clock=lambda: now[0], **ways)


def stalls_at(watch: EarlyDiagnosis, now: list[float]) -> float:
    while now[0] < 40 and not watch.stalled_s:
        now[0] += 0.5
        assert watch.certain(["/r2b/image"]) == frozenset()
    return now[0]


def test_a_third_of_the_timeout_without_a_change_is_enough_for_idle_nodes() -> None:
    now = [0.0]
    watch = diagnosis(now, idle_s=lambda: now[0], answer=lambda: True)
    assert stalls_at(watch, now) == 11.0
    assert watch.stalled_s == 10.0


@pytest.mark.parametrize(
    "ways",
    [
        {"idle_s": lambda: 100.0, "answer": lambda: False},
        {"idle_s": lambda: 9.9, "answer": lambda: True},
        {},
    ],
    ids=["a node does not answer", "a node was busy just now", "nodes that cannot be observed"],
)
def test_any_sign_of_progress_is_waited_for(ways: dict[str, Any]) -> None:
    now = [0.0]
    assert stalls_at(diagnosis(now, **ways), now) == 40


def test_a_short_timeout_does_not_make_a_start_impatient() -> None:
    assert patience_s(3.0) == 5.0
    assert patience_s(300.0) == 100.0


@pytest.fixture
def working() -> Iterator[subprocess.Popen[str]]:
    """A process that computes for a fifth of a second with every line that it is given."""
    code = """
import sys, time
for _ in sys.stdin:
    began = time.process_time()
    while time.process_time() - began < 0.2:
        pass
    print("done", flush=True)
"""
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as started:
        yield started
        started.kill()


def test_a_process_is_busy_while_it_computes(working: subprocess.Popen[str]) -> None:
    now = 0.0
    plan = msgspec.structs.replace(Simulation().plan(), processes=(process("host", "a"),))
    supervisor = cast("Any", [SimpleNamespace(name="a", pid=working.pid)])

    def work() -> None:
        assert working.stdin is not None
        assert working.stdout is not None
        working.stdin.write("\n")
        working.stdin.flush()
        assert working.stdout.readline() == "done\n"

    work()  # its start, too, takes processor time
    idle = IdleNodes(plan, "measure", supervisor, clock=lambda: now)
    now = 1.0
    assert idle.update() == 1.0
    work()
    now = 2.0
    assert idle.update() == 0.0
    now = 3.0
    assert idle.update() == 1.0
