"""Service calls in the hooks of a script, as steps of a spec: `after_ready`."""

from __future__ import annotations

import re
from typing import Any

from r2bspec.interop.script_import.evaluator import Note
from r2bspec.interop.script_import.script_values import Construct, Foreign, Place, Unknown
from r2bspec.interop.script_import.spec_values import NoValueError, SpecValues

_CLIENTS = frozenset({"create_service_client_blocking", "create_client"})
_CALLS = frozenset({"call", "call_async"})
_TYPE = re.compile(r"(?P<package>\w+)\.srv(?:\._\w+)?\.(?P<name>\w+)\Z")


def is_service_call(effect: Construct) -> bool:
    """Whether a construct calls a service through a client that the script has created."""
    owner = effect.owner
    return effect.short_name in _CALLS and owner is not None and owner.short_name in _CLIENTS


def service_step(effect: Construct, values: SpecValues) -> dict[str, Any]:
    """The keys of ``service`` for a call.

    Raises:
        NoValueError: a part of it is not determined by the script.
    """
    client = effect.owner
    if client is None or effect.condition is not None:
        raise NoValueError(Note("it depends on a condition", effect.place))
    kind = client.get("srv_type", 0, client.get("service_type"))
    found = _TYPE.search(kind.name) if isinstance(kind, Foreign) else None
    if found is None:
        raise NoValueError(Note("the type of the service is not known", client.place))
    name = client.get("srv_name", 1, client.get("service_name"))
    # The tool resolves names in the namespace of the benchmark, rclpy in that of its own node.
    in_namespace = client.short_name == "create_service_client_blocking"
    if not isinstance(name, str) or not (in_namespace or name.startswith("/")):
        raise NoValueError(Note("the full name of the service is not known", client.place))
    step = {"name": values.text(name), "type": f"{found['package']}/srv/{found['name']}"}
    request = _fields(effect.get("request", 0), values, effect.place)
    return step | ({"request": request} if request else {})


def _fields(message: Any, values: SpecValues, place: Place) -> dict[str, Any]:
    """The fields of a message that the script sets; the others have their defaults."""
    if isinstance(message, Unknown):
        raise NoValueError(Note(message.reason, message.place))
    if not isinstance(message, Construct) or not message.is_message or message.arguments:
        raise NoValueError(Note("the request is not known", place))
    found = {name: _field(each, values, place) for name, each in message.keywords.items()}
    return {name: each for name, each in found.items() if each != {}}


def _field(value: Any, values: SpecValues, place: Place) -> Any:
    if isinstance(value, Construct):
        return _fields(value, values, place)
    if isinstance(value, list | tuple):
        return [_field(each, values, place) for each in value]
    return values.convert(value, place)
