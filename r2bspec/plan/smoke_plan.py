"""The plan of a smoke run: a short iteration, which shows that everything is connected."""

from __future__ import annotations

from typing import Final

import msgspec

from r2bspec.language.quantities import Duration
from r2bspec.language.spec import StartWaits
from r2bspec.plan.plan import Plan, PlayPlan

_ITERATION_NS: Final = 2_000_000_000
_WAIT: Final = Duration(500_000_000)
_LEFT_OUT: Final = frozenset({"search", "sustained", "play"})
"""Phases of a run to be judged; ``play`` comes back, and may come where there was only a search."""


def smoke_plan(plan: Plan) -> Plan:
    """Return the plan with a short iteration at its lowest rate, without probes.

    Nothing is judged. Its objectives have the level `off`, which those of no other plan have: see
    `is_smoke_plan`.
    """
    play = min(plan.play, key=lambda each: each.rate_hz) if plan.play else _lowest_of_search(plan)
    once = msgspec.structs.replace(
        play, duration_ns=min(play.duration_ns, _ITERATION_NS), iterations=1, max_iterations=0
    )
    phases = [phase for phase in plan.phases if phase not in _LEFT_OUT]
    phases.insert(phases.index("collect"), "play")
    return msgspec.structs.replace(
        plan,
        title=f"{plan.title or plan.name} (smoke run: nothing is judged)",
        play=(once,),
        play_at_peak=None,
        search=None,
        sustained_hz=(),
        objectives={
            name: msgspec.structs.replace(objective, level="off")
            for name, objective in plan.objectives.items()
        },
        starts=1,
        phases=tuple(phases),
        gate=msgspec.structs.replace(plan.gate, confirm=False),
        **{name: min(wait, _WAIT) for name, wait in StartWaits.fields_of(plan).items()},
    )


def is_smoke_plan(plan: Plan) -> bool:
    """Return True if a plan has objectives that a smoke run does not judge."""
    return bool(plan.objectives) and all(
        objective.level == "off" for objective in plan.objectives.values()
    )


def _lowest_of_search(plan: Plan) -> PlayPlan:
    """Return an iteration at the lowest rate of the search or of `sustained`."""
    rates = [*plan.sustained_hz, *((plan.search.min_hz,) if plan.search is not None else ())]
    return PlayPlan(rate_hz=min(rates, default=0.0), duration_ns=_ITERATION_NS, iterations=1)
