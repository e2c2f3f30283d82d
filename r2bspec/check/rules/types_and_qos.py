"""Messages that do not arrive although the topic is right: their type, and their QoS.

ROS connects a publisher to a subscription only if both have the same type and compatible QoS, and
is silent if they do not. The types that a spec states itself must exist, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

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
from r2bspec.diagnostics.quote import did_you_mean, quote
from r2bspec.language.spec import Spec
from r2bspec.plan.installed_packages import installed_types
from r2bspec.plan.package_advice import ros_package_advice
from r2bspec.plan.this_machine import find_module
from r2bspec.plan.wiring.wiring import PhaseWiring, WiredEndpoint


@rule("R2B202")
def message_type_unknown(context: Context) -> Findings:
    """Find message types that the common interfaces do not contain."""
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
    """Return every message type that the spec states, by its path."""
    endpoints = (endpoint for phase in context.wiring.phases for endpoint in phase.endpoints)
    return {
        endpoint.type_path: endpoint.type
        for endpoint in endpoints
        if endpoint.type_path and endpoint.type
    }


@rule("R2B210")
def message_type_mismatch(context: Context) -> Findings:
    """Find topics whose publishers and subscriptions have different types."""
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
    """Return the paths of input formats that equal the type of the bag or preprocessor."""
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
    """Find publishers and subscriptions with incompatible QoS."""
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
    """Return the requested value, the offered value and the QoS field.

    None if they are compatible.
    """
    if publisher.qos is None or subscription.qos is None:
        return None
    if subscription.qos.reliability == "reliable" and publisher.qos.reliability == "best_effort":
        return "reliable", "best_effort", "reliability"
    if subscription.qos.durability == "transient_local" and publisher.qos.durability == "volatile":
        return "transient_local", "volatile", "durability"
    if subscription.qos.liveliness != "automatic" == publisher.qos.liveliness:
        return subscription.qos.liveliness, "automatic", "liveliness"
    for field in ("deadline", "lease_duration"):
        requested, offered = getattr(subscription.qos, field), getattr(publisher.qos, field)
        if requested is not None and (offered is None or offered.ns > requested.ns):
            return str(requested), "none" if offered is None else str(offered), field
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
    relaxed = (
        f"remove {quote(field)}" if offered == "none" else f"set {quote(f'{field}: {offered}')}"
    )
    return Finding(
        message=f"{_endpoint_label(subscription)} requests {field} {quote(requested)} on "
        f"{quote(context.relative_name(publisher.topic))}, but "
        f"{_endpoint_label(publisher)} offers {quote(offered)}",
        path=(*wrong.qos_path, field) if wrong.qos_path else wrong.path,
        help=f"{relaxed} for {_endpoint_label(subscription)}, or "
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
    """Find types of messages, services and actions that are not installed on this machine."""
    stated: dict[str, Path] = {}
    for phase in context.wiring.phases:
        for endpoint in phase.endpoints:
            # The harness publishes and subscribes itself, and must have the types.
            is_transform = endpoint.path[-1] in {"publish_tf", "publish_tf_static"}
            place = endpoint.path if is_transform else endpoint.type_path
            if not endpoint.is_node and place and endpoint.type:
                stated.setdefault(endpoint.type, place)
    for path, name in _called_types(context.spec):
        stated.setdefault(name, path)
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


def _called_types(spec: Spec) -> Iterator[tuple[Path, str]]:
    """Yield the type of every service and action that a spec calls, with its place."""
    for name, call in spec.playback.calls.items():
        for key, called in (("service", call.service), ("action", call.action)):
            if called is not None:
                yield ("playback", "calls", name, key, "type"), called.type
    for name, step in spec.after_ready.items():
        if step.service is not None:
            yield ("after_ready", name, "service", "type"), step.service.type


def _type_advice(package: str, name: str, types: frozenset[str]) -> str:
    if not types:
        return ros_package_advice(package)
    build = f"build the version of {package} that has it, and source its workspace"
    close = did_you_mean(name, types)
    return f"did you mean {quote(close)}? Otherwise {build}" if close else build
