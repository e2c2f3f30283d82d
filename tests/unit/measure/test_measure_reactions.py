"""Reaction times: which steps are events, and which outputs react to them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from r2bspec.bags.message_types import typestore
from r2bspec.check.input_events import most_within
from r2bspec.execute.measurement.reaction_marks import ReactionMarks, lengths
from r2bspec.ipc.buffers import BufferWriter
from r2bspec.ipc.sample_files import HeadReader, heads_path, message_size
from r2bspec.ipc.schedule import CyclicSchedule, TimelineMessage, TimelineSchedule, TimelineStep
from r2bspec.judge.measure.matching import NO_MATCH, MatchedMonitor, match_monitor
from r2bspec.judge.measure.metric_catalogue import resolve
from r2bspec.judge.measure.metric_values import metric_value
from r2bspec.judge.measure.reactions import (
    EVENT,
    MET,
    UNFINISHED,
    UNREADABLE,
    begin_events,
    marks_of,
    match_live_reactions,
    match_reactions,
)
from r2bspec.judge.measure.run_samples import SegmentRows, segment_samples
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import InputPlan, MonitorPlan, ReactionPlan
from r2bspec.record.run_record import Segment
from r2bspec.record.sample_arrays import MONITOR_DTYPE, PLAYBACK_DTYPE, Rows
from run_simulation import Simulation

MS = 1_000_000
PERIOD_NS = 10 * MS
FLOAT = "std_msgs/msg/Float64"

INPUT = InputPlan(topic="/in", type=FLOAT, source="/loaded", bag_topic="", qos=QoS())
MONITOR = MonitorPlan(
    name="out",
    topic="/out",
    type=FLOAT,
    reaction=ReactionPlan(when="data > 0.5", since="data > 0", input="/in", input_type=FLOAT),
)


def played(steps: int) -> Rows:
    rows = np.zeros(steps, PLAYBACK_DTYPE)
    rows["stamp_ns"] = 1000 + np.arange(steps)
    rows["due_ns"] = rows["published_ns"] = rows["done_ns"] = np.arange(steps) * PERIOD_NS
    rows["inputs"] = -1
    return rows


def received(*outputs: tuple[int, float]) -> Rows:
    """Outputs, each with the step whose stamp it has and the time of its reception in ms."""
    rows = np.zeros(len(outputs), MONITOR_DTYPE)
    for row, (step, at_ms) in zip(rows, outputs, strict=True):
        row["stamp_ns"] = 1000 + step
        row["received_ns"] = row["taken_ns"] = at_ms * MS
    return rows


def marks(events: list[int], met: list[int]) -> Rows:
    return np.concatenate(
        [marks_of(EVENT, np.array(events, int)), marks_of(MET, np.array(met, int))]
    )


def reacted(matched: MatchedMonitor) -> dict[int, float | None]:
    """For each event its reaction time in ms; None without one."""
    matching = matched.matching
    return {
        int(event): None
        if row == NO_MATCH
        else (int(matched.rows["received_ns"][row]) - int(event) * PERIOD_NS) / MS
        for event, row in zip(matching.trigger_steps, matching.first_row, strict=True)
    }


def reactions(
    steps: int, rows: Rows, events: list[int], met: list[int], monitor: MonitorPlan = MONITOR
) -> dict[int, float | None]:
    playback = played(steps)
    matched = match_monitor(playback, rows, monitor, [INPUT])
    return reacted(match_reactions(playback, matched, marks(events, met)))


@pytest.mark.parametrize(
    ("outputs", "events", "met", "expected"),
    [
        # The first output that meets the condition, and not that of the earliest step.
        ([(2, 22), (3, 32), (4, 42), (5, 52)], [2], [2, 3], {2: 22.0}),
        ([(4, 45), (3, 47)], [3], [0, 1], {3: 15.0}),
        # One of a step before the event is no reaction, however late.
        ([(1, 35), (3, 38)], [2], [0], {2: None}),
        ([(1, 35), (3, 38)], [2], [0, 1], {2: 18.0}),
        # An event is over when the next one begins; each step may be one.
        ([(1, 12), (6, 62)], [1, 5], [1], {1: None, 5: 12.0}),
        ([(1, 12), (6, 62)], [1, 5], [0, 1], {1: 2.0, 5: 12.0}),
        ([(0, 1), (1, 11), (2, 21)], [0, 1, 2], [1], {0: None, 1: 1.0, 2: None}),
        # Damaged marks are passed over.
        ([(2, 22)], [-1, 2, 70], [-3, 0, 9], {2: 2.0}),
    ],
)
def test_the_reaction_to_an_event(
    outputs: list[tuple[int, float]],
    events: list[int],
    met: list[int],
    expected: dict[int, float | None],
) -> None:
    assert reactions(10, received(*outputs), events, met) == expected


def test_outputs_at_a_pace_of_their_own_belong_to_the_last_step_before_them() -> None:
    monitor = msgspec.structs.replace(MONITOR, match="own_pace")
    rows = received((-500, 5), (-500, 25), (-500, 45))
    assert reactions(10, rows, [1, 4], [0, 1, 2], monitor) == {1: 15.0, 4: 5.0}


@pytest.mark.parametrize("period_ms", [2, 7, 20])
@pytest.mark.parametrize("held_ms", [20, 50, 80])
@pytest.mark.parametrize("delay_ms", [5, 30, 70, 110, 150, 230, 305])
def test_a_reaction_after_the_next_event_is_never_taken_for_a_fast_one(
    delay_ms: int, held_ms: int, period_ms: int
) -> None:
    """A timer publishes whether there was an event `delay_ms` ago; events come every 100 ms."""
    ticks = np.arange(1, 1000, period_ms)
    meets = (ticks >= delay_ms) & ((ticks - delay_ms) % 100 < held_ms)
    rows = received(*((-500, int(tick)) for tick in ticks))
    monitor = msgspec.structs.replace(MONITOR, match="own_pace")
    events = [*range(0, 100, 10)]
    found = reactions(100, rows, events, np.flatnonzero(meets).tolist(), monitor)
    reacted_ms = [at for at in found.values() if at is not None]
    assert all(at >= delay_ms for at in reacted_ms)
    if delay_ms + period_ms < 100 - held_ms:
        assert len(reacted_ms) == len(events)


def test_an_output_that_meets_the_condition_before_an_event_is_no_reaction_to_it() -> None:
    monitor = msgspec.structs.replace(MONITOR, match="own_pace")
    rows = received(*((-500, at) for at in range(3, 100, 2)))
    assert reactions(10, rows, [2, 6], [*range(len(rows))], monitor) == {}
    # It meets it from 21 ms on, and does not for a while.
    met = [place for place in range(len(rows)) if place not in {*range(9), *range(24, 28)}]
    assert reactions(10, rows, [2, 6], met, monitor) == {2: 1.0}


def test_metrics_count_events_and_what_is_missed() -> None:
    segment = Segment(
        id="a", kind="iteration", index=1, rate_hz=100.0, steps=10, began_ns=0,
        ended_ns=10 * PERIOD_NS, complete=True,
    )  # fmt: skip
    found = marks([1, 5], [1])
    rows = SegmentRows(played(10), {"out": received((1, 12), (3, 32))}, {}, marks={"out": found})
    samples = segment_samples(PLAN, segment, rows)

    def value(name: str) -> float | None:
        monitor_name, info = resolve(name, ["out"])
        return metric_value(info, monitor_name, samples)

    assert value("reaction.min") == pytest.approx(0.022)
    assert value("reaction.max") == np.inf
    assert value("missed") == 1
    assert value("drop_rate") == 0.5
    assert value("sent") == 10
    unread = np.concatenate([found, marks_of(UNREADABLE, np.array([0]))])
    again = segment_samples(PLAN, segment, replace(rows, marks={"out": unread}))
    assert again.monitors["out"].unreadable == 1


def test_lengths_go_on_in_the_next_round() -> None:
    held = np.array([True, False, True, True])
    assert lengths(held).tolist() == [1, 0, 3, 2]
    assert lengths(np.ones(3, bool)).tolist() == [6, 5, 4]
    assert lengths(np.zeros(2, bool)).tolist() == [0, 0]


def floats(value: float) -> bytes:
    store = typestore()
    return bytes(store.serialize_cdr(store.types[FLOAT](data=value), FLOAT))


def buffered(folder: Path, values: list[float]) -> None:
    writer = BufferWriter(folder, "/loaded", FLOAT, has_header=False)
    for number, value in enumerate(values):
        writer.append(number, floats(value))
    writer.close()


def numbers(first: int, count: int) -> dict[str, NDArray[np.intp]]:
    return {"out": first + np.arange(count)}


def heads(folder: Path, values: list[float], monitor: str = "out") -> None:
    with heads_path(folder, monitor).open("ab") as file:
        for value in values:
            file.write(message_size(floats(value)) + floats(value))


def rows_of(found: Rows, what: int) -> list[int]:
    rows: list[int] = found["row"][found["what"] == what].tolist()
    return rows


VALUES = [0.0, 0.0, 1.0, 1.0, 0.0]
CYCLE = CyclicSchedule(steps=tuple((place,) for place in range(5)))
PLAN = msgspec.structs.replace(Simulation().plan(), monitors=(MONITOR,), inputs=(INPUT,))


@pytest.mark.parametrize(
    ("before", "steps", "events", "unfinished"),
    [
        (0, 5, [2], []),
        (0, 10, [2, 7], []),
        (3, 5, [], [4]),
        (2, 5, [0], []),
        (3, 6, [4], []),
        (0, 3, [], [2]),
        (0, 8, [2], [7]),
    ],
)
def test_an_event_begins_with_a_message_that_meets_the_condition_after_one_that_does_not(
    tmp_path: Path, before: int, steps: int, events: list[int], unfinished: list[int]
) -> None:
    # One whose last messages are cut off by the end of the iteration does not count.
    buffered(tmp_path, VALUES)
    heads(tmp_path, [])
    marked = ReactionMarks(PLAN, MONITOR, CYCLE, tmp_path, tmp_path)
    found = marked.marks(played(steps), before, numbers(0, 0))
    assert (rows_of(found, EVENT), rows_of(found, UNFINISHED)) == (events, unfinished)


@given(held=st.lists(st.booleans(), min_size=1, max_size=6), steps=st.integers(1, 20))
@settings(deadline=None)
def test_validate_knows_the_most_events_that_an_iteration_counts(
    held: list[bool], steps: int
) -> None:
    of_round = np.array(held)
    counts = []
    for first in range(len(held)):
        places = (first + np.arange(steps)) % len(held)
        begun = np.flatnonzero(begin_events(of_round[places], held[first - 1]))
        counts.append(int(np.sum(begun + lengths(of_round)[places[begun]] <= steps)))
    assert most_within(held, steps) == max(counts)


def test_a_timeline_begins_anew_with_each_playback(tmp_path: Path) -> None:
    buffered(tmp_path, [1.0, 0.0, 1.0])
    heads(tmp_path, [])
    other = msgspec.structs.replace(INPUT, topic="/other")
    schedule = TimelineSchedule(
        steps=tuple(TimelineStep(place, 1 << (place % 2)) for place in range(6)),
        messages=tuple(
            TimelineMessage(place * MS, place, place % 2, place // 2) for place in range(6)
        ),
        origin_ns=0,
        period_ns=6 * MS,
        stamp_period_ns=6 * MS,
        inputs=2,
    )
    plan = msgspec.structs.replace(Simulation().plan(), monitors=(MONITOR,), inputs=(INPUT, other))
    marked = ReactionMarks(plan, MONITOR, schedule, tmp_path, tmp_path)
    playback = played(6)
    playback["inputs"] = [1, 2, 1, 2, 1, 2]
    # The last one would go on in the next round, which is not played.
    found = marked.marks(playback, 17, numbers(0, 0))
    assert (rows_of(found, EVENT), rows_of(found, UNFINISHED)) == ([0], [4])


def test_outputs_are_read_segment_by_segment(tmp_path: Path) -> None:
    buffered(tmp_path, VALUES)
    heads(tmp_path, [1.0, 0.0, 1.0, 0.2])
    marked = ReactionMarks(PLAN, MONITOR, CYCLE, tmp_path, tmp_path)
    assert rows_of(marked.marks(played(5), 0, numbers(1, 2)), MET) == [1]
    heads(tmp_path, [0.9])
    with heads_path(tmp_path, "out").open("ab") as file:
        file.write(message_size(b"short") + b"short")
    found = marked.marks(played(5), 5, numbers(4, 3))
    assert rows_of(found, MET) == [0]
    # One is damaged, and one is not in the file.
    assert rows_of(found, UNREADABLE) == [1, 2]


SEEN = MonitorPlan(name="seen", topic="/in", type=FLOAT, begins_events=True)
LIVE = msgspec.structs.replace(
    Simulation().plan(), playback_mode="live", monitors=(MONITOR, SEEN), inputs=()
)


def test_the_events_of_a_live_graph_are_messages_that_another_monitor_sees(tmp_path: Path) -> None:
    heads(tmp_path, [1.0, 0.0, 1.0, 0.0, 1.0, 1.0], "seen")
    heads(tmp_path, [0.0, 1.0])
    marked = ReactionMarks(LIVE, MONITOR, CyclicSchedule(steps=()), tmp_path, tmp_path)
    whole = {"out": np.arange(2), "seen": np.arange(6)}
    # What was before the first message is not known, nor what follows the last one.
    found = marked.marks(played(0), 0, whole)
    assert (rows_of(found, EVENT), rows_of(found, MET)) == ([2], [1])
    assert rows_of(found, UNFINISHED) == [4]
    # Messages that arrived between two segments belong to none.
    heads(tmp_path, [1.0, 0.0, 1.0, 0.0], "seen")
    found = marked.marks(played(0), 0, {"out": np.arange(0), "seen": np.array([7, 8, 9])})
    assert rows_of(found, EVENT) == [1]


@pytest.mark.parametrize("stamped", [True, False])
def test_a_live_reaction_counts_from_the_arrival_of_its_event(stamped: bool) -> None:
    events = received((0, 0), (1, 10), (2, 20), (3, 30))
    outputs = received((0, 12), (1, 14), (3, 33))
    if not stamped:
        events["stamp_ns"] = outputs["stamp_ns"] = 0
    matched = match_live_reactions(events, outputs, marks([1, 3], [0, 1, 2]))
    # The first output has the stamp of a message before the event; without stamps, nobody knows.
    assert reacted(matched) == {1: 4.0 if stamped else 2.0, 3: 3.0}
    segment = Segment(
        id="live", kind="iteration", rate_hz=0, index=1, steps=0, began_ns=0, ended_ns=40 * MS,
        complete=True, live=True,
    )  # fmt: skip
    samples = segment_samples(
        LIVE,
        segment,
        SegmentRows(
            played(0),
            {"out": outputs, "seen": events},
            {},
            lambda found: np.zeros(found.size, np.bool_),
            None,
            {"out": marks([1, 3], [2])},
        ),
    )
    seen = samples.monitors["out"]
    # Without stamps, the output may be a late reaction to the first event.
    expected = (2, 1, [0.003]) if stamped else (1, 1, [])
    assert (seen.expected, seen.missed, seen.times["reaction"].tolist()) == expected
    assert seen.aside == (0 if stamped else 1)


def test_a_file_that_is_cut_off_gives_what_it_has(tmp_path: Path) -> None:
    path = tmp_path / "x.heads"
    path.write_bytes(message_size(b"abc") + b"abc" + message_size(b"abcdef") + b"ab")
    reader = HeadReader(path)
    assert reader.read(0, 5) == [b"abc"]
    with path.open("ab") as file:
        file.write(b"cdef")
    assert reader.read(1, 5) == [b"abcdef"]
