"""The states of lifecycle nodes, asked for and changed by the services that every such node has.

These are the same for nodes in C++ and in Python. The answer to a transition says only whether it
succeeded; what its callback returned is in the event that the node publishes meanwhile.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from r2bspec.harness.rclpy_tools import interface_class
from r2bspec.ipc import protocol

_CHANGE, _CHANGE_TYPE = "/change_state", "lifecycle_msgs/srv/ChangeState"
_TRANSITION_IDS: Final = {"configure": 1, "activate": 3}
"""Of lifecycle_msgs/msg/Transition."""

_PASSING: Final = {"configure": "configuring", "activate": "activating"}
_SPIN_S = 0.02
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
    with _Clients(node) as clients:
        futures = {name: clients.ask_state(name) for name in found}
        clients.spin_until(
            lambda: all(future.done() for future in futures.values()), command.timeout_ns / 1e9
        )
        states = {
            name: str(each.result().current_state.label) if each.done() else ""
            for name, each in futures.items()
        }
    return protocol.LifecycleStates(states=states, managers=_managers(node, found))


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
    events: list[Any] = []
    subscription = node.create_subscription(
        interface_class("lifecycle_msgs/msg/TransitionEvent"),
        f"{command.node}/transition_event",
        events.append,
        10,
    )
    try:
        with _Clients(node) as clients:
            request = change.Request()
            request.transition.id = _TRANSITION_IDS[command.transition]
            clients.spin_until(lambda: _is_matched(subscription), _EVENT_S)
            answer = clients.call(change, f"{command.node}{_CHANGE}", request)
            clients.spin_until(lambda: answer.done() or interrupted(), command.timeout_ns / 1e9)
            if not answer.done():
                return protocol.StateChanged(result="no answer")
            result: Any = "success"
            if not answer.result().success:
                passing = _PASSING[command.transition]
                clients.spin_until(lambda: _result(events, passing), _EVENT_S)
                result = _result(events, passing) or "unknown"
            state = clients.ask_state(command.node)
            clients.spin_until(state.done, _STATE_S)
            return protocol.StateChanged(
                result=result,
                state=str(state.result().current_state.label) if state.done() else "",
            )
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


class _Clients:
    """Clients of one node, spun until they have their answers, and destroyed afterwards."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._executor = SingleThreadedExecutor(context=node.context)
        self._clients: list[Any] = []

    def __enter__(self) -> _Clients:
        self._executor.add_node(self._node)
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.remove_node(self._node)
        self._executor.shutdown()
        for client in self._clients:
            self._node.destroy_client(client)

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """The future of a call, which is sent as soon as the service is there."""
        client = self._node.create_client(kind, service)
        self._clients.append(client)
        client.wait_for_service(_STATE_S)
        return client.call_async(request)

    def ask_state(self, name: str) -> Any:
        """The future of the state of a lifecycle node."""
        kind = interface_class("lifecycle_msgs/srv/GetState")
        return self.call(kind, f"{name}/get_state", kind.Request())

    def spin_until(self, condition: Callable[[], Any], timeout_s: float) -> bool:
        """Serve the node until a condition holds; False if it does not in time."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=_SPIN_S)
        return True
