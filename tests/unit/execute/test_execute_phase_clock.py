"""Where the time of a run went: phases without gaps, waits that are counted once."""

from __future__ import annotations

import itertools
import time

from r2bspec.execute.states import PhaseClock
from r2bspec.record.run_record import PhaseTime, WaitTime
from r2bspec.report.terminal_tables import took_ns, waits_text

MS = 1_000_000


def spin(milliseconds: float) -> None:
    """Use the processor for a time."""
    end = time.process_time() + milliseconds / 1000
    while time.process_time() < end:
        pass


def test_phases_follow_each_other_without_gaps() -> None:
    clock = PhaseClock()
    clock.begin("load")
    clock.begin("start")
    phases = clock.phases()
    assert [each.name for each in phases] == ["prepare", "load", "start"]
    for before, after in itertools.pairwise(phases):
        assert before.began_ns <= before.ended_ns <= after.began_ns
        # What lies in between is two instructions, not a part of the run.
        assert after.began_ns - before.ended_ns <= took_ns(phases)


def test_a_wait_has_no_part_in_a_phase_that_begins_meanwhile() -> None:
    clock = PhaseClock()
    with clock.waiting("relay: ready"):
        clock.begin("load")
    prepare, load = clock.phases()
    assert load.waits == ()
    assert prepare.name == "prepare"
    with clock.waiting("bag: read"):
        pass
    (wait,) = clock.phases()[1].waits
    assert (wait.what, wait.count) == ("bag: read", 1)


def test_a_wait_inside_another_is_not_counted_twice() -> None:
    clock = PhaseClock()
    with clock.waiting("endpoints: matched"):
        for _ in range(3):
            with clock.waiting("monitor: matched"):
                spin(1)
    with clock.waiting("endpoints: matched"):
        pass
    (phase,) = clock.phases()
    (wait,) = phase.waits
    assert (wait.what, wait.count) == ("endpoints: matched", 2)
    assert 3 * MS <= wait.took_ns <= phase.took_ns


def test_the_longest_wait_is_first_and_the_processor_time_is_that_of_the_phase() -> None:
    clock = PhaseClock()
    with clock.waiting("short"):
        spin(1)
    with clock.waiting("long"):
        spin(20)
    clock.begin("load")
    prepare, load = clock.phases()
    assert [each.what for each in prepare.waits] == ["long", "short"]
    assert prepare.cpu_ns >= 21 * MS > load.cpu_ns


def test_a_wait_that_fails_is_counted_too() -> None:
    clock = PhaseClock()
    try:
        with clock.waiting("relay: ready"):
            raise TimeoutError
    except TimeoutError:
        pass
    (phase,) = clock.phases()
    assert [each.what for each in phase.waits] == ["relay: ready"]


def test_waits_of_several_starts_are_shown_together() -> None:
    def phase(ready_ms: int, matched_ms: int) -> PhaseTime:
        return PhaseTime(
            name="graph",
            began_ns=0,
            ended_ns=1000 * MS,
            cpu_ns=0,
            waits=(
                WaitTime(what="relay: ready", count=1, took_ns=ready_ms * MS),
                WaitTime(what="endpoints: matched", count=1, took_ns=matched_ms * MS),
            ),
        )

    shown = waits_text([phase(100, 300), phase(150, 300)])
    assert shown == "endpoints: matched 600 ms, relay: ready 250 ms"
