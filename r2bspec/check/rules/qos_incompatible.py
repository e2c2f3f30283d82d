"""Publishers and subscriptions with incompatible QoS."""

from __future__ import annotations

from r2bspec.check.certainty import with_endpoint_records
from r2bspec.check.rule_api import (
    Context,
    Endpoint,
    Finding,
    Findings,
    PhaseWiring,
    Pointer,
    Rule,
    flow_key,
    quote,
    topic_key,
)


def _find(context: Context) -> Findings:
    for phase in context.wiring.phases:
        for topic in phase.topics:
            for publisher in phase.publishers(topic):
                for subscription in phase.subscriptions(topic):
                    problem = _incompatibility(publisher, subscription)
                    if problem:
                        ends = (publisher, subscription)
                        finding = _finding(context, phase, *ends, problem)
                        yield with_endpoint_records(context, phase, finding, *ends)


def _incompatibility(publisher: Endpoint, subscription: Endpoint) -> tuple[str, str, str] | None:
    """The requested value, the offered value and the QoS field; None if they are compatible."""
    if publisher.qos is None or subscription.qos is None:
        return None
    if subscription.qos.reliability == "reliable" and publisher.qos.reliability == "best_effort":
        return "reliable", "best_effort", "reliability"
    if subscription.qos.durability == "transient_local" and publisher.qos.durability == "volatile":
        return "transient_local", "volatile", "durability"
    return None


def _finding(
    context: Context,
    phase: PhaseWiring,
    publisher: Endpoint,
    subscription: Endpoint,
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


def _endpoint_label(endpoint: Endpoint) -> str:
    if endpoint.monitor:
        return f"monitor {endpoint.monitor}"
    return endpoint.owner.rpartition("/")[2] if endpoint.is_node else f"the {endpoint.owner}"


RULE = Rule(code="R2B216", find=_find)
