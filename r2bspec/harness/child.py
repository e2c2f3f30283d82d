"""The main program of every harness process: ``python -m r2bspec.harness.child``.

The first command sets the role; the module of a role is imported only by the processes that have
it. A process exits with the status OK on the command to shut down or when the controller has
exited, and with FINDINGS_OR_FAILED after it has reported an error.

Some middleware can hang while it is left (`Middleware.may_hang_on_exit`), inside a native call that
holds the interpreter's lock: no thread of Python would get a turn to end the process then. The one
of `faulthandler` does not need it.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import os
import signal
import sys
import traceback
from collections.abc import Callable
from typing import Final, Protocol

from r2bspec.errors import ExitStatus, is_refusal, refusal_hint, refusal_text
from r2bspec.extras import install_command
from r2bspec.harness.control_channel import Channel, ChannelClosedError
from r2bspec.ipc import protocol
from r2bspec.middleware.middleware import middleware_of
from r2bspec.record.files import RUN_UNWRITABLE

_ROLES: Final[dict[type[protocol.Command], str]] = {
    protocol.ConfigureLoader: "loader:Loader",
    protocol.ConfigureObserver: "observer:Observer",
    protocol.ConfigureHost: "node_host:make_host",
    protocol.ConfigureHarness: "node_host:InProcessHarness",
    protocol.ConfigureCalls: "call_player:CallPlayer",
    protocol.ConfigureCaller: "service_client:ServiceCaller",
    protocol.ConfigureInspector: "inspect_nodes:NamespaceInspector",
    protocol.ConfigureComponents: "service_client:ComponentLoader",
}
"""For each first command what it makes: the module, and the name in it."""


class Role(Protocol):
    """The object that the first command creates; it executes the others."""

    def serve(self) -> None:
        """Answer commands until the command to shut down."""


def play_role(channel: Channel) -> int:
    """Run the role of the first command to its end.

    Returns:
        The exit status: FINDINGS_OR_FAILED after an error has been reported.
    """
    try:
        command = channel.receive()
        if isinstance(command, protocol.Prepare):
            _prepare(command)
            channel.send(protocol.Prepared())
            command = channel.receive()
        _make_role(channel, command).serve()
    except ChannelClosedError:
        return ExitStatus.OK
    except Exception as error:
        sys.stderr.write(traceback.format_exc())
        with contextlib.suppress(ChannelClosedError):
            channel.send(_failure(error))
        return ExitStatus.FINDINGS_OR_FAILED
    return ExitStatus.OK


def _prepare(command: protocol.Prepare) -> None:
    """Import what takes time and is the same for all nodes; their own modules come later."""
    importlib.import_module("r2bspec.harness.node_host")
    for package in command.packages:
        # What is missing is an error of the node that needs it.
        with contextlib.suppress(ImportError):
            importlib.import_module(f"{package}.msg")


def _make_role(channel: Channel, command: protocol.Command) -> Role:
    if type(command) not in _ROLES:
        kind = type(command).__name__
        raise RuntimeError(f"the first command must configure the process: {kind}")
    module, name = _ROLES[type(command)].split(":")
    make: Callable[[Channel, protocol.Command], Role] = getattr(
        importlib.import_module(f"{__package__}.{module}"), name
    )
    return make(channel, command)


def _failure(error: Exception) -> protocol.Failed:
    code = getattr(error, "code", "R2B630")
    hint = getattr(error, "hint", "")
    message = str(error) or type(error).__name__
    if isinstance(error, OSError) and is_refusal(error):
        code, message = RUN_UNWRITABLE, refusal_text(error)
        hint = refusal_hint(error)
    if isinstance(error, ImportError):
        # NumPy puts a page of advice in front of what the loader says.
        code, message = "R2B620", message.strip().splitlines()[-1]
        absent = isinstance(error, ModuleNotFoundError)
        hint = f"Install ROS 2, or {install_command('ros')}." if absent else ""
    elif isinstance(root := _root(error), ImportError):
        # As of generated messages, which do not say why their library cannot be loaded.
        message = f"{message}: {root}"
    return protocol.Failed(code=code, message=message, hint=hint)


def _root(error: BaseException) -> BaseException:
    """Return the error that began what ended with an error."""
    cause = error.__cause__ or error.__context__
    return error if cause is None else _root(cause)


_MAX_EXIT_S = 8.0
"""How long the shutdown of ROS may take, including `destroy_node` of the nodes. Less than the
controller waits before it sends SIGTERM."""


def main() -> int:
    """Play the role that the controller assigns, and return the exit status."""
    # Ctrl-C goes to the controller, which ends its children in order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        channel = Channel.from_environment()
    except KeyError:
        sys.stderr.write("this program is started by 'r2bspec run' and cannot be run alone\n")
        return ExitStatus.USAGE
    return play_role(channel)


if __name__ == "__main__":
    status = main()
    if "rclpy" in sys.modules:
        from r2bspec.harness import rclpy_tools

        if middleware_of(os.environ).may_hang_on_exit:
            faulthandler.dump_traceback_later(_MAX_EXIT_S, exit=True)
        rclpy_tools.finish()
    sys.stdout.flush()
    sys.stderr.flush()
    # Threads of the middleware may still run; destructors at interpreter exit can then hang or
    # crash after all work is done.
    os._exit(status)
