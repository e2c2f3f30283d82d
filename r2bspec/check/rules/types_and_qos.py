"""Messages that do not arrive although the topic is right: their type, and their QoS.

ROS connects a publisher to a subscription only if both have the same type and compatible QoS, and
says nothing where they have not. The types that a spec states itself must exist, too, and the
fields of its requests and goals must fit them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

from r2bspec.bags import message_types
from r2bspec.check.check_context import Context
from r2bspec.check.rule import (
    Finding,
    Findings,
    Pointer,
    flow_key,
    rule,
    topic_key,
    value_key,
    with_endpoint_records,
)
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import did_you_mean, quote, suggestion
from r2bspec.language.spec import Spec
from r2bspec.plan.installed_interfaces import fields_of_message, installed_fields, installed_types
from r2bspec.plan.installed_packages import ros_package_advice
from r2bspec.plan.request_fields import FieldMistake, field_mistakes
from r2bspec.plan.this_machine import find_module
from r2bspec.plan.wiring.wiring import PhaseWiring, WiredEndpoint


@rule("R2B202")
def message_type_unknown(context: Context) -> Findings:
    """Message types that the common interfaces do not contain."""
    for path, name in _stated_types(context).items():
        about = {value_key(path)}
        siblings = message_types.types_of_same_package(name)
        if name in siblings:
            continue
        package = name.partition("/")[0]
        close = did_you_mean(name, siblings or message_types.common_types())
        if siblings and not close:
            yield Finding(
                message=f"package {package} of ROS 2 Jazzy has no message type {quote(name)}",
                path=path,
                severity="warning",
                machine_dependent=True,
                suppresses=about,
            )
        elif siblings or close.partition("/")[2] == name.partition("/")[2]:
            # The user may have a package of this name, but cannot add messages to a common package.
            yield Finding(
                message=f"unknown message type {quote(name)}"
                if siblings
                else f"{quote(name)} resembles {quote(close)} of the common interfaces",
                path=path,
                help=f"did you mean {quote(close)}?",
                severity=None if siblings else "warning",
                suppresses=about,
            )


def _stated_types(context: Context) -> dict[Path, str]:
    """Every message type that the spec states, by its path."""
    endpoints = (endpoint for phase in context.wiring.phases for endpoint in phase.endpoints)
    return {
        endpoint.type_path: endpoint.type
        for endpoint in endpoints
        if endpoint.type_path and endpoint.type
    }


@rule("R2B210")
def message_type_mismatch(context: Context) -> Findings:
    """Topics whose publishers and subscriptions have different types."""
    reported: set[Path] = set()
    confirmed = _confirmed(context)
    for phase in context.wiring.phases:
        for topic in phase.topics:
            typed = sorted(
                (
                    endpoint
                    for endpoint in (*phase.publishers(topic), *phase.subscriptions(topic))
                    if endpoint.type
                ),
                key=lambda endpoint: (
                    0 if endpoint.type_path in confirmed else _uncertainty(endpoint)
                ),
            )
            for endpoint in typed[1:]:
                place = endpoint.type_path or endpoint.path
                if endpoint.type != typed[0].type and place not in reported:
                    reported.add(place)
                    finding = _type_finding(context, phase, typed[0], endpoint)
                    yield with_endpoint_records(context, phase, finding, typed[0], endpoint)


def _confirmed(context: Context) -> set[Path]:
    """The paths of formats of playback inputs that equal the type of the bag or preprocessor."""
    phase = context.wiring.preprocess
    return {
        endpoint.type_path
        for endpoint in phase.endpoints_of("recorder")
        if any(publisher.type == endpoint.type for publisher in phase.publishers(endpoint.topic))
    }


def _uncertainty(endpoint: WiredEndpoint) -> int:
    """Rank of an endpoint's type: the bag is certain, a format is only stated."""
    if endpoint.owner == "loader":
        return 0
    if not endpoint.is_node:
        return 3
    return 2 if endpoint.type_path or endpoint.type_parameter else 1


def _type_finding(
    context: Context, phase: PhaseWiring, trusted: WiredEndpoint, wrong: WiredEndpoint
) -> Finding:
    topic = quote(context.relative_name(trusted.topic))
    place = wrong.type_path or wrong.path
    if trusted.owner == "loader":
        bag_topic = trusted.path[-1]
        fact = f"{bag_topic} in the bag is {trusted.type}"
        related = Pointer(f"loaded as {topic} here", trusted.path)
    else:
        fact = f"{_endpoint_label(trusted)} {_verb(trusted)} {topic} as {trusted.type}"
        related = Pointer(
            "publisher" if trusted.is_publisher else "subscription",
            trusted.type_path or trusted.path,
            trusted.topic_is_key and not trusted.type_path,
        )
    return Finding(
        message=f"{_mismatch_text(wrong, topic)}, but {fact}",
        path=place,
        key=wrong.topic_is_key and not wrong.type_path,
        help=_type_help(trusted, wrong),
        related=(related,),
        suppressed_by={topic_key(phase.phase, trusted.topic), value_key(place)},
        suppresses={flow_key(phase.phase), value_key(place)},
    )


def _mismatch_text(wrong: WiredEndpoint, topic: str) -> str:
    if wrong.is_node:
        return f"{_endpoint_label(wrong)} {_verb(wrong)} {topic} as {wrong.type}"
    return f"the format of {topic} is {wrong.type}"


def _type_help(trusted: WiredEndpoint, wrong: WiredEndpoint) -> str:
    if wrong.type_parameter:
        return f"set its parameter {quote(wrong.type_parameter)} to {trusted.type}"
    return "" if wrong.is_node else f"write {trusted.type}, or use another topic"


def _endpoint_label(endpoint: WiredEndpoint) -> str:
    if endpoint.monitor:
        return f"monitor {endpoint.monitor}"
    if endpoint.is_node:
        return endpoint.owner.rpartition("/")[2]
    return f"the {endpoint.owner}"


def _verb(endpoint: WiredEndpoint) -> str:
    return "publishes" if endpoint.is_publisher else "subscribes to"


@rule("R2B216")
def qos_incompatible(context: Context) -> Findings:
    """Publishers and subscriptions with incompatible QoS."""
    for phase in context.wiring.phases:
        for topic in phase.topics:
            for publisher in phase.publishers(topic):
                for subscription in phase.subscriptions(topic):
                    problem = _incompatibility(publisher, subscription)
                    if problem:
                        ends = (publisher, subscription)
                        finding = _qos_finding(context, phase, *ends, problem)
                        yield with_endpoint_records(context, phase, finding, *ends)


def _incompatibility(
    publisher: WiredEndpoint, subscription: WiredEndpoint
) -> tuple[str, str, str] | None:
    """The requested value, the offered value and the QoS field; None if they are compatible."""
    if publisher.qos is None or subscription.qos is None:
        return None
    if subscription.qos.reliability == "reliable" and publisher.qos.reliability == "best_effort":
        return "reliable", "best_effort", "reliability"
    if subscription.qos.durability == "transient_local" and publisher.qos.durability == "volatile":
        return "transient_local", "volatile", "durability"
    return None


def _qos_finding(
    context: Context,
    phase: PhaseWiring,
    publisher: WiredEndpoint,
    subscription: WiredEndpoint,
    problem: tuple[str, str, str],
) -> Finding:
    requested, offered, field = problem
    wrong, other = (subscription, publisher) if subscription.qos_path else (publisher, subscription)
    return Finding(
        message=f"{_endpoint_label(subscription)} requests {field} {quote(requested)} on "
        f"{quote(context.relative_name(publisher.topic))}, but "
        f"{_endpoint_label(publisher)} offers {quote(offered)}",
        path=(*wrong.qos_path, field) if wrong.qos_path else wrong.path,
        help=f"set {quote(f'{field}: {offered}')} for {_endpoint_label(subscription)}, or "
        f"{quote(f'{field}: {requested}')} for {_endpoint_label(publisher)}",
        related=(
            Pointer(
                "publisher" if other.is_publisher else "subscription", other.qos_path or other.path
            ),
        ),
        suppressed_by={topic_key(phase.phase, publisher.topic)},
        suppresses={flow_key(phase.phase)},
    )


_KINDS: Final = {"msg": "message", "srv": "service", "action": "action"}


@rule("R2B681")
def message_type_not_installed(context: Context) -> Findings:
    """Types of messages, services and actions that are not installed on this machine."""
    stated: dict[str, Path] = {}
    for phase in context.wiring.phases:
        for endpoint in phase.endpoints:
            # The harness publishes and subscribes itself, and must have the types.
            if not endpoint.is_node and endpoint.type_path and endpoint.type:
                stated.setdefault(endpoint.type, endpoint.type_path)
    for call in stated_calls(context.spec):
        stated.setdefault(call.type, (*call.path, "type"))
    if not stated or find_module("rclpy") is None:
        return
    for name, path in stated.items():
        package, kind, own_name = name.split("/")
        types = installed_types(package, kind)
        if types is None or own_name in types:
            continue
        what = _KINDS[kind]
        yield Finding(
            message=f"{what} type {quote(name)} is not installed on this machine"
            + ("" if not types else f": its package {package} has no such {what}"),
            path=path,
            help=_type_advice(package, own_name, types),
            machine_dependent=True,
            suppressed_by={value_key(path)},
        )


def _type_advice(package: str, name: str, types: frozenset[str]) -> str:
    if not types:
        return ros_package_advice(package)
    build = f"build the version of {package} that has it, and source its workspace"
    close = did_you_mean(name, types)
    return f"did you mean {quote(close)}? Otherwise {build}" if close else build


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


_SERVICE_EVENT: Final = "/_service_event"
"""The end of the names of topics that service introspection publishes."""


@rule("R2B241", early=True)
def service_events_loaded(context: Context) -> Findings:
    """Recorded calls of services that are loaded as if they were messages of a topic."""
    for name, loaded in context.spec.data_loader.topics.items():
        if name.endswith(_SERVICE_EVENT):
            service = name.removesuffix(_SERVICE_EVENT)
            played = [
                key for key, each in context.spec.playback.inputs.items() if each.source == loaded
            ]
            yield Finding(
                message=f"{quote(name)} has recorded calls of the service {quote(service)}, which "
                "are not messages that a node gets",
                path=("data_loader", "topics", name),
                key=True,
                help="call the service under 'playback.calls', with the recorded requests in "
                f"'each' ('ros2 topic echo {name} --once' shows one while the bag is played)",
                suppresses={
                    value_key(("data_loader", "topics", name)),
                    topic_key("preprocess", context.harness_topic(loaded)),
                    *(value_key(("playback", "inputs", key, "format")) for key in played),
                    *(topic_key("measure", context.harness_topic(key)) for key in played),
                },
            )
