"""Results of searches for a deployment, made by hand."""

from __future__ import annotations

import io
import math
from typing import Any

from r2bspec.plan.tuning_space import Choice, Deployment, Lever, Setting, TuningSpace
from r2bspec.report.output import console
from r2bspec.tune.tuning_report import print_tuning
from r2bspec.tune.tuning_result import MAX_EXCESS, Gain, RequirementMargin, Trial, TuningResult

HOSTILE = "<script>alert('x')</script> \x1b[31m|\n::error::\u202e&amp; `code` [bold]"

GOAL = "cpu.graph.mean at 30 Hz"

SPACE = TuningSpace(
    levers=(
        Lever(
            name="graph.placement",
            settings=(
                Setting(text="separate"),
                Setting(text="shared", sets=("graph.placement=shared",)),
            ),
        ),
        Lever(
            name="graph.nodes.detector.threads",
            settings=(
                Setting(text="1 thread"),
                Setting(
                    text="2 threads",
                    sets=(
                        "graph.nodes.detector.executor=multi_threaded",
                        "graph.nodes.detector.threads=2",
                    ),
                ),
                Setting(text="4 threads", sets=("graph.nodes.detector.threads=4",)),
            ),
        ),
        Lever(
            name="graph.nodes.detector.scheduling",
            settings=(
                Setting(text="usual"),
                Setting(
                    text="fifo 40",
                    sets=("graph.nodes.detector.scheduling={policy: fifo, priority: 40}",),
                    for_others="detector runs before every usual process of this machine.",
                ),
            ),
        ),
    ),
    left_out=("graph.nodes.driver: a launch file starts it, and r2bspec does not.",),
)


def to_text(result: TuningResult, width: int = 100) -> str:
    """The report as plain text, without colours."""
    buffer = io.StringIO()
    print_tuning(result, console(buffer, width=width, color_system=None, legacy_windows=False))
    return "".join(f"{line.rstrip()}\n" for line in buffer.getvalue().splitlines())


def deployment(**places: int) -> Deployment:
    """A deployment of `SPACE`, by the last parts of the names of its levers."""
    names = {lever.name.rpartition(".")[2]: lever.name for lever in SPACE.levers}
    return SPACE.deployment({names[name]: place for name, place in places.items()})


def margin(
    excess: float, limit: float = 0.05, text: str = "latency.p99 < 50 ms"
) -> RequirementMargin:
    """A requirement by how much it misses its limit."""
    estimate = math.inf if excess >= MAX_EXCESS else limit * math.exp(excess)
    return RequirementMargin(
        text=text,
        outcome="pass" if excess <= 0 else "fail",
        estimate=estimate,
        limit=limit,
        unit="s",
        excess=excess,
    )


def trial(number: int, where: Deployment, cost: float | None, excess: float, **rest: Any) -> Trial:
    """A trial with one requirement."""
    state = "meets" if excess <= 0 else "misses"
    fields: dict[str, Any] = {
        "state": state,
        "margins": (margin(excess),),
        "starts": 3,
        "duration_s": 12.5,
    }
    return Trial(number=number, deployment=where, cost=cost, **(fields | rest))


def gain(lever: str, ratio: float | None, half: float = 0.04, **rest: Any) -> Gain:
    """A gain in CPU from a half-width of its interval, as a logarithm."""
    before = 1.2
    return Gain(
        **{
            "change": lever or "all",
            "lever": lever,
            "metric": GOAL,
            "unit": "share",
            "before": before,
            "after": None if ratio is None else before * ratio,
            "ratio": ratio,
            "lower": None if ratio is None else ratio * math.exp(-half),
            "upper": None if ratio is None else ratio * math.exp(half),
            "pairs": 8,
            **rest,
        }
    )


def improved(**changes: Any) -> TuningResult:
    """A search that found a deployment that costs less."""
    winner = deployment(placement=1, threads=2)
    fields: dict[str, Any] = {
        "name": "robot",
        "title": "A robot that looks at tags",
        "goal": GOAL,
        "goal_unit": "share",
        "outcome": "improved",
        "reason": (
            "The deployment meets the objectives: cpu.graph.mean at 30 Hz -28 % (-31 to -25), "
            "8 pairs."
        ),
        "space": SPACE,
        "trials": (
            trial(0, deployment(), 1.2, -0.1),
            trial(1, deployment(placement=1), 0.95, -0.2),
            trial(2, deployment(threads=1), 1.1, 0.12, reason="latency.p99 < 50 ms"),
            trial(3, deployment(scheduling=1), None, 0.0, state="broken", margins=(), starts=1,
                  reason="process detector ended with status 1"),
            trial(4, deployment(placement=1, threads=2), 0.84, -0.3, run="trials/004"),
            trial(5, deployment(placement=1, scheduling=1), 0.9, MAX_EXCESS,
                  reason="every message was lost"),
            trial(6, deployment(threads=2), None, 0.0, state="refused", margins=(), starts=0,
                  reason="more threads than cores"),
        ),
        "winner": winner,
        "proof": gain("", 0.72),
        "requirements": (margin(-0.3),),
        "levers": (gain("graph.placement", 0.78), gain("graph.nodes.detector.threads", 0.93, 0.09)),
        "dropped": (gain("graph.nodes.detector.scheduling", 1.01),),
        "unproven": 0.84,
        "for_others": ("detector runs before every usual process of this machine.",),
        "predicted": ("graph.placement: shared with 1 thread: p99 of 80 ms (70 to 95)",),
        "notes": ("2 trials were cut short by the budget.",),
        "seed": 7,
        "budget_s": 1200.0,
        "duration_s": 1103.0,
        "started_at": "2026-03-01T12:00:00+00:00",
        "machine": {"cpu": "Cortex-A78", "cores": 4},
    }  # fmt: skip
    return TuningResult(**(fields | changes))


def not_met(**changes: Any) -> TuningResult:
    """A search in which every deployment misses a requirement."""
    trials = (
        trial(0, deployment(), 1.2, 0.4, reason="latency.p99 < 50 ms"),
        trial(1, deployment(placement=1), 0.95, 0.12, reason="latency.p99 < 50 ms",
              anatomy="detector: callback takes 41 ms of 56 ms"),
        trial(2, deployment(threads=1), 1.1, 0.2, state="open", reason="its starts do not decide"),
    )  # fmt: skip
    fields: dict[str, Any] = {
        "outcome": "not met",
        "reason": (
            "None of 3 deployments meets the objectives; the nearest, graph.placement: shared, "
            "misses latency.p99 < 50 ms by 13 %; detector: callback takes 41 ms of 56 ms."
        ),
        "trials": trials,
        "winner": None,
        "proof": None,
        "requirements": (),
        "levers": (),
        "dropped": (),
        "unproven": None,
        "for_others": (),
    }
    return improved(**(fields | changes))


def hostile() -> TuningResult:
    """A result whose every text does harm where it is shown as it is."""
    bad = Setting(text=HOSTILE, sets=(f"title={HOSTILE}",), for_others=HOSTILE)
    space = TuningSpace(
        levers=(Lever(name=HOSTILE, settings=(Setting(text="x"), bad)),), left_out=(HOSTILE,)
    )
    where = Deployment((Choice(lever=HOSTILE, place=1, setting=bad),))
    one = trial(1, where, 0.5, -0.1, reason=HOSTILE, anatomy=HOSTILE,
                margins=(margin(-0.1, text=HOSTILE),))  # fmt: skip
    return improved(
        name=HOSTILE,
        title=HOSTILE,
        goal=HOSTILE,
        reason=HOSTILE,
        space=space,
        trials=(trial(0, Deployment(), 1.0, 0.1, reason=HOSTILE), one),
        winner=where,
        proof=gain("", 0.5, change=HOSTILE, metric=HOSTILE),
        requirements=(margin(-0.1, text=HOSTILE),),
        levers=(gain(HOSTILE, 0.5, change=HOSTILE),),
        dropped=(gain(HOSTILE, 1.0, change=HOSTILE),),
        for_others=(HOSTILE,),
        predicted=(HOSTILE,),
        notes=(HOSTILE,),
        machine={HOSTILE: HOSTILE},
    )
