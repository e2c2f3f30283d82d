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
from r2bspec.measure.samples import read_samples
from r2bspec.plan.model import Plan, PlayPlan
from r2bspec.record.store import RunFolder, open_run
from r2bspec.slo.judge import judge
from r2bspec.slo.looks import Looks, decide_at
from r2bspec.slo.terms import terms_of

_LEAST_STEPS = 2


def play_iterations(
    plan: Plan, stage: Stage, folder: RunFolder, note: Callable[[str], None]
) -> None:
    """Play the iterations of a plan, look by look.

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
        if number == len(looks) or not _goes_on(plan, folder, looks, number):
            return
        if _over_budget(plan, began_s, played, looks.iterations[number]):
            note("the time budget does not allow more iterations")
            return
        note(f"not all is decided after {end} iterations; there will be more")


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


def _goes_on(plan: Plan, folder: RunFolder, looks: Looks, number: int) -> bool:
    """Whether a look leaves something open that more iterations can settle."""
    samples = read_samples(open_run(folder.path))
    verdict = judge(plan.objectives, samples, terms_of(plan))
    counted = [each for each in verdict.requirements if each.level == "error"]
    return decide_at(looks, number, counted) == "go on"


def _over_budget(plan: Plan, began_s: float, played: int, end: int) -> bool:
    """Whether playing up to the next look would take longer than the plan allows."""
    if not plan.gate.time_budget_ns:
        return False
    spent_s = time.monotonic() - began_s
    return spent_s * end / played > plan.gate.time_budget_ns / 1e9
