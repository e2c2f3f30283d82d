"""Comparing plans: whether they measure the same, and the plan of one run of a pair."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, Final

import msgspec

from r2bspec.diagnostics.diagnostic import format_path
from r2bspec.diagnostics.quote import clip
from r2bspec.language.declaration import Change, change_at
from r2bspec.language.spec import Objective, Pacing
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.plan import GatePlan, Plan, PlayPlan
from r2bspec.plan.plan_diff import ABSENT, PlanDifference, diff_plans

_SHOWN_KEYS: Final[Mapping[str, str]] = {
    **{name: name for name in ("name", "title", "description", "labels", "namespace")},
    **{name: name for name in ("environment", "transport", "harness", "setup", "ready")},
    **{name: name for name in ("after_ready", "monitors", "requires")},
    "dataset": "data_loader",
    "datasets": "data_loader",
    "playback_mode": "playback.mode",
    "buffer": "playback.buffer",
    "inputs": "playback.inputs",
    "timeline": "playback.timeline",
    "unpaired": "playback.unpaired",
    "clock": "playback.clock",
    "segment_bytes": "transport.segment",
    "external": "graph.nodes",
    "processes": "graph",
    "topics": "graph",
    "objectives": "slos",
    "play": "benchmark.rates",
    "play_at_peak": "benchmark.duration",
    "search": "benchmark.search",
    "starts": "benchmark.starts",
    "gate": "benchmark.gate",
}
"""The key of the language that a field of a plan shows; those of `Pacing` are keys themselves."""

_OTHER_FIELDS: Final[Mapping[str, Change]] = {
    "r2bspec_plan": "graph",
    "generator": "neither",
    "largest_message_bytes": "graph",
    "phases": "graph",
    "sustained_hz": "graph",
}
"""What a difference means in fields that show no single key."""


@cache
def change_of(field: str) -> Change:
    """What a difference in a field of a plan means: another load, another graph, or neither.

    It follows from the declaration of the key that the field shows
    (`r2bspec.language.declaration`).

    Raises:
        KeyError: nobody has said which key that is.
    """
    if field in Pacing.__struct_fields__:
        return change_at(("benchmark", field))
    if field in _OTHER_FIELDS:
        return _OTHER_FIELDS[field]
    return change_at(tuple(_SHOWN_KEYS[field].split(".")))


_MAX_PATH, _MAX_VALUE = 60, 24
"""The most characters of a path and of a value in a brief difference: both fit on a line."""


def measured_hash(plan: Plan) -> str:
    """The hash of the plan without texts, objectives and gate: identifies the measurement."""
    bare = msgspec.structs.replace(
        plan,
        objectives={},
        title="",
        description="",
        labels={},
        gate=GatePlan(),
        requires=msgspec.UNSET,
    )
    return f"sha256:{hashlib.sha256(canonical_json(bare)).hexdigest()}"


def load_differences(base: Plan, head: Plan) -> list[PlanDifference]:
    """The differences in the load or the harness of two plans, not in the graph under test."""
    return [each for each in diff_plans(base, head) if _change(each) == "load"]


def graph_differences(base: Plan, head: Plan) -> list[PlanDifference]:
    """The differences of two plans that may affect the measurement, each once.

    Parameters of a node stand in the command line of its process, too.
    """
    differences = [each for each in diff_plans(base, head) if _change(each) != "neither"]
    changed: dict[object, set[str]] = defaultdict(set)
    for difference in differences:
        match difference.path:
            case ("processes", process, "nodes", _, "parameters", name, *_):
                changed[process].add(str(name))
    arguments = [
        {process.name: process.argv for process in plan.processes} for plan in (base, head)
    ]
    repeating = {
        process
        for process, names in changed.items()
        if len({_without_parameters(each.get(str(process), ()), names) for each in arguments}) == 1
    }
    return [
        difference
        for difference in differences
        if difference.path[2:3] != ("argv",) or difference.path[1] not in repeating
    ]


def _without_parameters(argv: Sequence[str], names: Collection[str]) -> tuple[str, ...]:
    """A command line without its ``-p NAME:=VALUE`` of these parameters."""
    left: list[str] = []
    words = iter(argv)
    for word in words:
        value = next(words, "") if word == "-p" else ""
        if value.partition(":=")[0] not in names:
            left += [word, value]
    return tuple(left)


def _change(difference: PlanDifference) -> Change:
    return change_of(str(difference.path[0]))


def single_run_plan(plan: Plan) -> Plan:
    """The plan of one run of a pair: one iteration per rate in one start, without a confirmation.

    Pairs replace iterations and starts: each run of a pair is a start of its own. The peak search
    takes the most time, so it is included only if an objective needs the peak.
    """
    searched = any(_wants_peak(each) for each in plan.objectives.values())
    at_peak = plan.play_at_peak
    return msgspec.structs.replace(
        plan,
        play=tuple(_single_iteration(each) for each in plan.play),
        play_at_peak=_single_iteration(at_peak) if at_peak is not None else None,
        starts=1,
        search=plan.search if searched else None,
        phases=tuple(each for each in plan.phases if searched or each != "search"),
        gate=msgspec.structs.replace(plan.gate, confirm=False, time_budget_ns=0),
    )


def _single_iteration(play: PlayPlan) -> PlayPlan:
    return msgspec.structs.replace(play, iterations=1, max_iterations=0)


def _wants_peak(objective: Objective) -> bool:
    return objective.at_peak or any(each.metric == "peak.rate" for each in objective.require)


def pair_count(plan: Plan) -> int:
    """The number of pairs of a plan: its number of iterations, at least one."""
    plays = (*plan.play, *([plan.play_at_peak] if plan.play_at_peak else []))
    return max((each.iterations for each in plays), default=1)


def difference_lines(differences: list[PlanDifference], max_lines: int = 12) -> Iterator[str]:
    """The differences, one per line, limited to `max_lines` and a count of the others."""
    yield from (str(each) for each in differences[:max_lines])
    if len(differences) > max_lines:
        yield f"{len(differences) - max_lines} more differences"


def brief_difference(each: PlanDifference) -> str:
    """A difference in at most a line: what was added or removed is named, not printed."""
    path = _end_of(format_path(each.path))
    if each.before is ABSENT:
        return f"{path}: only in the head{_brief_value(each.after)}"
    if each.after is ABSENT:
        return f"{path}: only in the base{_brief_value(each.before)}"
    before, after = (
        clip(json.dumps(value, ensure_ascii=False), _MAX_VALUE)
        for value in (each.before, each.after)
    )
    return f"{path}: {before} -> {after}"


def _end_of(path: str) -> str:
    """A path, or its end, which says most."""
    if len(path) <= _MAX_PATH:
        return clip(path, _MAX_PATH)
    return clip("…" + path[1 - _MAX_PATH :], _MAX_PATH)


def _brief_value(value: Any) -> str:
    """The value after a colon, unless it is a map or a list."""
    if isinstance(value, dict | list | tuple):
        return ""
    return f": {clip(json.dumps(value, ensure_ascii=False), _MAX_VALUE)}"
