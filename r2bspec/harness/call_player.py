"""The player that calls services: one request of each in every step, at the time when it is due.

The load is open: a request is sent whether or not earlier ones are answered. A step is written as a
step of a playback, and an answer as a message of a monitor with the stamp of its step, so that what
is computed of them is what is computed of topics: latencies from the request and from its due time,
and answers that never came.

Answers are read without an executor, which would take a multiple of the time. Their times are those
at which the middleware received them.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation as _implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile

from r2bspec.harness import rclpy_tools
from r2bspec.harness.control_channel import Channel
from r2bspec.harness.service_client import ServiceCallError, fill_message, service_class
from r2bspec.ipc import protocol
from r2bspec.ipc.arrivals import ARRIVAL_FIELDS, read_clocks
from r2bspec.ipc.sample_files import RowWriter
from r2bspec.plan.plan import CallPlan
from r2bspec.record.sample_arrays import PLAYBACK_FIELDS

_LEAD_NS = 20_000_000
"""From the command to the first request."""

_IDLE_S = 0.01
"""Between two looks for a command while nothing is played."""

_EXACT_S = 0.0005
"""Waiting for answers ends so long before a request is due: it may take longer than it is told."""

_CALLS = QoSProfile(depth=1000)
"""Of the client: requests that wait for a busy service are not overwritten on this side."""

_ALL_INPUTS = -1


class _Client:
    """Calls one service, and writes its answers."""

    def __init__(self, node: Node, plan: CallPlan, rows_dir: Path) -> None:
        """Create the client.

        Raises:
            ServiceCallError: the type is not installed, or has no such fields.
        """
        self.plan = plan
        self._kind = service_class(plan.type)
        self._request = fill_message(self._kind.Request(), plan.request)
        success = self._kind.Response.get_fields_and_field_types().get(plan.success)
        if plan.success and success != "boolean":
            what = f"is of type {success}" if success else "does not exist"
            raise ServiceCallError(
                f"playback.calls.{plan.name}: field {plan.success!r} of the response {what}, and "
                "'success' needs a boolean"
            )
        self._client = node.create_client(self._kind, plan.service, qos_profile=_CALLS)
        self._rows = RowWriter(rows_dir / f"{plan.name}.rows", len(ARRIVAL_FIELDS))
        self._waiting: dict[int, int] = {}
        self._has_failed = False

    @property
    def handle(self) -> Any:
        """For a wait set."""
        return self._client.handle

    def is_there(self) -> bool:
        """Whether a node offers the service."""
        return bool(self._client.service_is_ready())

    def send(self, stamp_ns: int) -> None:
        """Send the request of the step with this stamp."""
        self._waiting[self.handle.send_request(self._request)] = stamp_ns

    def take(self) -> bool:
        """Write the next answer; False if there is none."""
        info, response = self.handle.take_response(self._kind.Response)
        if info is None:
            return False
        stamp_ns = self._waiting.pop(info.request_id.sequence_number, 0)
        if self.plan.success and not getattr(response, self.plan.success):
            if not self._has_failed:
                self._has_failed = True
                sys.stderr.write(f"the first call that failed was answered {response}\n")
            return True
        # In this order: an answer is not received after it was taken.
        taken_ns, difference_ns = read_clocks()
        self._rows.append(stamp_ns, info.received_timestamp, taken_ns, 0, difference_ns)
        return True


class CallPlayer:
    """Calls services in steps."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureCalls) -> None:
        self._channel = channel
        self._node = rclpy_tools.start_node("player")
        folder = Path(settings.rows_dir)
        self._clients = [_Client(self._node, plan, folder) for plan in settings.calls]
        self._playback = RowWriter(folder / protocol.CALLED_ROWS, len(PLAYBACK_FIELDS))
        self._last_stamp_ns = 0
        handle = self._node.context.handle
        self._set = _implementation.WaitSet(0, 0, 0, len(self._clients), 0, 0, handle)

    def serve(self) -> None:
        """Play, and read answers all the time, until told to shut down.

        Raises:
            ChannelClosedError: the controller has exited.
        """
        self._channel.send(protocol.Ready(rmw=rclpy_tools.loaded_rmw()))
        while True:
            self._read_answers(_IDLE_S)
            if not self._channel.wait(0.0):
                continue
            match self._channel.receive():
                case protocol.Play() as play:
                    self._channel.send(protocol.Played(steps=self._play(play)))
                case protocol.CountMatches():
                    counts = {each.plan.service: int(each.is_there()) for each in self._clients}
                    self._channel.send(protocol.Matched(counts=counts))
                case protocol.Shutdown():
                    return

    def _play(self, play: protocol.Play) -> int:
        """Play steps; returns their number, which is smaller if it was stopped."""
        begin_ns = time.monotonic_ns() + _LEAD_NS
        for step in range(play.steps):
            due_ns = begin_ns + round(step * 1e9 / play.rate_hz)
            while (left_s := (due_ns - time.monotonic_ns()) / 1e9) > _EXACT_S:
                self._read_answers(left_s - _EXACT_S)
            time.sleep(max(0.0, left_s))
            # Only `Stop` comes while steps are played.
            if self._channel.wait(0.0) and isinstance(self._channel.receive(), protocol.Stop):
                return step
            self._call_all(due_ns)
        return play.steps

    def _call_all(self, due_ns: int) -> None:
        stamp_ns = self._last_stamp_ns = max(time.time_ns(), self._last_stamp_ns + 1)
        published_ns = time.monotonic_ns()
        for each in self._clients:
            each.send(stamp_ns)
        done_ns = time.monotonic_ns()
        # Before any answer: a step that is answered has been written.
        self._playback.append(stamp_ns, due_ns, published_ns, done_ns, _ALL_INPUTS)

    def _read_answers(self, timeout_s: float) -> None:
        """Wait for an answer, and write all that are there."""
        self._set.clear_entities()
        for each in self._clients:
            self._set.add_client(each.handle)
        self._set.wait(int(timeout_s * 1e9))
        for number, each in enumerate(self._clients):
            if self._set.is_ready("client", number):
                while each.take():
                    pass
