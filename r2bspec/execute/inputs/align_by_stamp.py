"""Combining the messages of several inputs to steps, by their stamps.

Combined by index, all messages after a missing one would be paired wrongly. By stamp, only messages
without a partner are left out, and counted.
"""

from __future__ import annotations

from dataclasses import dataclass

from r2bspec.execute.errors import RunError
from r2bspec.ipc.buffers import BufferIndex


@dataclass(frozen=True)
class AlignedSteps:
    """The steps to play: `steps[i][k]` is the position in input k of the message of step i.

    `unpaired` counts, for each topic, the messages without a partner.
    """

    steps: tuple[tuple[int, ...], ...]
    unpaired: dict[str, int]


def align(inputs: list[BufferIndex], limit: int) -> AlignedSteps:
    """Combine the messages of all inputs, in the order of their stamps.

    Inputs with a header are matched by equal stamps. An input without a header is matched by
    order: its n-th message belongs to the n-th step; a shorter input repeats from its first
    message.

    Args:
        inputs: the buffer of each input.
        limit: the maximum number of steps; 0 keeps all.

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
    positions = [
        {stamp_ns: position for position, stamp_ns in enumerate(each.stamps_ns)}
        for each in inputs
        if each.has_header
    ]
    if positions:
        common = sorted(set(positions[0]).intersection(*positions[1:]))
        if not common:
            counts = ", ".join(f"{each.topic}: {len(each.sizes)}" for each in inputs)
            raise RunError(
                f"no header stamp occurs in all inputs ({counts} messages)",
                hint="Messages of one step need equal header stamps; "
                "play inputs that were not recorded together in separate specs.",
                code="R2B644",
            )
    else:
        common = list(range(max(len(each.sizes) for each in inputs)))
    kept = common[:limit] if limit else common
    by_stamp = iter(positions)
    columns = []
    for each in inputs:
        if each.has_header:
            lookup = next(by_stamp)
            columns.append([lookup[stamp_ns] for stamp_ns in kept])
        else:
            columns.append([step % len(each.sizes) for step in range(len(kept))])
    return AlignedSteps(
        steps=tuple(zip(*columns, strict=True)),
        unpaired={
            each.topic: len(each.sizes) - len(common)
            for each in inputs
            if each.has_header and len(each.sizes) > len(common)
        },
    )


def playback_order(steps: tuple[tuple[int, ...], ...], mode: str) -> tuple[tuple[int, ...], ...]:
    """The steps of one round of playback.

    Looping continues with the first step after the last one. Sweeping goes back step by step, so
    that consecutive steps are always close in the recording; the first and the last step are
    played once per round.
    """
    return steps + steps[-2:0:-1] if mode == "sweeping" else steps
