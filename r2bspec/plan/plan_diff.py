"""The differences of two plans."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import msgspec

from r2bspec.diagnostics.diagnostic import Path, format_path
from r2bspec.language.declaration import encode_text
from r2bspec.plan.plan import Plan


class _Absent:
    """The value of an absent member."""

    def __repr__(self) -> str:
        return "(absent)"


ABSENT: Final = _Absent()

# Members of these lists are compared by identity instead of position, so that an additional process
# does not make all following ones differ.
_IDENTITY_KEYS: Final = {
    "bag topics": ("bag_topic",),
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
    """All differences of two plans, in the order of the fields; empty if they are equal."""
    return list(_diff((), _builtins(before), _builtins(after)))


def _builtins(plan: Plan) -> Any:
    return msgspec.to_builtins(plan, enc_hook=encode_text)


def _diff(path: Path, before: Any, after: Any) -> Iterator[PlanDifference]:
    if isinstance(before, dict) and isinstance(after, dict):
        yield from _diff_maps(path, before, after)
        return
    if isinstance(before, list | tuple) and isinstance(after, list | tuple):
        yield from _diff_lists(path, before, after)
    # 1, 1.0 and true are equal to Python, but not to ROS.
    elif type(before) is not type(after) or before != after:
        yield PlanDifference(path, before, after)


def _diff_maps(
    path: Path, before: dict[str, Any], after: dict[str, Any]
) -> Iterator[PlanDifference]:
    for key in dict.fromkeys((*before, *after)):
        yield from _diff((*path, key), before.get(key, ABSENT), after.get(key, ABSENT))


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
    """The members by identity; None if they have none, or if one occurs twice."""
    keys = _IDENTITY_KEYS.get("bag topics" if path[:1] == ("dataset",) else str(path[-1]))
    if keys is None or not all(isinstance(each, dict) for each in members):
        return None
    found: dict[str | int, Any] = {
        " ".join(str(each.get(key)) for key in keys): each for each in members
    }
    return found if len(found) == len(members) else None


def _json_text(value: Any) -> str:
    return repr(value) if value is ABSENT else json.dumps(value, ensure_ascii=False)
