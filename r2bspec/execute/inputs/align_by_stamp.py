"""Which messages of several inputs belong together: those of one stamp, not those of one index.

Pairing by index goes wrong for good after the first message that is missing on one side. By stamp,
what has no partner is left out, and counted.
"""

from __future__ import annotations

from dataclasses import dataclass

from r2bspec.execute.errors import RunError
from r2bspec.ipc.buffers import BufferIndex


@dataclass(frozen=True)
class AlignedSteps:
    """The steps to play: `steps[i][k]` is the position in input k of the message of step i.

    `unpaired` counts, for each topic, the messages that found no partner.
    """

    steps: tuple[tuple[int, ...], ...]
    unpaired: dict[str, int]


def align(inputs: list[BufferIndex], limit: int) -> AlignedSteps:
    """Pair the messages of all inputs, in the order of their stamps.

    Inputs with a header are paired by equal stamps. An input without one has nothing to be
    paired by but its order: its n-th message goes with the n-th step, and it starts again from
    its first one when it is shorter.

    Args:
        inputs: what was buffered for each input.
        limit: how many steps to keep at most; 0 keeps all.

    Raises:
        RunError: an input has no message, or no stamp is common to all.
    """
    for each in inputs:
        if not each.sizes:
            raise RunError(
                f"no message was buffered for {each.topic}",
                hint="Check the window, and what the preprocessors publish.",
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
                f"no two messages of the inputs have the same stamp ({counts} messages)",
                hint="Inputs of one step need equal header stamps; "
                "play inputs that were not recorded together in specs of their own.",
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
    """The steps of one round of playing.

    Looping begins again after the last step. Sweeping goes back to the first one step by step,
    so that no two steps that follow each other are far apart in the recording; the ends are
    played once each.
    """
    return steps + steps[-2:0:-1] if mode == "sweeping" else steps
