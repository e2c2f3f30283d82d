"""From buffers to what is played when: messages of a stamp are a step, the rest lies between."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.execute.build_schedule import (
    align,
    build_call_timeline,
    make_timeline,
    place_between,
    place_transforms,
)
from r2bspec.execute.errors import RunError
from r2bspec.ipc.buffers import BufferIndex, write_index
from r2bspec.ipc.schedule import NO_STEP, TimelineSchedule
from r2bspec.judge.measure.matching import input_mask
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import CallPlan, InputPlan, TimelinePlan

PLAN = TimelinePlan(speed=1.0, recorded=False, shift_tf=True)
T = 1_000_000
"""When the recording begins."""


def index(*times: int, stamps: tuple[int, ...] | None = None, header: bool = True) -> BufferIndex:
    """Messages recorded at times after the beginning; stamped then, unless it is said when."""
    times_ns = tuple(T + time_ for time_ in times)
    stamps_ns = times_ns if stamps is None else tuple(T + stamp for stamp in stamps)
    return buffered("/topic", stamps_ns, times_ns, header=header)


def buffered(
    topic: str, stamps_ns: tuple[int, ...], times_ns: tuple[int, ...], *, header: bool = True
) -> BufferIndex:
    return BufferIndex(
        topic=topic,
        type="sensor_msgs/msg/Image",
        has_header=header,
        stamps_ns=stamps_ns,
        sizes=(9,) * len(times_ns),
        times_ns=times_ns,
    )


def played(name: str = "in", **changes: Any) -> InputPlan:
    fields = {"bag_topic": "/bag"} | changes
    return InputPlan(topic=f"/{name}", type="x/msg/Y", source=f"/{name}_raw", qos=QoS(), **fields)


def made(
    *inputs: tuple[InputPlan, BufferIndex], plan: TimelinePlan = PLAN, **more: Any
) -> TimelineSchedule:
    return make_timeline(inputs, more.pop("sources", ()), plan, **more)[0]


def due(timeline: TimelineSchedule) -> list[tuple[int, int, int, int]]:
    return [(m.offset_ns, m.step, m.input, m.position) for m in timeline.messages]


def test_messages_of_one_stamp_are_one_step_each_at_its_own_time() -> None:
    camera = played("camera"), index(10, 110, stamps=(0, 100))
    info = played("info"), index(13, 112, stamps=(0, 100))
    imu = played("imu"), index(12, 60)
    timeline = made(camera, info, imu)
    assert due(timeline) == [
        (0, 0, 0, 0),
        (2, 1, 2, 0),
        (3, 0, 1, 0),
        (50, 2, 2, 1),
        (100, 3, 0, 1),
        (102, 3, 1, 1),
    ]
    assert [step.inputs for step in timeline.steps] == [0b011, 0b100, 0b100, 0b011]


def test_no_message_is_stamped_later_than_it_is_played() -> None:
    old, fresh = index(40, 140, stamps=(0, 100)), index(50, 150, stamps=(48, 148))
    timeline = made((played("old"), old), (played("fresh"), fresh))
    offsets = timeline.due_offsets_ns()
    ages = [
        offset - (step.stamp_ns - timeline.origin_ns)
        for offset, step in zip(offsets, timeline.steps, strict=True)
    ]
    assert min(ages) == 0
    # How old one message is compared with another stays what it was.
    assert ages == [38, 0, 38, 0]


def test_an_input_that_is_translated_is_played_and_stamped_later() -> None:
    pair = index(0, 100)
    timeline = made((played("a"), pair), (played("b", later_ns=20), pair))
    assert due(timeline) == [(0, 0, 0, 0), (20, 1, 1, 0), (100, 2, 0, 1), (120, 3, 1, 1)]
    assert [step.stamp_ns - T for step in timeline.steps] == [0, 20, 100, 120]


@pytest.mark.parametrize(("speed", "offset_ns"), [(0.5, 200), (2.0, 50)])
def test_speed_changes_the_times_of_play_and_no_stamp(speed: float, offset_ns: int) -> None:
    plan = TimelinePlan(speed=speed, recorded=False, shift_tf=True)
    timeline = made((played(), index(0, 100)), plan=plan)
    assert timeline.messages[1].offset_ns == offset_ns
    assert timeline.steps[1].stamp_ns - timeline.steps[0].stamp_ns == 100
    assert timeline.period_ns == round(timeline.stamp_period_ns / speed)


@given(st.lists(st.integers(0, 50), min_size=1, max_size=40), st.booleans())
def test_every_message_is_played_once_and_every_stamp_is_unique(
    stamps: list[int], header: bool
) -> None:
    times = tuple(range(0, 10 * len(stamps), 10))
    buffered = index(*times, stamps=tuple(stamps), header=header)
    timeline = made((played("a"), buffered), (played("b"), buffered))
    assert sorted((m.input, m.position) for m in timeline.messages) == [
        (column, position) for column in (0, 1) for position in range(len(stamps))
    ]
    found = [step.stamp_ns for step in timeline.steps]
    assert len(set(found)) == len(found)
    assert timeline.stamp_period_ns > max(found) - min(found)
    assert timeline.period_ns > timeline.messages[-1].offset_ns


def test_what_a_preprocessor_made_is_played_when_the_last_of_its_stamp_was_recorded() -> None:
    left, right = index(0, 100), index(5, 108, stamps=(0, 100))
    out = index(900, 901, 902, stamps=(0, 100, 555))
    pair = played("out", bag_topic=""), out
    timeline, unknown = make_timeline([pair], [left, right], PLAN)
    assert due(timeline) == [(0, 0, 0, 0), (103, 1, 0, 1)]
    assert unknown == {"/topic": 1}


def test_a_recorded_timeline_is_that_of_what_came_out() -> None:
    plan = TimelinePlan(speed=1.0, recorded=True, shift_tf=True)
    out = index(900, 907, stamps=(0, 100))
    timeline = made((played("out", bag_topic=""), out), plan=plan)
    assert [message.offset_ns for message in timeline.messages] == [0, 7]
    assert [step.stamp_ns - T for step in timeline.steps] == [0, 100]


def test_an_input_without_messages_is_refused() -> None:
    with pytest.raises(RunError, match="no messages were buffered for /in_raw"):
        make_timeline([(played(), index())], [], PLAN)


def test_transforms_belong_to_no_step_and_old_ones_come_at_the_beginning() -> None:
    second = 10**9
    transforms = index(-2 * second, -5, 40, 100 * second, header=False)
    timeline = made((played(), index(0, 100)), transforms=transforms)
    assert due(timeline) == [
        (0, NO_STEP, 1, 1),
        (0, 0, 0, 0),
        (40, NO_STEP, 1, 2),
        (100, 1, 0, 1),
    ]


def test_while_looping_transforms_lie_where_they_lay_between_the_steps() -> None:
    images = index(10, 110, 210, stamps=(0, 100, 200))
    transforms = index(0, 35, 110, 310, 311, header=False)
    placed = place_transforms(1, transforms, [(0,), (1,), (2,)], [images])
    assert [(each.at, each.position) for each in placed] == [(0.25, 1), (1.0, 2)]
    # Each step is stamped 10 ns before it was recorded, and so are the transforms around it.
    assert [each.origin_ns - T for each in placed] == [25, 100]


def test_while_sweeping_transforms_come_back_in_reverse() -> None:
    images = index(0, 100, 200)
    transforms = index(25, 125, header=False)
    placed = place_transforms(1, transforms, [(0,), (1,), (2,), (1,)], [images])
    assert [(each.at, each.position) for each in placed] == [
        (0.25, 0),
        (1.25, 1),
        (2.75, 1),
        (3.75, 0),
    ]


def recorded(topic: str, *stamps_ns: int, header: bool = True) -> BufferIndex:
    return buffered(topic, stamps_ns, stamps_ns, header=header)


def test_a_message_that_is_missing_on_one_side_shifts_no_later_pair() -> None:
    left = recorded("/left", 10, 20, 30, 40)
    right = recorded("/right", 10, 30, 40)
    aligned = align([left, right], 0)
    assert aligned.steps == ((0, 0), (2, 1), (3, 2))
    assert aligned.unpaired == {"/left": 1}


def test_an_input_without_a_header_goes_by_order_and_starts_again_when_it_is_shorter() -> None:
    image = recorded("/image", 10, 20, 30, 40, 50)
    text = recorded("/text", 1, 2, header=False)
    assert align([image, text], 0).steps == ((0, 0), (1, 1), (2, 0), (3, 1), (4, 0))
    assert align([text, image], 0).unpaired == {}


def test_an_input_that_got_no_message_is_named() -> None:
    with pytest.raises(RunError, match="no messages were buffered for /right") as raised:
        align([recorded("/left", 10), recorded("/right")], 0)
    assert raised.value.code == "R2B643"
    assert raised.value.exit_code == 4


def test_inputs_with_no_stamp_in_common_are_refused_with_their_counts() -> None:
    with pytest.raises(RunError, match="/left: 2, /right: 1") as raised:
        align([recorded("/left", 10, 20), recorded("/right", 11)], 0)
    assert (raised.value.code, raised.value.exit_code) == ("R2B644", 2)
    assert "stamps" in raised.value.hint


STAMPS = st.lists(st.integers(0, 30), min_size=1, max_size=40)


@given(inputs=st.lists(STAMPS, min_size=1, max_size=4), limit=st.integers(0, 10))
def test_all_inputs_of_a_step_have_one_stamp_and_the_rest_is_counted(
    inputs: list[list[int]], limit: int
) -> None:
    indices = [recorded(f"/topic{n}", *stamps) for n, stamps in enumerate(inputs)]
    common = Counter(inputs[0])
    for stamps_of in inputs[1:]:
        common &= Counter(stamps_of)
    if not common:
        with pytest.raises(RunError):
            align(indices, limit)
        return
    aligned = align(indices, limit)
    stamps = [
        {indices[column].stamps_ns[position] for column, position in enumerate(step)}
        for step in aligned.steps
    ]
    assert all(len(stamp) == 1 for stamp in stamps)
    played = [stamp.pop() for stamp in stamps]
    # Whatever the order of arrival; what the limit cuts off has a partner all the same.
    assert played == sorted(common.elements())[: limit or None]
    lost = {each.topic: len(each.stamps_ns) - common.total() for each in indices}
    assert aligned.unpaired == {topic: count for topic, count in lost.items() if count}


def stamped(topic: str, *stamps_ns: int) -> BufferIndex:
    return buffered(topic, stamps_ns, tuple(stamp + 7 for stamp in stamps_ns))


CAMERA = stamped("/camera", 0, 100, 200)
STEPS = ((0,), (1,), (2,))


def test_each_message_is_played_where_it_was_stamped() -> None:
    imu = stamped("/imu", 25, 75, 100, 150, 250, 350)
    placed = place_between(1, imu, STEPS, [CAMERA])
    # 350 is later than a mean period after the last step.
    assert [(each.at, each.position) for each in placed] == [
        (0.25, 0),
        (0.75, 1),
        (1.0, 2),
        (1.5, 3),
        (2.5, 4),
    ]


def test_an_input_on_another_clock_is_refused() -> None:
    with pytest.raises(RunError, match="no message of /imu was recorded between the steps"):
        place_between(1, stamped("/imu", 5000, 6000), STEPS, [CAMERA])


def test_each_recorded_request_is_a_step_of_its_call(tmp_path: Path) -> None:
    calls = [
        CallPlan(name=name, target=f"/{name}", type="x/srv/Y", request={}, source=source)
        for name, source in (("add", "/a"), ("tick", msgspec.UNSET), ("plan", "/p"))
    ]
    for source, times in (("/a", (0, 100)), ("/p", (40,))):
        found = msgspec.structs.replace(index(*times, header=False), topic=source)
        write_index(tmp_path, found)
    schedule = build_call_timeline(calls, PLAN, tmp_path)
    assert [step.inputs for step in schedule.steps] == [0b01, 0b10, 0b01]
    period = schedule.period_ns
    assert [(m.offset_ns, m.input, m.position) for m in map(schedule.message_of, range(4))] == [
        (0, 0, 0),
        (40, 1, 0),
        (100, 0, 1),
        (period, 0, 0),
    ]
    # The answers to one call are expected of its steps, those to what has no recording of all.
    for answers, expected in ((("plan",), 0b10), (("add",), 0b01), ((), 0)):
        assert input_mask([call for call in calls if call.source], answers) == expected
