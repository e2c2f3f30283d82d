"""What is due when: one after the other at a rate, or in the times of a recording."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from r2bspec.ipc.schedule import NO_STEP, TimelineMessage, TimelineSchedule, TimelineStep
from schedule_events import played_events

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


@given(steps=st.integers(1, 40))
@settings(deadline=None)
def test_the_span_of_a_timeline_ends_where_the_next_step_is_due(steps: int) -> None:
    begun: dict[int, int] = {}
    for played_event in played_events(TIMELINE, 0.0, steps + 1):
        begun.setdefault(played_event.step, played_event.offset_ns)
    assert TIMELINE.span_ns(0.0, steps) == begun[steps]
