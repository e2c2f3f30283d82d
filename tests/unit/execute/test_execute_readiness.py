"""What a start waits for: logs, one deadline, and nodes that are busy or do not answer."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest

from plans import process_plan
from r2bspec.execute.bringup.readiness import IdleNodes, LogSearch, StartDeadline, all_answer
from r2bspec.execute.diagnose.diagnosis import EarlyDiagnosis
from r2bspec.execute.diagnose.facts import GraphFacts
from r2bspec.ipc.protocol import ParameterLists
from r2bspec.safe_io.line_pattern import PatternError, compile_line_pattern
from run_simulation import Simulation


def search(log: Path, pattern: str) -> LogSearch:
    return LogSearch(log, compile_line_pattern(pattern))


@pytest.mark.parametrize(
    "pattern", ["(a+)+$", "^(a|a)*$", "(a|aa)+$", "(.*a){20}$", "^a*a*a*a*a*a*$"]
)
def test_a_pattern_that_could_match_in_many_ways_takes_no_longer(
    pattern: str, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    costs = []
    for length in (20_000, 40_000):
        log.write_text("a" * length + "b")
        started = time.process_time()
        assert not search(log, pattern).finds()
        costs.append(time.process_time() - started)
    # With a matcher that tries combinations not even the first would end.
    assert costs[1] <= 4 * costs[0] + 0.1


def test_a_line_is_found_as_soon_as_it_is_written_in_whole_or_in_part(tmp_path: Path) -> None:
    log = tmp_path / "log"
    probe = search(log, "model (un)?loaded")
    assert not probe.finds()
    log.write_text("starting\nmodel lo")
    assert not probe.finds()
    with log.open("a") as stream:
        stream.write("aded")
    assert probe.finds()


def test_a_long_log_is_read_in_parts(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text(("x" * 99 + "\n") * 20_000 + "ready\n")
    probe = search(log, "ready")
    assert not probe.finds()
    assert probe.finds()


@pytest.mark.parametrize("pattern", ["started (", "(?=a)", r"(a)\1", "(a{1000}){1000}", "[b-a]"])
def test_what_is_no_pattern_is_named_with_its_wrong_part(pattern: str) -> None:
    with pytest.raises(PatternError) as caught:
        compile_line_pattern(pattern)
    offset, length = caught.value.part
    assert 0 <= offset < len(pattern)
    assert 0 < length <= len(pattern) - offset
    assert str(caught.value)


def test_what_an_earlier_process_wrote_is_not_read(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text("model loaded\n")
    pattern = compile_line_pattern("model loaded")
    probe = LogSearch(log, pattern, log.stat().st_size)
    assert not probe.finds()
    with log.open("a") as more:
        more.write("model loaded\n")
    assert probe.finds()


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_every_step_of_a_start_has_what_the_earlier_ones_left() -> None:
    clock = Clock()
    deadline = StartDeadline(30 * 10**9, clock)
    assert deadline.left_s == 30.0
    clock.now_s += 20
    assert deadline.left_s == 10.0
    clock.now_s += 9
    assert (deadline.left_s, deadline.over) == (1.0, False)
    clock.now_s += 2
    assert (deadline.left_s, deadline.over) == (0.0, True)
    assert deadline.timeout_s == 30.0


def answers(*names: str, lifecycle: tuple[str, ...] = ()) -> ParameterLists:
    return ParameterLists(parameters=dict.fromkeys(names, ()), lifecycle=lifecycle)


def test_every_node_has_to_answer() -> None:
    hosts = [process_plan("a", "host", "a", "b")]
    assert all_answer(hosts, answers("/r2b/a", "/r2b/b"))
    assert not all_answer(hosts, answers("/r2b/a"))
    assert not all_answer(hosts, answers("/r2b/a", "/r2b/c"))


def diagnosis(now: list[float], **ways: Any) -> EarlyDiagnosis:
    facts = GraphFacts(topics={}, inputs=())
    return EarlyDiagnosis(10.0, lambda: facts, clock=lambda: now[0], **ways)


def stalls_at(watch: EarlyDiagnosis, now: list[float]) -> float:
    while now[0] < 40 and not watch.stalled_s:
        now[0] += 0.5
        watch.is_hopeless(["/r2b/image"])
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
    plan = msgspec.structs.replace(Simulation().plan(), processes=(process_plan("a", "host", "a"),))
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
