"""Comparing plans: their differences, and whether they measure the same.

A difference means another load, another graph, or neither. That follows from the declaration of the
key that corresponds to a field of a plan (`r2bspec.language.declaration`), so a new key needs no
change here.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

import msgspec

from r2bspec.diagnostics.diagnostic import Path, format_path
from r2bspec.diagnostics.quote import clip
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.language.declaration import Change, change_at, encode_text, rule_at
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.plan import GatePlan, Plan, PlayPlan


class IncomparableError(R2bspecError):
    """Two measurements differ in more than their numbers."""

    code = "R2B663"
    exit_code = ExitStatus.USAGE


ABSENT: Final = object()
"""The value of an absent member."""

# Members of these lists are compared by identity instead of position, so that an additional process
# does not make all following ones differ.
_IDENTITY_KEYS: Final = {
    "bag topics": ("bag_topic",),
    "calls": ("name",),
    "inputs": ("topic",),
    "monitors": ("name",),
    "nodes": ("name",),
    "play": ("rate_hz",),
    "processes": ("name",),
    "topics": ("phase", "name"),
}


class PlanDifference(NamedTuple):
    """A different value, as JSON values; `ABSENT` if one plan does not have it."""

    path: Path
    before: Any
    after: Any

    def __str__(self) -> str:
        return f"{format_path(self.path)}: {_json_text(self.before)} -> {_json_text(self.after)}"


def diff_plans(before: Plan, after: Plan) -> list[PlanDifference]:
    """Return all differences of two plans, in the order of the fields; empty if they are equal."""
    return list(_diff((), _builtins(before), _builtins(after)))


def _builtins(plan: Plan) -> Any:
    return msgspec.to_builtins(plan, enc_hook=encode_text)


def _diff(path: Path, before: Any, after: Any) -> Iterator[PlanDifference]:
    if isinstance(before, dict) and isinstance(after, dict):
        for key in dict.fromkeys((*before, *after)):
            yield from _diff((*path, key), before.get(key, ABSENT), after.get(key, ABSENT))
    elif isinstance(before, list | tuple) and isinstance(after, list | tuple):
        yield from _diff_lists(path, before, after)
    # 1, 1.0 and true are equal to Python, but not to ROS.
    elif type(before) is not type(after) or before != after:
        yield PlanDifference(path, before, after)


def _diff_lists(path: Path, before: Any, after: Any) -> Iterator[PlanDifference]:
    old, new = _by_identity(path, before), _by_identity(path, after)
    if old is None or new is None:
        old, new = dict(enumerate(before)), dict(enumerate(after))
    for key in dict.fromkeys((*old, *new)):
        yield from _diff((*path, key), old.get(key, ABSENT), new.get(key, ABSENT))
    kept_before = [key for key in old if key in new]
    kept_after = [key for key in new if key in old]
    if kept_before != kept_after:
        yield PlanDifference((*path, "order"), kept_before, kept_after)


def _by_identity(path: Path, members: Any) -> dict[str | int, Any] | None:
    """Return the members by identity; None if they have none, or if one occurs twice."""
    keys = _IDENTITY_KEYS.get("bag topics" if path[:1] == ("dataset",) else str(path[-1]))
    if keys is None or not all(isinstance(member, dict) for member in members):
        return None
    by_name: dict[str | int, Any] = {
        " ".join(str(member.get(key)) for key in keys): member for member in members
    }
    return by_name if len(by_name) == len(members) else None


def _json_text(value: Any) -> str:
    return "(absent)" if value is ABSENT else json.dumps(value, ensure_ascii=False)


_SECTIONS: Final[tuple[Path, ...]] = ((), ("benchmark",), ("playback",))
"""Where the key is that has the name of a field of a plan, which shows it."""

_SHOWN_KEYS: Final[Mapping[str, Path]] = {
    "dataset": ("data_loader",),
    "datasets": ("data_loader",),
    "playback_mode": ("playback", "mode"),
    "segment_bytes": ("transport", "segment"),
    "external": ("graph", "nodes"),
    "latched": ("playback", "inputs"),
    "lifecycle": ("graph", "nodes"),
    "processes": ("graph",),
    "topics": ("graph",),
    "objectives": ("slos",),
    "play": ("benchmark", "rates"),
    "play_at_peak": ("benchmark", "duration"),
}
"""The key of the language that a field of another name shows."""

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
    """Return what a difference in a field of a plan means: another load, another graph, or neither.

    It follows from the declaration of the key that corresponds to the field
    (`r2bspec.language.declaration`).

    Raises:
        KeyError: nobody has said which key that is.
    """
    if field in _OTHER_FIELDS:
        return _OTHER_FIELDS[field]
    named_alike = ((*section, field) for section in _SECTIONS if rule_at((*section, field)))
    return change_at(_SHOWN_KEYS.get(field) or next(named_alike, (field,)))


_MAX_PATH, _MAX_VALUE = 60, 24
"""The most characters of a path and of a value in a brief difference: both fit on a line."""


def measured_hash(plan: Plan) -> str:
    """Return the hash of the plan without texts, objectives and gate, for the measurement."""
    bare = msgspec.structs.replace(
        _without_texts(plan), objectives={}, gate=GatePlan(), requires=msgspec.UNSET
    )
    return f"sha256:{hashlib.sha256(canonical_json(bare)).hexdigest()}"


def _without_texts(plan: Plan) -> Plan:
    """Return the plan without what only reports show."""
    monitors = tuple(msgspec.structs.replace(monitor, label="") for monitor in plan.monitors)
    return msgspec.structs.replace(plan, title="", description="", labels={}, monitors=monitors)


def _measured_differences(base: Plan, head: Plan) -> list[PlanDifference]:
    return diff_plans(_without_texts(base), _without_texts(head))


def load_differences(base: Plan, head: Plan) -> list[PlanDifference]:
    """Return the differences of two plans in the load or the harness, not in the graph."""
    differences = _measured_differences(base, head)
    return [difference for difference in differences if _change(difference) == "load"]


def graph_differences(base: Plan, head: Plan) -> list[PlanDifference]:
    """Return the differences of two plans that may affect the measurement, each once.

    Parameters of a node also occur in the command line of its process.
    """
    differences = [
        difference
        for difference in _measured_differences(base, head)
        if _change(difference) != "neither"
    ]
    changed: dict[str, set[str]] = defaultdict(set)
    for difference in differences:
        match difference.path:
            case ("processes", process, "nodes", _, "parameters", name, *_):
                changed[str(process)].add(str(name))
    before, after = ({each.name: each.argv for each in plan.processes} for plan in (base, head))
    repeating = {
        process
        for process, names in changed.items()
        if _without_parameters(before.get(process, ()), names)
        == _without_parameters(after.get(process, ()), names)
    }
    return [
        difference
        for difference in differences
        if difference.path[2:3] != ("argv",) or difference.path[1] not in repeating
    ]


def _without_parameters(argv: Sequence[str], names: Collection[str]) -> tuple[str, ...]:
    """Return a command line without its ``-p NAME:=VALUE`` of these parameters."""
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
    """Return the plan of a run of a pair: an iteration per rate in one start, no confirmation.

    Pairs replace iterations and starts: each run of a pair is a start of its own. The peak search
    takes the most time, so it is included only if an objective needs the peak.
    """
    searched = any(
        objective.at_peak
        or any(requirement.metric == "peak.rate" for requirement in objective.require)
        for objective in plan.objectives.values()
    )
    at_peak = plan.play_at_peak
    return msgspec.structs.replace(
        plan,
        play=tuple(_single_iteration(play) for play in plan.play),
        play_at_peak=_single_iteration(at_peak) if at_peak is not None else None,
        starts=1,
        search=plan.search if searched else None,
        phases=tuple(phase for phase in plan.phases if searched or phase != "search"),
        gate=msgspec.structs.replace(plan.gate, confirm=False, time_budget_ns=0),
    )


def _single_iteration(play: PlayPlan) -> PlayPlan:
    return msgspec.structs.replace(play, iterations=1, max_iterations=0)


def pair_count(plan: Plan) -> int:
    """Return the number of pairs of a plan: its number of iterations."""
    return max((play.iterations for play in plan.plays), default=1)


def difference_lines(differences: list[PlanDifference], max_lines: int = 12) -> Iterator[str]:
    """Yield the differences, one per line; after `max_lines`, the number of the others."""
    yield from (str(difference) for difference in differences[:max_lines])
    if len(differences) > max_lines:
        yield f"{len(differences) - max_lines} more differences"


def brief_difference(difference: PlanDifference) -> str:
    """Return a difference in at most a line: added and removed values are named, not printed."""
    path = format_path(difference.path)
    # Of a long path the end is shown, which says most.
    path = clip(path if len(path) <= _MAX_PATH else "…" + path[1 - _MAX_PATH :], _MAX_PATH)
    if difference.before is ABSENT:
        return f"{path}: only in the head{_brief_value(difference.after)}"
    if difference.after is ABSENT:
        return f"{path}: only in the base{_brief_value(difference.before)}"
    before, after = _json_text(difference.before), _json_text(difference.after)
    # A common beginning that would hide the difference is left out, but for a few characters.
    alike = os.path.commonprefix([before, after])  # noqa: RUF071 - of characters
    start = len(alike) - _MAX_VALUE // 3
    if max(len(before), len(after)) > _MAX_VALUE and start > 1:
        before, after = f"…{before[start:]}", f"…{after[start:]}"
    return f"{path}: {clip(before, _MAX_VALUE)} -> {clip(after, _MAX_VALUE)}"


def _brief_value(value: Any) -> str:
    """Return the value after a colon, unless it is a map or a list."""
    if isinstance(value, dict | list | tuple):
        return ""
    return f": {clip(_json_text(value), _MAX_VALUE)}"
