"""Requests of services and goals of actions: whether their fields fit the installed type."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, rule, value_key
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import quote, suggestion
from r2bspec.language.spec import Spec
from r2bspec.plan.installed_interfaces import fields_of_message, installed_fields
from r2bspec.plan.request_fields import FieldMistake, field_mistakes


class StatedCall(NamedTuple):
    """A service or an action that a spec calls.

    Attributes:
        path: of the service or the action.
        type: such as ``std_srvs/srv/SetBool``.
        part: the end of the name of the type of its requests: ``_Request`` or ``_Goal``.
        requests: the fields that are given, each with its place.
        success: the field of the response that says whether it counts, with its place; if given.
    """

    path: Path
    type: str
    part: str
    requests: tuple[tuple[Path, Mapping[str, Any]], ...]
    success: tuple[Path, str] | None = None


def stated_calls(spec: Spec) -> Iterator[StatedCall]:
    """Every service and action that a spec calls."""
    for name, call in spec.playback.calls.items():
        top: Path = ("playback", "calls", name)
        each = tuple(((*top, "each", index), fields) for index, fields in enumerate(call.each))
        if call.service is not None:
            path = (*top, "service")
            requests = (((*path, "request"), call.service.request), *each)
            success = ((*top, "success"), call.success) if call.success else None
            yield StatedCall(path, call.service.type, "_Request", requests, success)
        elif call.action is not None:
            path = (*top, "action")
            goals = (((*path, "goal"), call.action.goal), *each)
            yield StatedCall(path, call.action.type, "_Goal", goals)
    for name, step in spec.after_ready.items():
        if step.service is not None:
            path = ("after_ready", name, "service")
            request = ((*path, "request"), step.service.request)
            yield StatedCall(path, step.service.type, "_Request", (request,))


@rule("R2B240")
def request_field_unfit(context: Context) -> Findings:
    """Fields of requests that the type of the service or the action does not have, or not so."""
    for call in stated_calls(context.spec):
        fields = installed_fields(f"{call.type}{call.part}")
        for place, values in call.requests if fields is not None else ():
            for mistake in field_mistakes(values, fields or {}, fields_of_message):
                yield _finding(call, place, mistake)
        answer = installed_fields(f"{call.type}_Response") if call.success is not None else None
        if call.success is not None and answer is not None:
            path, field = call.success
            if answer.get(field) != "boolean":
                flags = sorted(name for name, kind in answer.items() if kind == "boolean")
                yield Finding(
                    message=f"the response of {call.type} has no field {quote(field)} that is true "
                    "or false",
                    path=path,
                    help=suggestion(field, flags, "such fields") if flags else "remove 'success'",
                    machine_dependent=True,
                    suppressed_by={value_key((*call.path, "type"))},
                )


def _finding(call: StatedCall, place: Path, mistake: FieldMistake) -> Finding:
    what = "goal" if call.part == "_Goal" else "request"
    return Finding(
        message=f"{mistake.where} in a {what} of {call.type}: {mistake.message}",
        path=(*place, *mistake.path),
        key=mistake.is_name,
        help=mistake.help,
        machine_dependent=True,
        suppressed_by={value_key((*call.path, "type"))},
    )
