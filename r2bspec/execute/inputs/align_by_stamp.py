"""Combining the messages of several inputs to steps, by their stamps.

Combined by index, all messages after a missing one would be paired wrongly. By stamp, only messages
without a partner are left out, and counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from r2bspec.execute.errors import RunError
from r2bspec.ipc.buffers import BufferIndex
from r2bspec.plan.nearest_stamps import pair_nearest


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
