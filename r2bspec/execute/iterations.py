"""Playing the iterations: as many as were declared, and more where the verdict is still open.

All rates are played in turn in each iteration, so that a slow drift of the machine touches all of
them alike. Where the spec allows more iterations than it asks for, the run is looked at when it
has once, twice and four times as many as declared, with the error divided among the looks
(`r2bspec.slo.looks`); it goes on only while something is open that more iterations can settle.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from r2bspec.execute.playing import Stage
from r2bspec.plan.model import Plan, PlayPlan
from r2bspec.slo.looks import Looks, decide_at
from r2bspec.slo.model import Verdict
from r2bspec.slo.terms import terms_of

_LEAST_STEPS = 2


def play_iterations(
    plan: Plan, stage: Stage, judge_so_far: Callable[[], Verdict], note: Callable[[str], None]
) -> int:
    """Play the iterations of a plan, look by look.

    Args:
        plan: of the run.
        stage: where to play.
        judge_so_far: the verdict on everything that has been played.
        note: is told what was decided.

    Returns:
        How many iterations were played at each rate.

    Raises:
        RunError: what `Stage.play` raises.
    """
    began_s = time.monotonic()
    looks = terms_of(plan).looks or Looks((max(each.iterations for each in plan.play),))
    played = 0
    for number, end in enumerate(looks.iterations, start=1):
        for index in range(played + 1, end + 1):
            _play_once(plan.play, stage, index, end)
        played = end
        if number == len(looks) or not _goes_on(judge_so_far(), looks, number):
            break
        if _over_budget(plan, began_s, played, looks.iterations[number]):
            note("the time budget does not allow more iterations")
            break
        note(f"not all is decided after {end} iterations; there will be more")
    return played


def play_so_many(plan: Plan, stage: Stage, number: int) -> None:
    """Play a fixed number of iterations of a plan.

    Raises:
        RunError: what `Stage.play` raises.
    """
    for index in range(1, number + 1):
        _play_once(plan.play, stage, index, number)


def _play_once(plays: Sequence[PlayPlan], stage: Stage, index: int, end: int) -> None:
    for play in plays:
        stage.play(
            "iteration",
            f"rate-{play.rate_hz:g}Hz-{index:03d}",
            play.rate_hz,
            max(_LEAST_STEPS, round(play.duration_ns / 1e9 * play.rate_hz)),
            title=f"{play.rate_hz:g} Hz, iteration {index} of {end}",
            index=index,
        )


def _goes_on(verdict: Verdict, looks: Looks, number: int) -> bool:
    """Whether a look leaves something open that more iterations can settle."""
    counted = [each for each in verdict.requirements if each.level == "error"]
    return decide_at(looks, number, counted) == "go on"


def _over_budget(plan: Plan, began_s: float, played: int, end: int) -> bool:
    """Whether playing up to the next look would take longer than the plan allows."""
    if not plan.gate.time_budget_ns:
        return False
    spent_s = time.monotonic() - began_s
    return spent_s * end / played > plan.gate.time_budget_ns / 1e9
