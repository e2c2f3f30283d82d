"""The roles of harness processes and their parts.

Each is imported only by the processes that have this role.
"""

from __future__ import annotations

import contextlib
import importlib
import sys
import traceback
from typing import Protocol

from r2bspec.exit_status import ExitStatus
from r2bspec.harness.control_channel import Channel, ChannelClosedError
from r2bspec.ipc import protocol
from r2bspec.ipc.sample_files import is_refusal, refusal_text
from r2bspec.record.errors import RUN_UNWRITABLE


class Role(Protocol):
    """The object that the first command creates; it executes the others."""

    def serve(self) -> None:
        """Answer commands until told to shut down."""


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
    match command:
        case protocol.ConfigureLoader():
            from r2bspec.harness.loader import Loader

            return Loader(channel, command)
        case protocol.ConfigureObserver():
            from r2bspec.harness.observer import Observer

            return Observer(channel, command)
        case protocol.ConfigureHost():
            from r2bspec.harness.node_host import NodeHost

            return NodeHost(channel, command)
        case protocol.ConfigureHarness():
            from r2bspec.harness.in_process import InProcessHarness

            return InProcessHarness(channel, command)
        case protocol.ConfigureCaller():
            from r2bspec.harness.service_client import ServiceCaller

            return ServiceCaller(channel, command)
        case protocol.ConfigureComponents():
            from r2bspec.harness.component_loader import ComponentLoader

            return ComponentLoader(channel, command)
    raise RuntimeError(f"the first command must configure the process: {type(command).__name__}")


def _failure(error: Exception) -> protocol.Failed:
    code = getattr(error, "code", "R2B630")
    hint = getattr(error, "hint", "")
    message = str(error) or type(error).__name__
    if isinstance(error, OSError) and is_refusal(error):
        code, message = RUN_UNWRITABLE, refusal_text(error)
        hint = "Make room on that disk, or choose another folder with --output."
    if isinstance(error, ImportError):
        code, hint = "R2B620", "install ROS 2, or pip install 'r2bspec[ros]'"
    return protocol.Failed(code=code, message=message, hint=hint)
