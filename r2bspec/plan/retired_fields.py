"""Fields that plans of earlier versions have: a plan is read without them, or refused with them.

Earlier plans could name the harness ``ros2_benchmark`` and its components, and give parameters to
monitors. No version has run such a plan; every other plan has these fields with their defaults.
"""

from __future__ import annotations

from typing import Any

import msgspec

from r2bspec.plan.errors import PLAN_UNSUPPORTED, PlanError
from r2bspec.untrusted.safe_json import decode_json

_OF_HARNESS = ("kind", "data_loader", "playback", "monitor")
_OF_MONITORS = ("parameters",)


class _Document(msgspec.Struct):
    """The parts of a plan that had such fields."""

    harness: dict[str, Any] = {}
    monitors: tuple[dict[str, Any], ...] = ()


def without_retired_fields(data: bytes, name: str) -> bytes:
    """The JSON of a plan without fields that this version does not have.

    Args:
        data: the JSON, of which it is known that it is a plan.
        name: its name in messages.

    Raises:
        PlanError: the plan uses such a field.
        msgspec.DecodeError: it is no plan.
    """
    document = decode_json(data, _Document)
    if document.harness.get("kind", "r2bspec") != "r2bspec":
        raise PlanError(
            f"{name} needs the harness {document.harness['kind']!r}, which this version does not "
            "have",
            code=PLAN_UNSUPPORTED,
            hint="Write 'harness: {placement: graph}' in the spec instead, and make a new plan.",
        )
    if not _has_any(document.harness, _OF_HARNESS) and not any(
        _has_any(each, _OF_MONITORS) for each in document.monitors
    ):
        return data
    whole = decode_json(data, dict[str, Any])
    whole["harness"] = _without(document.harness, _OF_HARNESS)
    whole["monitors"] = [_without(each, _OF_MONITORS) for each in document.monitors]
    return msgspec.json.encode(whole)


def _has_any(values: dict[str, Any], names: tuple[str, ...]) -> bool:
    return any(each in values for each in names)


def _without(values: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key not in names}
