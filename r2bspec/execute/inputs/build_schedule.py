"""Building the schedule of the player from the buffers, for all playback modes.

For types that rosbags provides it is known whether they have a header. For other types the player
reports it, and their stamps are then read from the buffers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import msgspec

from r2bspec.execute.errors import RunError, UnpairedInputError
from r2bspec.execute.inputs.align_by_stamp import align, playback_order
from r2bspec.execute.inputs.recorded_rate import place_between
from r2bspec.execute.inputs.timeline import make_timeline, times_by_stamp
from r2bspec.execute.inputs.transform_schedule import place_transforms
from r2bspec.ipc.buffers import BufferIndex, buffered_transforms, read_index, read_stamps
from r2bspec.ipc.schedule import BetweenMessage, CyclicSchedule, Schedule, TimelineSchedule
from r2bspec.ipc.stamps import TF
from r2bspec.measure.matching import input_mask
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
    refuse_most(unplayed)
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


def refuse_most(unplayed: Sequence[UnplayedMessages]) -> None:
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
    refuse_most(unplayed)
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
