"""What is done at the same time in a start, and that nothing of it reaches what is measured."""

from __future__ import annotations

import itertools

import pytest

pytest.importorskip("rclpy")

from ros_runs import IMAGE, Bench, Finished, relay_node, relay_spec
from ros_runs import nothing_left as nothing_left

# Not kept for late joiners, so that the overhead is measured.
MEASURED = {"buffer": 5, "inputs": {"input": {"from": "loaded", "format": IMAGE}}}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    bench = Bench(tmp_path_factory.mktemp("early"))
    used = relay_spec(playback=MEASURED, graph={"nodes": {"relay": relay_node()}})
    used["benchmark"] |= {"starts": 2, "iterations": 4, "duration": "250 ms"}
    finished = bench.run(used, "--timings")
    finished.assert_complete()
    return finished


def phase(done: Finished, name: str, number: int = 0) -> tuple[int, int]:
    """When a phase of a name began and ended."""
    found = [each for each in done.run().record.phases if each.name == name]
    return found[number].began_ns, found[number].ended_ns


def test_processes_import_ros_before_the_player_is_started(done: Finished) -> None:
    names = [each.name for each in done.run().record.processes]
    assert names[:4] == ["relay", "harness.observer", "player", "monitor"]
    # Once for each start, and no more.
    assert sorted(names) == sorted(2 * ["relay", "harness.observer", "player", "monitor"])


def test_they_are_idle_while_the_overhead_is_measured(done: Finished) -> None:
    record, rows = done.run().record, done.run().resources()
    began_ns, ended_ns = phase(done, "harness_overhead")
    for name in ("relay", "harness.observer"):
        index = [each.name for each in record.processes].index(name)
        used = rows[rows["process"] == index]
        meanwhile = used[(used["time_ns"] > began_ns) & (used["time_ns"] <= ended_ns)]["cpu_s"]
        assert meanwhile.size, name
        # Almost all of its processor time until then was that of its imports.
        assert meanwhile[-1] - meanwhile[0] <= 0.1 * meanwhile[-1], name


def test_the_controller_waits_for_them_before_that(done: Finished) -> None:
    waits = {each.name: each.waits for each in reversed(done.run().record.phases)}
    assert {"relay: prepared", "harness.observer: prepared"} <= {
        each.what for each in waits["start"]
    }


def test_the_phases_of_the_record_are_those_of_its_events(done: Finished) -> None:
    record = done.run().record
    named = [text for _, text in record.events if text.startswith("phase ")]
    assert [f"phase {each.name}" for each in record.phases] == ["phase prepare", *named]
    for before, after in itertools.pairwise(record.phases):
        assert before.ended_ns <= after.began_ns
    # Segments lie in the phases that play them.
    for segment in record.segments:
        name = "warm_up" if segment.kind == "warm_up" else "play"
        began_ns, ended_ns = phase(done, name, segment.start - 1)
        assert began_ns <= segment.began_ns <= ended_ns


def test_the_table_says_where_the_time_went(done: Finished) -> None:
    lines = done.stderr[done.stderr.index("time  of each phase") :].splitlines()
    shown = [line.split()[0] for line in lines[2:]]
    phases = dict.fromkeys(each.name for each in done.run().record.phases)
    assert [each for each in shown if each in phases] == [*phases]
    assert {"command", "report", "beyond"} <= {*shown}


def test_processes_of_preprocessors_import_while_the_recording_is_read(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    bench = Bench(tmp_path_factory.mktemp("prepared"))
    done = bench.run(
        relay_spec(
            preprocessors={"copy": relay_node(remappings={"input": "loaded", "output": "kept"})},
            playback={"buffer": 5, "inputs": {"input": {"from": "kept", "format": IMAGE}}},
        )
    )
    done.assert_complete()
    names = [each.name for each in done.run().record.processes]
    assert sorted(names[:2]) == ["loader", "preprocess.copy"]
    assert names[2:] == ["relay", "harness.observer", "player", "monitor"]
