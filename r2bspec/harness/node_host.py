"""The node host: creates the Python nodes of one process and spins them.

A node is an rclpy `Node` class, a function that returns a node, or a `main()`. It receives its
namespace, name, remappings and parameter overrides as described in `r2bspec.harness.node_main`, and
does not depend on r2bspec.

Player and monitor can be in the same process. Within one process the middleware passes a message
from publisher to subscription directly: without shared memory, and without waking a thread. Player
and monitor are native threads, which neither hold nor wait for the lock of the interpreter; only
the nodes use it.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rclpy import spin
from rclpy.context import Context
from rclpy.executors import (
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)
from rclpy.node import Node
from rclpy.utilities import get_default_context

from r2bspec.harness import node_main, rclpy_tools
from r2bspec.harness.control_channel import Channel, ChannelClosedError
from r2bspec.ipc import protocol
from r2bspec.plan.plan import NodePlan
from r2bspec.plan.wiring.name_resolution import NODE_TOPICS, expand

_REGISTER = "_LifecycleNodeMixin__register_callback"
"""What rclpy calls for each callback of a transition."""


def describe_nodes(nodes: Sequence[tuple[NodePlan, Node]]) -> protocol.Ready:
    """Return the endpoints and parameters of nodes, and their differences from their plans."""
    declared = {plan.name: {*node.list_parameters([], 0).names} for plan, node in nodes}
    return protocol.Ready(
        endpoints=tuple(
            (plan.name, publisher.topic_name, _type_name(publisher.msg_type), direction)
            for plan, node in nodes
            for direction in ("publishes", "subscribes")
            for publisher in (node.publishers if direction == "publishes" else node.subscriptions)
            if publisher.topic_name not in NODE_TOPICS
        ),
        undeclared=tuple(
            (plan.name, name)
            for plan, _ in nodes
            for name in plan.parameters
            if name not in declared[plan.name]
        ),
        parameters={name: tuple(sorted(names)) for name, names in declared.items()},
        unmatched=tuple(rule for plan, node in nodes for rule in _unmatched(plan, node)),
        lifecycle=tuple(plan.name for plan, node in nodes if _is_lifecycle_node(node)),
    )


def _unmatched(plan: NodePlan, node: Node) -> Iterator[tuple[str, str, str]]:
    """Yield the remappings whose target is not the name of any topic or service of the node.

    The names of an action or an image transport begin with the target.
    """
    name, namespace = node.get_name(), node.get_namespace()
    unmatched = [*rclpy_tools.names_of(node, name, namespace)]
    unmatched += [publisher.topic_name for publisher in node.publishers]
    unmatched += [subscription.topic_name for subscription in node.subscriptions]
    for before, after in plan.remappings.items():
        full = expand(after, name, namespace)
        if not any(each == full or each.startswith(f"{full}/") for each in unmatched):
            yield plan.name, before, full


def _type_name(message_class: Any) -> str:
    package = message_class.__module__.partition(".")[0]
    return f"{package}/msg/{message_class.__name__}"


def _executor(settings: protocol.ConfigureHost) -> Executor:
    """Return the executor of the plan; 0 threads mean one per core."""
    if settings.executor == "multi_threaded":
        return MultiThreadedExecutor(num_threads=settings.threads or None)
    return SingleThreadedExecutor()


def make_host(channel: Channel, settings: protocol.ConfigureHost) -> NodeHost | FunctionHost:
    """Return the host of the nodes of one process.

    Raises:
        NodeError: a node cannot be created, or cannot share its process.
    """
    plans = settings.nodes
    if len(plans) == 1:
        node_main.set_command_line(plans[0])
    factories = [node_main.find_factory(each.target, Path(settings.base_dir)) for each in plans]
    _report_failed_transitions()
    without_keywords = [
        (plan, factory)
        for plan, factory in zip(plans, factories, strict=True)
        if not node_main.takes_keywords(factory)
    ]
    for plan, factory in without_keywords:
        if len(plans) > 1:
            raise node_main.NodeError(
                f"node {plan.name} cannot be created: {plan.target} takes no **kwargs, and other "
                "nodes run in the same process",
                hint="Give it a process of its own, or let its constructor pass **kwargs to Node.",
            )
        if not isinstance(factory, type):
            return FunctionHost(channel, settings, factory)
        rclpy_tools.init(tuple(node_main.ros_arguments(plan)))
    rclpy_tools.init()
    nodes = [
        (plan, node_main.make_node(plan, factory))
        for plan, factory in zip(plans, factories, strict=True)
    ]
    return NodeHost(channel, settings, nodes)


class NodeHost:
    """Spins nodes until told to shut down."""

    def __init__(
        self,
        channel: Channel,
        settings: protocol.ConfigureHost,
        nodes: Sequence[tuple[NodePlan, Node]],
    ) -> None:
        self._channel = channel
        self._executor = _executor(settings)
        self._nodes = nodes
        for _, node in nodes:
            rclpy_tools.destroy_on_shutdown(node)
            self._executor.add_node(node)

    def serve(self) -> None:
        """Spin.

        Raises:
            NodeError: a callback raised an exception, which makes the measurements meaningless.
        """
        self._channel.send(describe_nodes(self._nodes))
        threading.Thread(target=self._listen, daemon=True).start()
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return
        except Exception as error:
            names = ", ".join(node.get_fully_qualified_name() for _, node in self._nodes)
            raise node_main.NodeError(
                f"a callback of {names} raised {node_main.raised_text(error)}", code="R2B634"
            ) from error

    def _listen(self) -> None:
        with contextlib.suppress(ChannelClosedError):
            while not isinstance(command := self._channel.receive(), protocol.Shutdown):
                if isinstance(command, protocol.ListModules):
                    self._channel.send(protocol.Modules(files=node_main.module_files()))
                if isinstance(command, protocol.CountMatches):
                    self._channel.send(self._matches())
                if isinstance(command, protocol.DescribeNodes):
                    self._channel.send(describe_nodes(self._nodes))
        # Not the context: a running callback may still publish.
        self._executor.shutdown()

    def _matches(self) -> protocol.Matched:
        """Return the number of matched endpoints of each topic: the minimum over one side."""
        subscriptions: dict[str, int] = {}
        publishers: dict[str, int] = {}
        for _, node in self._nodes:
            for publisher in list(node.publishers):
                topic, count = publisher.topic_name, publisher.get_subscription_count()
                subscriptions[topic] = min(subscriptions.get(topic, count), count)
            for subscription in list(node.subscriptions):
                with subscription.handle:
                    count = subscription.handle.get_publisher_count()
                topic = subscription.topic_name
                publishers[topic] = min(publishers.get(topic, count), count)
        return protocol.Matched(counts=subscriptions, publisher_counts=publishers)


class FunctionHost:
    """Calls a function without arguments, and spins the node that it returns, if any.

    The first use of ROS decides what the function is: a function that initialises ROS is a program,
    such as the ``main`` of an ordinary node, which creates its nodes and spins them with the
    executor of its choice. For a function that creates a node without that, ROS is initialised, and
    the node that it returns is spun here. Its process gets the ROS arguments of the node on its
    command line, as by ``ros2 run``. A program is seen from outside like any other, and told to end
    by SIGINT.
    """

    def __init__(
        self, channel: Channel, settings: protocol.ConfigureHost, function: Callable[[], Any]
    ) -> None:
        self._channel = channel
        self._settings = settings
        (self._plan,) = settings.nodes
        self._function = function
        self._is_program = False
        self._ending = threading.Event()

    def serve(self) -> None:
        """Call the function, and spin the node that it returns until told to shut down.

        Raises:
            NodeError: it raised an exception, or returned no node.
            SystemExit: a program has ended.
        """
        # The controller alone was meant to get Ctrl-C; a program ends by it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        result = self._call()
        if self._is_program:
            raise SystemExit(result)
        node = node_main.checked_node(self._plan, result)
        NodeHost(self._channel, self._settings, [(self._plan, node)]).serve()

    def _call(self) -> Any:
        try:
            with self._first_use_of_ros():
                result = self._function()
            if isinstance(result, Node) and self._is_program:
                # It initialised ROS, made a node, and leaves the rest to its caller.
                spin(result)
                return None
        except BaseException as error:
            if self._ending.is_set():
                raise SystemExit(0) from error
            if isinstance(error, SystemExit):
                raise
            # The constructor of a node raises the same errors where a program calls it.
            is_running = self._is_program and not _is_of_constructor(error)
            does = "ended with" if is_running else "cannot be created:"
            raise node_main.NodeError(
                f"node {self._plan.name} {does} {node_main.raised_text(error)}",
                code="R2B634" if is_running else "R2B633",
            ) from error
        return result

    @contextlib.contextmanager
    def _first_use_of_ros(self) -> Iterator[None]:
        """See who uses ROS first: an initialisation, or a node."""
        initialise, make = Context.init, Node.__init__

        def restore() -> None:
            Context.init = initialise  # type: ignore[method-assign]
            Node.__init__ = make  # type: ignore[method-assign]

        def initialised(context: Context, *arguments: Any, **options: Any) -> None:
            restore()
            initialise(context, *arguments, **options)
            self._become_program()

        def made(node: Node, *arguments: Any, **options: Any) -> None:
            restore()
            if options.get("context") is None and not get_default_context().ok():
                rclpy_tools.init(tuple(node_main.ros_arguments(self._plan)))
            make(node, *arguments, **options)

        Context.init = initialised  # type: ignore[assignment,method-assign]
        Node.__init__ = made  # type: ignore[assignment,method-assign]
        try:
            yield
        finally:
            restore()

    def _become_program(self) -> None:
        self._is_program = True
        self._channel.send(protocol.Ready(is_program=True))
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        with contextlib.suppress(ChannelClosedError):
            while not isinstance(command := self._channel.receive(), protocol.Shutdown):
                if isinstance(command, protocol.ListModules):
                    self._channel.send(protocol.Modules(files=node_main.module_files()))
        self._ending.set()
        os.kill(os.getpid(), signal.SIGINT)


def _is_of_constructor(error: BaseException) -> bool:
    """Return whether the constructor of a node has raised an exception."""
    frames = (frame for frame, _ in traceback.walk_tb(error.__traceback__))
    return any(
        frame.f_code.co_name == "__init__" and isinstance(frame.f_locals.get("self"), Node)
        for frame in frames
    )


_SWITCH_INTERVAL_S = 0.0002
"""How long a thread may hold the interpreter lock while others wait. The default of 5 ms would
delay the nodes by as much whenever one of them computes."""


class InProcessHarness:
    """Player and monitor as threads of this process, and its Python nodes."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureHarness) -> None:
        self._channel = channel
        self._library = ctypes.CDLL(os.environ.pop(protocol.NATIVE_LIBRARY_VARIABLE))
        for part in settings.parts:
            number = int(os.environ.pop(protocol.control_variable(part)))
            if status := self._library.r2bspec_harness_serve(number):
                raise OSError(-status, os.strerror(-status), part)

    def serve(self) -> None:
        """Run the nodes until told to shut down; a part reports errors on its own channel."""
        sys.setswitchinterval(_SWITCH_INTERVAL_S)
        try:
            self._channel.send(protocol.Ready())
            nodes = self._channel.receive()
            if isinstance(nodes, protocol.ConfigureHost):
                make_host(self._channel, nodes).serve()
        finally:
            self._library.r2bspec_harness_join()


def _is_lifecycle_node(node: Node) -> bool:
    """Return whether a node has states."""
    mixin = _lifecycle_mixin()
    return mixin is not None and isinstance(node, mixin)


def _report_failed_transitions() -> None:
    """Let the lifecycle nodes of this process, of all imported classes, say why they failed.

    rclpy takes an exception in the callback of a transition for its result, and says nothing of it;
    of a callback that returns nothing, the whole process ends. Both are said here.
    """
    mixin = _lifecycle_mixin()
    register = getattr(mixin, _REGISTER, None)
    if register is None or hasattr(register, "__wrapped__"):
        return

    @functools.wraps(register)
    def register_reporting(node: Any, state: int, callback: Callable[[Any], Any]) -> Any:
        return register(node, state, _reporting(node, callback))

    setattr(mixin, _REGISTER, register_reporting)


def _lifecycle_mixin() -> Any:
    """Return the class with the states; None as long as nobody has imported it."""
    return getattr(sys.modules.get("rclpy.lifecycle"), "LifecycleNodeMixin", None)


def _reporting(node: Node, callback: Callable[[Any], Any]) -> Callable[[Any], Any]:
    from rclpy.lifecycle import TransitionCallbackReturn

    @functools.wraps(callback)
    def call(state: Any) -> Any:
        try:
            result = callback(state)
        except Exception:
            traceback.print_exc()
            raise
        if not isinstance(result, TransitionCallbackReturn):
            name = f"{getattr(callback, '__name__', 'a callback')} of {node.get_name()}"
            sys.stderr.write(f"{name} returned {result!r}, no TransitionCallbackReturn\n")
            return TransitionCallbackReturn.ERROR
        return result

    return call
