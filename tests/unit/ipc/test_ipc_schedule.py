"""What is due when: one after the other at a rate, or in the times of a recording."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.ipc.schedule import (
    NO_STEP,
    CyclicSchedule,
    CyclicTransform,
    TimelineMessage,
    TimelineSchedule,
    TimelineStep,
    round_length_ns,
)

TIMELINE = TimelineSchedule(
    # A step of both inputs, whose second message comes after the step that follows; then two more.
    steps=(TimelineStep(1000, 0b11), TimelineStep(1004, 0b10), TimelineStep(1020, 0b01)),
    messages=(
        TimelineMessage(0, NO_STEP, 2, 0),
        TimelineMessage(0, 0, 0, 0),
        TimelineMessage(5, 1, 1, 0),
        TimelineMessage(7, 0, 1, 1),
        TimelineMessage(20, 2, 0, 1),
    ),
    origin_ns=1002,
    period_ns=30,
    stamp_period_ns=60,
    inputs=2,
)


def test_steps_at_a_rate_follow_each_other_round_after_round() -> None:
    schedule = CyclicSchedule(steps=((0, 5), (1, 6), (2, 7)))
    events = list(schedule.events(10.0, 4, first=1))
    assert [each.offset_ns for each in events] == [0, 10**8, 2 * 10**8, 3 * 10**8]
    assert [each.messages for each in events] == [
        ((0, 1), (1, 6)),
        ((0, 2), (1, 7)),
        ((0, 0), (1, 5)),
        ((0, 1), (1, 6)),
    ]
    assert all(each.starts_step and each.ends_step and each.stamp_ns is None for each in events)


@given(rate_hz=st.floats(0.1, 5000.0), steps=st.integers(1, 300))
def test_rounding_does_not_add_up(rate_hz: float, steps: int) -> None:
    *_, last = CyclicSchedule(steps=((0,),)).events(rate_hz, steps)
    assert last.offset_ns == round((steps - 1) * (1e9 / rate_hz))


def test_transforms_lie_between_the_steps_in_every_round() -> None:
    schedule = CyclicSchedule(
        steps=((0,), (1,)),
        transforms=(
            CyclicTransform(0.25, 4, 100),
            CyclicTransform(0.5, 5, 200),
            CyclicTransform(1.5, 6, 300),
        ),
    )
    events = list(schedule.events(10.0, 4))
    assert [(each.step, each.offset_ns // 10**6) for each in events] == [
        (0, 0), (NO_STEP, 25), (NO_STEP, 50), (1, 100), (NO_STEP, 150),
        (2, 200), (NO_STEP, 225), (NO_STEP, 250), (3, 300), (NO_STEP, 350),
    ]  # fmt: skip
    placed = [each for each in events if each.step == NO_STEP][:3]
    assert [each.messages for each in placed] == [((1, 4),), ((1, 5),), ((1, 6),)]
    assert [each.origin_ns for each in placed] == [100, 200, 300]


def test_a_timeline_plays_each_message_at_its_own_time() -> None:
    events = list(TIMELINE.events(0.0, 3))
    assert [(each.offset_ns, each.step, each.messages) for each in events] == [
        (0, NO_STEP, ((2, 0),)),
        (0, 0, ((0, 0),)),
        (5, 1, ((1, 0),)),
        (7, 0, ((1, 1),)),
        (20, 2, ((0, 1),)),
    ]
    assert [(each.starts_step, each.ends_step) for each in events if each.step == 0] == [
        (True, False),
        (False, True),
    ]


def test_the_next_round_of_a_timeline_is_played_and_stamped_on() -> None:
    events = [each for each in TIMELINE.events(0.0, 6) if each.step != NO_STEP]
    first, second = events[:4], events[4:]
    assert [each.offset_ns + 30 for each in first] == [each.offset_ns for each in second]
    assert [each.step + 3 for each in first] == [each.step for each in second]
    assert [each.stamp_ns for each in first] == [-2, 2, -2, 18]
    assert [each.stamp_ns for each in second] == [58, 62, 58, 78]


def test_a_play_ends_with_the_last_message_of_its_last_step() -> None:
    events = list(TIMELINE.events(0.0, 1))
    assert [each.step for each in events] == [NO_STEP, 0, 0]


@given(steps=st.integers(1, 40))
def test_every_step_of_a_play_is_whole(steps: int) -> None:
    events = [each for each in TIMELINE.events(0.0, steps) if each.step != NO_STEP]
    counts = Counter(each.step for each in events)
    assert counts.keys() == set(range(steps))
    assert all(counts[step] == (2 if step % 3 == 0 else 1) for step in counts)
    assert (
        sum(each.starts_step for each in events) == sum(each.ends_step for each in events) == steps
    )
    assert [each.offset_ns for each in events] == sorted(each.offset_ns for each in events)


@given(steps=st.integers(1, 40))
def test_the_span_of_a_timeline_ends_where_the_next_step_is_due(steps: int) -> None:
    *_, last = (
        each for each in TIMELINE.events(0.0, steps + 1) if each.starts_step and each.step >= 0
    )
    assert TIMELINE.span_ns(0.0, steps) == last.offset_ns


@pytest.mark.parametrize(("duration_ns", "steps"), [(1, 1), (5, 1), (6, 2), (30, 3), (31, 4)])
def test_as_many_steps_fit_as_are_due_within_a_time(duration_ns: int, steps: int) -> None:
    assert TIMELINE.steps_within(0.0, duration_ns) == steps


def test_what_is_played_is_what_is_wanted_in_memory() -> None:
    assert TIMELINE.positions_used() == [{0, 1}, {0, 1}, {0}]
    assert CyclicSchedule(steps=((0, 3), (1, 3))).positions_used() == [{0, 1}, {3}, set()]


def test_the_pause_between_rounds_is_the_mean_one() -> None:
    assert round_length_ns([0, 10, 20, 30]) == 40
    assert round_length_ns([5]) == 10**9
