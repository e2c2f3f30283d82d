"""A Python function in a process of its own: one that returns a node, or a program.

Which of the two it is shows when it is called. Its process gets the ROS arguments of the node on
its command line, as by ``ros2 run``. The first use of ROS decides: a function that initialises it
is a program, such as the ``main`` of an ordinary node, which makes its nodes and spins them with
the executor of its choice; for one that makes a node without that, ROS is initialised, and the node
that it returns is spun here. A program is seen from outside like any other, and told to end by
SIGINT.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from rclpy import spin
from rclpy.context import Context
from rclpy.node import Node
from rclpy.utilities import get_default_context

from r2bspec.harness import node_main, rclpy_tools
from r2bspec.harness.control_channel import Channel, ChannelClosedError
from r2bspec.ipc import protocol
from r2bspec.plan.plan import NodePlan


@dataclass
class FunctionHost:
    """Calls a function; what it returns is spun, unless it is a program.

    Attributes:
        channel: to the controller.
        plan: of the node.
        function: takes no arguments.
        serve_node: answers that a node is ready, and spins it until told to shut down.
    """

    channel: Channel
    plan: NodePlan
    function: Callable[[], Any]
    serve_node: Callable[[Node], None]
    _is_program: bool = False

    def __post_init__(self) -> None:
        self._ending = threading.Event()

    def serve(self) -> None:
        """Call the function, and spin the node that it returns.

        Raises:
            NodeError: it raised an exception, or returned no node.
            SystemExit: a program has ended.
        """
        # The controller alone was meant to get Ctrl-C; a program ends by it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        result = self._call()
        if self._is_program:
            raise SystemExit(result)
        self.serve_node(node_main.checked_node(self.plan, result))

    def _call(self) -> Any:
        try:
            with self._first_use_of_ros():
                result = self.function()
            if isinstance(result, Node) and self._is_program:
                # It initialised ROS, made a node, and leaves the rest to its caller.
                spin(result)
                return None
        except BaseException as error:
            if self._ending.is_set():
                raise SystemExit(0) from error
            if isinstance(error, SystemExit):
                raise
            # The constructor of a node fails alike, whoever calls it.
            is_running = self._is_program and not _is_of_constructor(error)
            does = "ended with" if is_running else "cannot be created:"
            raise node_main.NodeError(
                f"node {self.plan.name} {does} {type(error).__name__}: {error}",
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
                rclpy_tools.init(tuple(node_main.ros_arguments(self.plan)))
            make(node, *arguments, **options)

        Context.init = initialised  # type: ignore[assignment,method-assign]
        Node.__init__ = made  # type: ignore[assignment,method-assign]
        try:
            yield
        finally:
            restore()

    def _become_program(self) -> None:
        self._is_program = True
        self.channel.send(protocol.Ready(is_program=True))
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        with contextlib.suppress(ChannelClosedError):
            while not isinstance(command := self.channel.receive(), protocol.Shutdown):
                if isinstance(command, protocol.ListModules):
                    self.channel.send(protocol.Modules(files=node_main.module_files()))
        self._ending.set()
        os.kill(os.getpid(), signal.SIGINT)


def _is_of_constructor(error: BaseException) -> bool:
    """Whether the constructor of a node has raised an exception."""
    frames = (frame for frame, _ in traceback.walk_tb(error.__traceback__))
    return any(
        frame.f_code.co_name == "__init__" and isinstance(frame.f_locals.get("self"), Node)
        for frame in frames
    )
