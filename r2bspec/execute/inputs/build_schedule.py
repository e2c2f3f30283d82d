"""Building the schedule of the player from the buffers, for all playback modes.

For types that rosbags provides it is known whether they have a header. For other types the player
reports it, and their stamps are then read from the buffers. A schedule with times is made in
`r2bspec.execute.inputs.timeline`; one without times is a round of steps:

- The messages of several inputs are combined to steps by their stamps. Combined by index, all
  messages after a missing one would be paired wrongly. By stamp, only messages without a partner
  are left out, and counted.
- Messages of inputs with a rate of their own, and recorded transforms, are placed between the
  steps, distributed as in the recording: a message that was stamped at a third of the interval is
  played at a third of it, at any rate of the steps. So an IMU of 200 Hz played with a camera of
  30 Hz keeps its number of messages for each image.
"""

from __future__ import annotations

import bisect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from r2bspec.execute.errors import RunError, UnpairedInputError
from r2bspec.execute.inputs.timeline import make_timeline, times_by_stamp
from r2bspec.ipc.buffers import TF, BufferIndex, buffered_transforms, read_index, read_stamps
from r2bspec.ipc.schedule import (
    BetweenMessage,
    CyclicSchedule,
    CyclicTransform,
    Schedule,
    TimelineSchedule,
    round_length_ns,
)
from r2bspec.measure.matching import input_mask
from r2bspec.plan.nearest_stamps import pair_nearest
from r2bspec.plan.plan import InputPlan, Plan
from r2bspec.record.run_record import UnplayedMessages


def build_schedule(
    plan: Plan, folder: Path, headers: Mapping[str, bool], note: Callable[[str], None]
) -> tuple[Schedule, tuple[UnplayedMessages, ...]]:
    """Build the schedule of a plan with playback.

    Args:
        plan: of the run.
        folder: contains the buffers.
        headers: for each input, whether its type begins with a header.
        note: receives a note about messages that are left out.

    Returns:
        The schedule, and what of the inputs it leaves out.

    Raises:
        RunError: an input has no messages, or none that can be scheduled.
        UnpairedInputError: most messages of an input are left out, and the plan refuses that.
    """
    found = [_load_index(folder, each.source, headers[each.topic]) for each in plan.inputs]
    types = {each.source: headers[each.topic] for each in plan.inputs if each.bag_topic}
    recorded = {
        each.topic for dataset in plan.datasets or (plan.dataset,) for each in dataset.topics
    }
    sources = [_load_index(folder, topic, types.get(topic)) for topic in sorted(recorded)]
    transforms = _load_tf_index(plan, folder)
    pairs = list(zip(plan.inputs, found, strict=True))
    if plan.timeline is None:
        return _cyclic_schedule(plan, pairs, sources, transforms, note)
    timeline, unknown = make_timeline(pairs, sources, plan.timeline, plan.buffer, transforms)
    unplayed = _unplayed(pairs, unknown, "recording", agreed=plan.unpaired == "drop")
    _note_unplayed(unplayed, note)
    require_most_played(unplayed)
    _check_every_monitor_has_steps(plan, timeline)
    note(
        f"one round of the timeline has {len(timeline.steps)} steps and takes "
        f"{timeline.period_ns / 1e9:.4g} s"
    )
    return timeline, unplayed


def _unplayed(
    pairs: Sequence[tuple[InputPlan, BufferIndex]],
    left_out: Mapping[str, int],
    cause: Literal["partner", "recording"],
    *,
    agreed: bool = False,
) -> tuple[UnplayedMessages, ...]:
    """The messages that are left out, by input; `left_out` counts them by buffer."""
    return tuple(
        UnplayedMessages(
            topic=each.topic,
            count=left_out[index.topic],
            total=len(index.sizes),
            cause=cause,
            agreed=agreed,
            slop_ns=max(other.slop_ns for other, _ in pairs) if cause == "partner" else 0,
        )
        for each, index in pairs
        if index.topic in left_out
    )


def _note_unplayed(unplayed: Sequence[UnplayedMessages], note: Callable[[str], None]) -> None:
    for each in unplayed:
        note(each.text.replace("were not played", "are not played"))


def require_most_played(unplayed: Sequence[UnplayedMessages]) -> None:
    """Check that of no input most messages are left out, unless the plan agrees.

    Raises:
        UnpairedInputError: of some input they are.
    """
    refused = [each for each in unplayed if each.is_most and not each.agreed]
    if refused:
        raise UnpairedInputError(
            "; ".join(each.clause for each in refused), hint=refused[0].help, code="R2B415"
        )


def _cyclic_schedule(
    plan: Plan,
    pairs: Sequence[tuple[InputPlan, BufferIndex]],
    sources: list[BufferIndex],
    transforms: BufferIndex | None,
    note: Callable[[str], None],
) -> tuple[CyclicSchedule, tuple[UnplayedMessages, ...]]:
    """The schedule of a plan without times.

    Raises:
        UnpairedInputError: most messages of an input have no partner, and the spec does not agree.
    """
    columns = [number for number, (each, _) in enumerate(pairs) if not each.recorded_rate]
    aligned = align(
        [pairs[number][1] for number in columns],
        plan.buffer,
        [pairs[number][0].slop_ns for number in columns],
    )
    unplayed = _unplayed(pairs, aligned.unpaired, "partner", agreed=plan.unpaired == "drop")
    _note_unplayed(unplayed, note)
    require_most_played(unplayed)
    steps = playback_order(aligned.steps, plan.playback_mode)
    timed = [_with_recorded_times(each, index, sources) for each, index in pairs]
    of_steps = [timed[number] for number in columns]
    between: list[BetweenMessage] = []
    for number, (each, _) in enumerate(pairs):
        if each.recorded_rate:
            placed = place_between(number, timed[number], steps, of_steps)
            note(f"{each.topic}: {len(placed)} messages between the {len(steps)} steps of a round")
            between += placed
    placed_transforms = () if transforms is None else place_transforms(transforms, steps, of_steps)
    schedule = CyclicSchedule(
        steps=steps,
        transforms=placed_transforms,
        columns=tuple(columns) if between else (),
        between=tuple(between),
        stamp_offsets_ns=playback_order(aligned.stamp_offsets_ns, plan.playback_mode),
    )
    return schedule, unplayed


def _with_recorded_times(
    plan: InputPlan, index: BufferIndex, sources: list[BufferIndex]
) -> BufferIndex:
    """The index with the times of the recording instead of those of the preprocessing."""
    if plan.bag_topic:
        return index
    times_ns = times_by_stamp(sources)
    known = tuple(times_ns.get(stamp_ns, stamp_ns) for stamp_ns in index.stamps_ns)
    return msgspec.structs.replace(index, times_ns=known)


def _load_index(folder: Path, topic: str, has_header: bool | None) -> BufferIndex:
    index = read_index(folder, topic)
    return read_stamps(folder, index) if has_header and index.has_header is None else index


def _load_tf_index(plan: Plan, folder: Path) -> BufferIndex | None:
    """The buffer of /tf, if transforms are played."""
    if not any(each.publish_tf for each in plan.datasets or (plan.dataset,)):
        return None
    return read_index(folder, TF) if TF in buffered_transforms(folder) else None


def _check_every_monitor_has_steps(plan: Plan, timeline: TimelineSchedule) -> None:
    """Check that each monitor has at least one step."""
    kinds = {each.inputs for each in timeline.steps}
    for monitor in plan.monitors:
        wanted = input_mask(plan.inputs, monitor.answers)
        if not any(kind & wanted == wanted for kind in kinds):
            raise RunError(
                f"no step of the timeline has messages of all inputs of monitor {monitor.name}: "
                f"{', '.join(monitor.answers)}",
                hint=f"Set monitors.{monitor.name}.answers to the inputs that it answers, such as "
                "'answers: [image]'.",
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

    Inputs with a header are matched by equal stamps, or by the nearest ones within a slop. An input
    without a header is matched by order: its n-th message belongs to the n-th step; a shorter input
    repeats from its first message.

    Args:
        inputs: the buffer of each input.
        limit: the maximum number of steps; 0 keeps all.
        slops_ns: the largest difference of stamps, for each input; empty for equal stamps.

    Raises:
        RunError: an input has no messages, or no stamp is common to all inputs.
    """
    for each in inputs:
        if not each.sizes:
            raise RunError(
                f"no messages were buffered for {each.topic}",
                hint="Check the window, and the messages that the preprocessors publish.",
                code="R2B643",
            )
    headers = [number for number, each in enumerate(inputs) if each.has_header]
    stamps = [inputs[number].stamps_ns for number in headers]
    slops = [slops_ns[number] for number in headers] if slops_ns else [0] * len(headers)
    if headers:
        matched = pair_nearest(stamps, slops)
        if not matched:
            raise _no_common_stamp(inputs, max(slops))
    else:
        matched = tuple(() for _ in range(max(len(each.sizes) for each in inputs)))
    kept = matched[:limit] if limit else matched
    steps = []
    for number, found in enumerate(kept):
        by_stamp = iter(found)
        steps.append(
            tuple(
                next(by_stamp) if each.has_header else number % len(each.sizes) for each in inputs
            )
        )
    return AlignedSteps(
        steps=tuple(steps),
        unpaired={
            each.topic: len(each.sizes) - len(matched)
            for each in inputs
            if each.has_header and len(each.sizes) > len(matched)
        },
        stamp_offsets_ns=_stamp_offsets(inputs, steps) if any(slops) else (),
    )


def _no_common_stamp(inputs: list[BufferIndex], slop_ns: int) -> RunError:
    counts = ", ".join(f"{each.topic}: {len(each.sizes)}" for each in inputs)
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


def _stamp_offsets(
    inputs: list[BufferIndex], steps: Sequence[tuple[int, ...]]
) -> tuple[tuple[int, ...], ...]:
    """The stamps of each step relative to its latest one; 0 for inputs without a header."""
    found = []
    for step in steps:
        stamps = [
            each.stamps_ns[place] if each.has_header else None
            for each, place in zip(inputs, step, strict=True)
        ]
        latest = max(each for each in stamps if each is not None)
        found.append(tuple(0 if each is None else each - latest for each in stamps))
    return tuple(found) if any(any(each) for each in found) else ()


def playback_order(steps: tuple[tuple[int, ...], ...], mode: str) -> tuple[tuple[int, ...], ...]:
    """The steps of one round of playback.

    Looping continues with the first step after the last one. Sweeping goes back step by step, so
    that consecutive steps are always close in the recording; the first and the last step are
    played once per round.
    """
    return steps + steps[-2:0:-1] if mode == "sweeping" else steps


def place_between(
    number: int, index: BufferIndex, steps: Sequence[tuple[int, ...]], inputs: Sequence[BufferIndex]
) -> tuple[BetweenMessage, ...]:
    """The messages of one input between the steps of a round.

    Where it and an input of the steps have headers, their stamps are compared, otherwise the times
    of recording. What was recorded outside of the steps is left out, but for a mean period after
    the last one.

    Args:
        number: of the input in the plan.
        index: its buffer.
        steps: one round.
        inputs: the buffers of the inputs of the steps.

    Raises:
        RunError: no message was recorded between the steps.
    """
    headers = [each for each in inputs if each.has_header] if index.has_header else []
    times_ns = index.stamps_ns if headers else index.times_ns
    by_time = sorted(range(len(times_ns)), key=lambda position: times_ns[position])
    ordered = [times_ns[position] for position in by_time]
    found = [
        BetweenMessage(
            step + (ordered[place] - from_ns) / (to_ns - from_ns), number, by_time[place]
        )
        for step, from_ns, to_ns in step_intervals(_step_times(steps, inputs, bool(headers)))
        for place in range(
            bisect.bisect_left(ordered, min(from_ns, to_ns)),
            bisect.bisect_left(ordered, max(from_ns, to_ns)),
        )
        if ordered[place] != to_ns
    ]
    if not found:
        raise RunError(
            f"no message of {index.topic} was recorded between the steps of the other inputs",
            hint="Check the window, and that the stamps of all inputs are on one clock.",
            code="R2B644",
        )
    return tuple(sorted(found, key=lambda each: each.at))


def step_intervals(times_ns: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """The number of each step of a round, its time, and that of the next one.

    The last interval of a round that only goes forwards is as long as the mean one.
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
    transforms: BufferIndex,
    steps: Sequence[tuple[int, ...]],
    inputs: Sequence[BufferIndex],
) -> tuple[CyclicTransform, ...]:
    """The positions of recorded transforms in a round of steps without times.

    Between two steps the transforms are distributed as in the recording: one that was recorded at
    a third of the interval is played at a third of it, at any rate. The differences of its stamps
    to those of the steps are kept; they are exact at the rate of the recording. The transforms
    that followed the last step, for a mean period, are played between the last and the first step.

    Args:
        transforms: the buffer of /tf.
        steps: one round, from `playback_order`.
        inputs: the buffer of each input.
    """
    times_ns = [
        max(index.times_ns[position] for index, position in zip(inputs, step, strict=True))
        for step in steps
    ]
    lags_ns = [
        _lag_ns(step, inputs, time_ns) for step, time_ns in zip(steps, times_ns, strict=True)
    ]
    placed = []
    for number, from_ns, to_ns in step_intervals(times_ns):
        early, late = min(from_ns, to_ns), max(from_ns, to_ns)
        first = bisect.bisect_left(transforms.times_ns, early)
        for position in range(first, bisect.bisect_left(transforms.times_ns, late)):
            at = (transforms.times_ns[position] - from_ns) / (to_ns - from_ns)
            origin_ns = transforms.times_ns[position] + lags_ns[number]
            if at < 1:
                placed.append(CyclicTransform(number + at, position, origin_ns))
    return tuple(sorted(placed, key=lambda each: each.at))


def _lag_ns(step: tuple[int, ...], inputs: Sequence[BufferIndex], time_ns: int) -> int:
    """The stamp of a step minus the time of its recording; usually negative."""
    for index, position in zip(inputs, step, strict=True):
        if index.has_header:
            return index.stamps_ns[position] - time_ns
    return 0
