"""The states of lifecycle nodes, asked for and changed by the services that every such node has.

These are the same for nodes in C++ and in Python. The answer to a transition says only whether it
succeeded; what its callback returned is in the event that the node publishes meanwhile.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from rclpy.node import Node

from r2bspec.harness.rclpy_tools import ask_services, interface_class, spin_until
from r2bspec.ipc import protocol

_CHANGE, _CHANGE_TYPE = "/change_state", "lifecycle_msgs/srv/ChangeState"
_TRANSITION_IDS: Final = {"configure": 1, "activate": 3}
"""Of lifecycle_msgs/msg/Transition."""

_PASSING: Final = {"configure": "configuring", "activate": "activating"}
_EVENT_S = 1.0
"""An event and the answer of its transition come over different topics, in any order."""

_STATE_S = 2.0


def lifecycle_nodes(services: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """The nodes with a service that changes their state, of all services and their types."""
    return sorted(
        name.removesuffix(_CHANGE)
        for name, types in services
        if name.endswith(_CHANGE) and _CHANGE_TYPE in types
    )


def list_states(node: Node, command: protocol.ListLifecycle) -> protocol.LifecycleStates:
    """Ask all lifecycle nodes that discovery shows for their states, in parallel.

    Args:
        node: asks; no executor may spin it.
        command: how long to wait for the answers.
    """
    found = lifecycle_nodes(node.get_service_names_and_types())
    states = _states(node, found, command.timeout_ns / 1e9)
    return protocol.LifecycleStates(states=states, managers=_managers(node, found))


def _states(node: Node, names: Iterable[str], timeout_s: float) -> dict[str, str]:
    """The states of nodes by their names; empty for one that does not answer."""
    services = {name: f"{name}/get_state" for name in names}
    kind = interface_class("lifecycle_msgs/srv/GetState")
    answers = ask_services(node, kind, services.values(), timeout_s)
    return {
        name: str(answers[service].current_state.label) if service in answers else ""
        for name, service in services.items()
    }


def _managers(node: Node, managed: list[str]) -> dict[str, tuple[str, ...]]:
    """The other nodes that have a client of ``change_state``, by the node that they can change."""
    managers: dict[str, set[str]] = {name: set() for name in managed}
    for name, namespace in node.get_node_names_and_namespaces() if managed else ():
        full = f"{namespace.rstrip('/')}/{name}"
        # A node may end between the two questions.
        with contextlib.suppress(Exception):
            for service, _ in node.get_client_names_and_types_by_node(name, namespace):
                target = service.removesuffix(_CHANGE)
                if service.endswith(_CHANGE) and target in managers:
                    managers[target].add(full)
    own = node.get_fully_qualified_name()
    return {name: tuple(sorted(found - {own})) for name, found in managers.items() if found - {own}}


def change_state(
    node: Node, command: protocol.ChangeState, interrupted: Callable[[], bool]
) -> protocol.StateChanged:
    """Ask a lifecycle node to make a transition, and wait until it has.

    Args:
        node: asks; no executor may spin it.
        command: the transition, and how long it may take.
        interrupted: whether the answer is not needed any more.
    """
    change = interface_class(_CHANGE_TYPE)
    request = change.Request()
    request.transition.id = _TRANSITION_IDS[command.transition]
    service = f"{command.node}{_CHANGE}"
    events: list[Any] = []
    subscription = node.create_subscription(
        interface_class("lifecycle_msgs/msg/TransitionEvent"),
        f"{command.node}/transition_event",
        events.append,
        10,
    )
    try:
        spin_until(node, lambda: _is_matched(subscription), _EVENT_S)
        answers = ask_services(
            node, change, [service], command.timeout_ns / 1e9, request, interrupted
        )
        if service not in answers:
            return protocol.StateChanged(result="no answer")
        result: Any = "success"
        if not answers[service].success:
            passing = _PASSING[command.transition]
            spin_until(node, lambda: _result(events, passing), _EVENT_S)
            result = _result(events, passing) or "unknown"
        state = _states(node, [command.node], _STATE_S)[command.node]
        return protocol.StateChanged(result=result, state=state)
    finally:
        node.destroy_subscription(subscription)


def _is_matched(subscription: Any) -> bool:
    with subscription.handle:
        return bool(subscription.handle.get_publisher_count())


def _result(events: list[Any], passing: str) -> Any:
    """What a callback that did not succeed has returned, by the events of its node.

    Events have the states, and no transition. None without an event.
    """
    goals = (event.goal_state.label for event in events if event.start_state.label == passing)
    goal = next(goals, None)
    return goal and ("error" if goal == "errorprocessing" else "failure")
