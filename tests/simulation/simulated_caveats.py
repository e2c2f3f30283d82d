"""What verdicts on simulated runs say besides: of wrong ones how many do, and of right ones."""

from __future__ import annotations

import numpy as np
from simulated_starts import DEFAULT, Shape, StartWorld, limit_of, outcome, verdict_on

_MOST_RUNS = 2000
_OUTCOMES = {1: "pass", -1: "fail"}


def caveats(
    world: StartWorld,
    quantity: str,
    limit: float,
    decision: int,
    *,
    wanted: int,
    shape: Shape = DEFAULT,
) -> list[str]:
    """What is said of so many verdicts, or of as many as 2,000 runs have; empty where nothing is.

    Args:
        world: that the runs are of.
        quantity: on which there is a requirement.
        limit: its limit.
        decision: 1 for those that pass, -1 for those that fail.
        wanted: how many.
        shape: of the runs.
    """
    random, found = np.random.default_rng(5), list[str]()
    for _ in range(_MOST_RUNS):
        if len(found) == wanted:
            break
        values = world.run(random, shape)
        if outcome(values, shape, quantity, limit) != decision:
            continue
        verdict = verdict_on(values, quantity, limit, shape)
        (one,) = verdict.requirements
        if one.outcome == _OUTCOMES[decision]:
            # The first of the limits has the time and the machine.
            found.append(" ".join((*verdict.limits[1:], *one.notes)))
    return found


def share_told(
    world: StartWorld,
    quantity: str,
    limit: float,
    decision: int,
    words: str = "",
    *,
    wanted: int,
    shape: Shape = DEFAULT,
) -> str:
    """The share of verdicts that say something with these words, in percent."""
    found = caveats(world, quantity, limit, decision, wanted=wanted, shape=shape)
    told = sum(bool(text) and words in text for text in found)
    return f"{100 * told / len(found):.0f}" if found else ""


def share_told_of_wrong(
    world: StartWorld, quantity: str, decision: int = 1, *, wanted: int = 40
) -> str:
    """The same of verdicts on the limit, with any words."""
    return share_told(world, quantity, limit_of(world, quantity), decision, wanted=wanted)
