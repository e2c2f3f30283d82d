"""Building the schedule of the player from the buffers, for all playback modes.

For types that rosbags provides it is known whether they have a header. For other types the player
reports it, and their stamps are then read from the buffers. A schedule without times is a round of
steps:

- The messages of several inputs are combined to steps by their stamps. Combined by index, all
  messages after a missing one would be paired wrongly. By stamp, only messages without a partner
  are left out, and counted.
- Messages of inputs with a rate of their own, and recorded transforms, are placed between the
  steps, distributed as in the recording: a message that was stamped at a third of the interval is
  played at a third of it, at any rate of the steps. So an IMU of 200 Hz played with a camera of
  30 Hz keeps its number of messages for each image.

Building a timeline from the buffers: the messages of each step, and their due times.

Messages with the same header stamp are one step, no matter how far apart they were recorded and on
how many inputs: a step of an IMU has no camera message. A message without a header is a step by
itself. Where the spec allows differences of stamps, messages of all inputs with a slop whose
stamps are near each other are one step, and the differences stay; a message without partners is a
step of its input alone. Messages from the bag are played at the times of their recording. Messages
of a preprocessor are played at the time at which the last message with their stamp was recorded or,
if the plan says so, at which they were published.
"""

from __future__ import annotations

import bisect
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from r2bspec.execute.errors import CertainRunError, RunError
from r2bspec.ipc.buffers import TF, BufferIndex, buffered_transforms, read_index, read_stamps
from r2bspec.ipc.schedule import (
    NO_STEP,
    BetweenMessage,
    CyclicSchedule,
    Schedule,
    TimelineMessage,
    TimelineSchedule,
    TimelineStep,
    round_length_ns,
)
from r2bspec.judge.measure.matching import input_mask
from r2bspec.language.spec import QoS
from r2bspec.plan.nearest_stamps import pair_nearest
from r2bspec.plan.plan import CallPlan, InputPlan, Plan, TimelinePlan
from r2bspec.record.run_record import UnplayedMessages

_MAX_TF_AGE_NS = 1_000_000_000
"""Transforms up to this age at the beginning of a timeline are published at its beginning."""


_StepKey = tuple[int, int, int]
"""A step: its stamp, its index among messages of one input with that stamp, and the input if it has
no header."""


@dataclass(slots=True)
class _TimedMessage:
    """A message: its input, position, time and, if it has a header, its stamp.

    `step_ns` is the stamp of its step: its own, or the latest one of its pair.
    """

    input: int
    position: int
    time_ns: int
    stamp_ns: int | None
    step_ns: int | None
    key: _StepKey = (0, 0, 0)


def make_timeline(
    inputs: Sequence[tuple[InputPlan, BufferIndex]],
    sources: Sequence[BufferIndex],
    plan: TimelinePlan,
    buffer: int = 0,
    transforms: BufferIndex | None = None,
) -> tuple[TimelineSchedule, dict[str, int]]:
    """Schedule the messages of all inputs.

    Args:
        inputs: the inputs that are played, with their buffers.
        sources: the buffers of the bag.
        plan: how recorded time is converted to playback time.
        buffer: the maximum number of messages of each input; 0 keeps all.
        transforms: recorded /tf, if it is played.

    Returns:
        The timeline; and for each topic with such messages, how many are left out because no
        recorded message has their stamp.

    Raises:
        RunError: an input has no messages, or none with a known time.
    """
    by_stamp = times_by_stamp(sources)
    messages: list[_TimedMessage] = []
    unknown: dict[str, int] = {}
    for column, (input_, index) in enumerate(inputs):
        times_ns = [
            index.times_ns[position]
            if input_.bag_topic or plan.recorded
            else by_stamp.get(index.stamps_ns[position] + input_.ahead_ns)
            for position in range(len(index.sizes))[: buffer or None]
        ]
        stamps_ns = [
            index.stamps_ns[position] + input_.later_ns if index.has_header else None
            for position in range(len(times_ns))
        ]
        known_times = [
            _TimedMessage(column, position, time_ns + input_.later_ns, stamp_ns, stamp_ns)
            for position, (time_ns, stamp_ns) in enumerate(zip(times_ns, stamps_ns, strict=True))
            if time_ns is not None
        ]
        if not known_times:
            raise _no_messages_error(input_, len(times_ns))
        if len(known_times) < len(times_ns):
            unknown[index.topic] = len(times_ns) - len(known_times)
        messages += known_times
    slops_ns = [loaded_input.slop_ns for loaded_input, _ in inputs]
    if any(slops_ns):
        _pair(messages, slops_ns)
    return _build_timeline(messages, plan, len(inputs), transforms), unknown


def _pair(messages: list[_TimedMessage], slops_ns: Sequence[int]) -> None:
    """Give messages the stamp of their pair where they have one."""
    by_input: dict[int, list[tuple[_TimedMessage, int]]] = {}
    for message in messages:
        if message.stamp_ns is not None and slops_ns[message.input]:
            by_input.setdefault(message.input, []).append((message, message.stamp_ns))
    stamps = [[stamp_ns for _, stamp_ns in stamped] for stamped in by_input.values()]
    for pair in pair_nearest(stamps, [slops_ns[column] for column in by_input]):
        members = [stamped[number] for stamped, number in zip(by_input.values(), pair, strict=True)]
        latest_ns = max(stamp_ns for _, stamp_ns in members)
        for message, _ in members:
            message.step_ns = latest_ns


def times_by_stamp(sources: Sequence[BufferIndex]) -> dict[int, int]:
    """Return, for each stamp, the time at which the last message with it was recorded."""
    times: dict[int, int] = {}
    for index in sources:
        if index.has_header:
            for stamp_ns, time_ns in zip(index.stamps_ns, index.times_ns, strict=True):
                times[stamp_ns] = max(time_ns, times.get(stamp_ns, time_ns))
    return times


def _nothing_buffered(topic: str) -> RunError:
    return RunError(
        f"no messages were buffered for {topic}",
        hint="Check the window, and the messages that the preprocessors publish.",
        code="R2B643",
    )


def _no_messages_error(plan: InputPlan, count: int) -> RunError:
    if not count:
        return _nothing_buffered(plan.source)
    return RunError(
        f"none of the {count} messages on {plan.source} has the stamp of a recorded message, so "
        "their times are unknown",
        hint="Keep the stamps in the preprocessors, or set 'record_timeline: true' to play the "
        "messages at the times at which they are published.",
        code="R2B659",
    )


def _build_timeline(
    found: list[_TimedMessage], plan: TimelinePlan, inputs: int, transforms: BufferIndex | None
) -> TimelineSchedule:
    found.sort(key=lambda each: (each.time_ns, each.input, each.position))
    start_ns = found[0].time_ns
    first_ns, masks = _steps(found)
    stamps = _unique_stamps(first_ns)
    numbers = {key: number for number, key in enumerate(first_ns)}
    length_ns = max(round_length_ns(list(first_ns.values())), found[-1].time_ns - start_ns + 1)
    messages = []
    offsets = [[0] * inputs for _ in numbers]
    for each in found:
        due_ns = round((each.time_ns - start_ns) / plan.speed)
        messages.append(TimelineMessage(due_ns, numbers[each.key], each.input, each.position))
        if each.stamp_ns is not None and each.step_ns is not None:
            offsets[numbers[each.key]][each.input] = each.stamp_ns - each.step_ns
    if transforms is not None:
        messages += _transform_messages(transforms, start_ns, length_ns, plan.speed, inputs)
        # The transforms of a message are published before it.
        messages.sort(key=lambda each: (each.offset_ns, each.step != NO_STEP))
    spread_ns = max(stamps.values()) - min(stamps.values())
    return TimelineSchedule(
        steps=tuple(TimelineStep(stamps[key], masks[key]) for key in first_ns),
        messages=tuple(messages),
        # No message has a stamp later than its publication; the latest stamp equals it.
        origin_ns=start_ns
        + max((e.stamp_ns - e.time_ns for e in found if e.stamp_ns is not None), default=0),
        period_ns=max(round(length_ns / plan.speed), messages[-1].offset_ns + 1),
        stamp_period_ns=max(length_ns, spread_ns + 1),
        inputs=inputs,
        shift_transforms=plan.shift_tf,
        stamp_offsets_ns=_unless_all_zero(offsets),
    )


def _unless_all_zero(offsets: list[list[int]]) -> tuple[tuple[int, ...], ...]:
    """Return the stamp of each message minus that of its step; empty if all are 0."""
    return tuple(map(tuple, offsets)) if any(map(any, offsets)) else ()


def _steps(found: list[_TimedMessage]) -> tuple[dict[_StepKey, int], dict[_StepKey, int]]:
    """Return the start and the inputs of each step, in order of time.

    Messages get the keys of theirs.
    """
    counts: Counter[tuple[int, int | None]] = Counter()
    first_ns: dict[_StepKey, int] = {}
    masks: dict[_StepKey, int] = {}
    for each in found:
        # A device may repeat a stamp; the n-th messages with it belong to one step.
        nth = counts[each.input, each.step_ns]
        counts[each.input, each.step_ns] += 1
        if each.step_ns is None:
            each.key = each.time_ns, nth, each.input
        else:
            each.key = each.step_ns, nth, -1
        first_ns.setdefault(each.key, each.time_ns)
        masks[each.key] = masks.get(each.key, 0) | 1 << each.input
    return first_ns, masks


def _unique_stamps(keys: Iterable[_StepKey]) -> dict[_StepKey, int]:
    """Return the stamps, made unique by adding nanoseconds, because they identify outputs."""
    stamps: dict[_StepKey, int] = {}
    last_ns: int | None = None
    for key in sorted(keys):
        stamps[key] = last_ns = key[0] if last_ns is None else max(key[0], last_ns + 1)
    return stamps


def _transform_messages(
    transforms: BufferIndex, start_ns: int, length_ns: int, speed: float, column: int
) -> list[TimelineMessage]:
    """Return the transforms of a round; those from shortly before its beginning are due with it."""
    return [
        TimelineMessage(round(max(0, time_ns - start_ns) / speed), NO_STEP, column, position)
        for position, time_ns in enumerate(transforms.times_ns)
        if -_MAX_TF_AGE_NS <= time_ns - start_ns < length_ns
    ]


def build_schedule(
    plan: Plan, folder: Path, headers: Mapping[str, bool], note: Callable[[str], None]
) -> tuple[Schedule, tuple[UnplayedMessages, ...]]:
    """Build the schedule of a plan with playback.

    Args:
        plan: the plan of the run.
        folder: contains the buffers.
        headers: for each input, whether its type begins with a header.
        note: receives a note about messages that are left out.

    Returns:
        The schedule, and what of the inputs it leaves out.

    Raises:
        RunError: an input has no messages, or none that can be scheduled.
        CertainRunError: most messages of an input are left out, and the plan refuses that.
    """
    pairs = [(source, _load_input(folder, source, headers[source.topic])) for source in plan.inputs]
    types = {input_.source: headers[input_.topic] for input_ in plan.inputs if input_.bag_topic}
    datasets = plan.datasets or (plan.dataset,)
    recorded = {topic.topic for dataset in datasets for topic in dataset.topics}
    sources = [_load_index(folder, topic, types.get(topic)) for topic in sorted(recorded)]
    transforms = None
    if any(dataset.publish_tf for dataset in datasets) and TF in buffered_transforms(folder):
        transforms = read_index(folder, TF)
    if plan.timeline is None:
        return _cyclic_schedule(plan, pairs, sources, transforms, note)
    timeline, unknown = make_timeline(pairs, sources, plan.timeline, plan.buffer, transforms)
    unplayed = _unplayed(plan, pairs, unknown, "recording", note)
    _check_every_monitor_has_steps(plan, timeline)
    note(
        f"one round of the timeline has {len(timeline.steps)} steps and takes "
        f"{timeline.period_ns / 1e9:.4g} s"
    )
    return timeline, unplayed


def build_call_timeline(
    calls: Sequence[CallPlan], plan: TimelinePlan, folder: Path
) -> TimelineSchedule:
    """Build the schedule of recorded requests: each request is a step, due at its recorded time.

    Args:
        calls: those of the plan; each with recorded requests is a part.
        plan: how recorded time is converted to playback time.
        folder: contains the buffers.

    Raises:
        RunError: no request is recorded.
    """
    sources = [(call, str(call.source)) for call in calls if call.source]
    inputs = [
        InputPlan(topic=call.topic, type=call.type, source=source, bag_topic=source, qos=QoS())
        for call, source in sources
    ]
    indexes = [read_index(folder, source) for _, source in sources]
    return make_timeline([*zip(inputs, indexes, strict=True)], (), plan)[0]


def _unplayed(
    plan: Plan,
    pairs: Sequence[tuple[InputPlan, BufferIndex]],
    left_out: Mapping[str, int],
    cause: Literal["partner", "recording"],
    note: Callable[[str], None],
) -> tuple[UnplayedMessages, ...]:
    """Return the messages that are left out, by input, each noted.

    `left_out` counts them by buffer.

    Raises:
        CertainRunError: of some input these are most, and the plan does not agree.
    """
    unplayed = tuple(
        UnplayedMessages(
            topic=source.topic,
            count=left_out[index.topic],
            total=len(index.sizes),
            cause=cause,
            agreed=plan.unpaired == "drop",
            slop_ns=max(other.slop_ns for other, _ in pairs) if cause == "partner" else 0,
        )
        for source, index in pairs
        if index.topic in left_out
    )
    for topic in unplayed:
        note(topic.text.replace("were not played", "are not played"))
    refused = [topic for topic in unplayed if topic.is_most and not topic.agreed]
    if refused:
        raise CertainRunError(
            "; ".join(topic.clause for topic in refused),
            hint=refused[0].help,
            code="R2B415",
        )
    return unplayed


def _cyclic_schedule(
    plan: Plan,
    pairs: Sequence[tuple[InputPlan, BufferIndex]],
    sources: list[BufferIndex],
    transforms: BufferIndex | None,
    note: Callable[[str], None],
) -> tuple[CyclicSchedule, tuple[UnplayedMessages, ...]]:
    """Return the schedule of a plan without times.

    Raises:
        CertainRunError: most messages of an input have no partner, and the spec does not agree.
    """
    columns = [
        number for number, (loaded_input, _) in enumerate(pairs) if not loaded_input.recorded_rate
    ]
    aligned = align(
        [pairs[number][1] for number in columns],
        plan.buffer,
        [pairs[number][0].slop_ns for number in columns],
    )
    unplayed = _unplayed(plan, pairs, aligned.unpaired, "partner", note)
    steps = playback_order(aligned.steps, plan.playback_mode)
    timed = [_with_recorded_times(loaded_input, index, sources) for loaded_input, index in pairs]
    of_steps = [timed[number] for number in columns]
    between: list[BetweenMessage] = []
    for number, (input_, _) in enumerate(pairs):
        if input_.recorded_rate:
            placed = place_between(number, timed[number], steps, of_steps)
            note(
                f"{input_.topic}: {len(placed)} messages between the {len(steps)} steps of a round"
            )
            between += placed
    of_some = tuple(columns) if between else ()
    if transforms is not None:
        between += place_transforms(len(pairs), transforms, steps, of_steps)
    schedule = CyclicSchedule(
        steps=steps,
        columns=of_some,
        between=tuple(sorted(between, key=lambda message: message.at)),
        stamp_offsets_ns=playback_order(aligned.stamp_offsets_ns, plan.playback_mode),
    )
    return schedule, unplayed


def _with_recorded_times(
    plan: InputPlan, index: BufferIndex, sources: list[BufferIndex]
) -> BufferIndex:
    """Return the index with the times of the recording instead of those of the preprocessing."""
    if plan.bag_topic:
        return index
    times_ns = times_by_stamp(sources)
    recorded_ns = tuple(
        times_ns.get(stamp_ns + plan.ahead_ns, stamp_ns) for stamp_ns in index.stamps_ns
    )
    return msgspec.structs.replace(index, times_ns=recorded_ns)


def _load_input(folder: Path, plan: InputPlan, has_header: bool) -> BufferIndex:
    """Return the index of an input, with the stamps of a clock that is right."""
    index = _load_index(folder, plan.source, has_header)
    if not plan.ahead_ns or not index.has_header:
        return index
    right_ns = tuple(stamp_ns - plan.ahead_ns for stamp_ns in index.stamps_ns)
    return msgspec.structs.replace(index, stamps_ns=right_ns)


def _load_index(folder: Path, topic: str, has_header: bool | None) -> BufferIndex:
    index = read_index(folder, topic)
    return read_stamps(folder, index) if has_header and index.has_header is None else index


def _check_every_monitor_has_steps(plan: Plan, timeline: TimelineSchedule) -> None:
    """Check that each monitor has at least one step."""
    kinds = {step.inputs for step in timeline.steps}
    for monitor in plan.monitors:
        mask = input_mask(plan.step_sources, monitor.answers)
        if not any(kind & mask == mask for kind in kinds):
            raise RunError(
                f"no step of the timeline has messages of all inputs of monitor {monitor.name}: "
                f"{', '.join(monitor.answers)}",
                hint=f"Set monitors.{monitor.name}.answers to the inputs that it answers, such as "
                f"'answers: [{monitor.answers[0].removeprefix(f'{plan.namespace}/')}]'.",
                code="R2B658",
            )


@dataclass(frozen=True)
class AlignedSteps:
    """The steps to play: `steps[i][k]` is the position in input k of the message of step i.

    Attributes:
        unpaired: for each topic, the number of messages without a partner.
        stamp_offsets_ns: for each step and input, the recorded stamp minus the latest one of the
            step; empty if all are 0.
    """

    steps: tuple[tuple[int, ...], ...]
    unpaired: dict[str, int]
    stamp_offsets_ns: tuple[tuple[int, ...], ...] = ()


def align(inputs: list[BufferIndex], limit: int, slops_ns: Sequence[int] = ()) -> AlignedSteps:
    """Combine the messages of all inputs, in the order of their stamps.

    Inputs with a header are matched by equal stamps, or by the nearest stamps within a slop. An
    input without a header is matched by order: its n-th message belongs to the n-th step; a shorter
    input repeats from its first message.

    Args:
        inputs: the buffer of each input.
        limit: the maximum number of steps; 0 keeps all.
        slops_ns: the largest difference of stamps, for each input; empty for equal stamps.

    Raises:
        RunError: an input has no messages, or no stamp is common to all inputs.
    """
    for source in inputs:
        if not source.sizes:
            raise _nothing_buffered(source.topic)
    headers = [number for number, input_ in enumerate(inputs) if input_.has_header]
    stamps = [inputs[number].stamps_ns for number in headers]
    slops = [slops_ns[number] for number in headers] if slops_ns else [0] * len(headers)
    if headers:
        matched = pair_nearest(stamps, slops)
        if not matched:
            raise _no_common_stamp(inputs, max(slops))
    else:
        matched = tuple(() for _ in range(max(len(loaded_input.sizes) for loaded_input in inputs)))
    steps = []
    for number, found in enumerate(matched[: limit or None]):
        by_stamp = iter(found)
        steps.append(
            tuple(
                next(by_stamp) if source.has_header else number % len(source.sizes)
                for source in inputs
            )
        )
    return AlignedSteps(
        steps=tuple(steps),
        unpaired={
            loaded_input.topic: len(loaded_input.sizes) - len(matched)
            for loaded_input in inputs
            if loaded_input.has_header and len(loaded_input.sizes) > len(matched)
        },
        stamp_offsets_ns=_offsets_from_latest(inputs, steps) if any(slops) else (),
    )


def _no_common_stamp(inputs: list[BufferIndex], slop_ns: int) -> RunError:
    counts = ", ".join(f"{input_.topic}: {len(input_.sizes)}" for input_ in inputs)
    return RunError(
        f"no messages of all inputs have stamps within {slop_ns / 1e6:g} ms ({counts} messages)"
        if slop_ns
        else f"no header stamp occurs in all inputs ({counts} messages)",
        hint="Messages of one step need equal header stamps, or stamps that differ by at most "
        "'playback.pairing: {slop: ...}'. 'mode: timeline' plays inputs of any stamps at the "
        "recorded times, 'rate: recorded' plays an input between the steps; play inputs that were "
        "not recorded together in separate specs.",
        code="R2B644",
    )


def _offsets_from_latest(
    inputs: list[BufferIndex], steps: Sequence[tuple[int, ...]]
) -> tuple[tuple[int, ...], ...]:
    """Return the stamps of each step relative to its latest one; 0 for inputs without a header."""
    offsets = []
    for step in steps:
        stamps = [
            source.stamps_ns[place] if source.has_header else None
            for source, place in zip(inputs, step, strict=True)
        ]
        latest = max(stamp for stamp in stamps if stamp is not None)
        offsets.append([0 if stamp is None else stamp - latest for stamp in stamps])
    return _unless_all_zero(offsets)


def playback_order(steps: tuple[tuple[int, ...], ...], mode: str) -> tuple[tuple[int, ...], ...]:
    """Return the steps of one round of playback.

    Looping continues with the first step after the last one. Sweeping goes back step by step, so
    that consecutive steps are always close in the recording; the first and the last step are
    played once per round.
    """
    return steps + steps[-2:0:-1] if mode == "sweeping" else steps


def place_between(
    number: int, index: BufferIndex, steps: Sequence[tuple[int, ...]], inputs: Sequence[BufferIndex]
) -> list[BetweenMessage]:
    """Place the messages of an input between the steps of a round.

    If it and an input of the steps have headers, their stamps are compared. If not, or if no stamp
    lies within the round because the clocks differ, the times of recording are compared. Messages
    that were recorded outside of the steps are left out, except for a mean period after the last
    step.

    Args:
        number: the number of the input in the plan.
        index: its buffer.
        steps: one round.
        inputs: the buffers of the inputs of the steps.

    Raises:
        RunError: no message was recorded between the steps.
    """
    stamps = index.has_header is True and any(input_.has_header for input_ in inputs)
    for by_stamps in [True, False] if stamps else [False]:
        times_ns = index.stamps_ns if by_stamps else index.times_ns
        round_ns = _step_times(steps, inputs, by_stamps)
        placed = [
            BetweenMessage(step + share, number, position)
            for step, share, position in _between_steps(times_ns, round_ns)
        ]
        if placed:
            return placed
    raise RunError(
        f"no message of {index.topic} was recorded between the steps of the other inputs",
        hint="Check the window.",
        code="R2B644",
    )


def _between_steps(
    times_ns: Sequence[int], steps_ns: Sequence[int]
) -> Iterator[tuple[int, float, int]]:
    """Return for each time of a round its step, its share of the interval, and its position."""
    by_time = sorted(range(len(times_ns)), key=lambda position: times_ns[position])
    ordered = [times_ns[position] for position in by_time]
    for step, from_ns, to_ns in step_intervals(steps_ns):
        # What is at the beginning of the interval is in it, in either direction.
        bisect_end = bisect.bisect_left if from_ns < to_ns else bisect.bisect_right
        first, last = sorted((bisect_end(ordered, from_ns), bisect_end(ordered, to_ns)))
        for place in range(first, last):
            yield step, (ordered[place] - from_ns) / (to_ns - from_ns), by_time[place]


def step_intervals(times_ns: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """Yield the number of each step of a round, its time, and the time of the next step.

    The last interval of a round that only goes forwards is as long as the mean interval.
    """
    different = sorted(set(times_ns))
    period_ns = round_length_ns(different) // len(different)
    for number, from_ns in enumerate(times_ns):
        to_ns = times_ns[(number + 1) % len(times_ns)]
        last = number + 1 == len(times_ns)
        if last and to_ns <= from_ns and len(different) == len(times_ns):
            to_ns = from_ns + period_ns
        if to_ns != from_ns:
            yield number, from_ns, to_ns


def _step_times(
    steps: Sequence[tuple[int, ...]], inputs: Sequence[BufferIndex], stamps: bool
) -> list[int]:
    return [
        max(
            index.stamps_ns[position] if stamps else index.times_ns[position]
            for index, position in zip(inputs, step, strict=True)
            if index.has_header or not stamps
        )
        for step in steps
    ]


def place_transforms(
    number: int,
    transforms: BufferIndex,
    steps: Sequence[tuple[int, ...]],
    inputs: Sequence[BufferIndex],
) -> list[BetweenMessage]:
    """Return the positions of recorded transforms in a round of steps without times.

    Between two steps the transforms are distributed as in the recording: a transform recorded at a
    third of the interval is played at a third of it, at any rate. The differences between its
    stamps and those of the steps are kept; they are exact at the rate of the recording. The
    transforms that followed the last step, for a mean period, are played between the last and the
    first step.

    Args:
        number: the number of all inputs of the plan.
        transforms: the buffer of /tf.
        steps: one round, from `playback_order`.
        inputs: the buffers of the inputs of the steps.
    """
    times_ns = _step_times(steps, inputs, stamps=False)
    lags_ns = [
        _lag_ns(step, inputs, time_ns) for step, time_ns in zip(steps, times_ns, strict=True)
    ]
    return [
        BetweenMessage(
            step + share, number, position, transforms.times_ns[position] + lags_ns[step]
        )
        for step, share, position in _between_steps(transforms.times_ns, times_ns)
    ]


def _lag_ns(step: tuple[int, ...], inputs: Sequence[BufferIndex], time_ns: int) -> int:
    """Return the stamp of a step minus the time of its recording; usually negative."""
    for index, position in zip(inputs, step, strict=True):
        if index.has_header:
            return index.stamps_ns[position] - time_ns
    return 0
