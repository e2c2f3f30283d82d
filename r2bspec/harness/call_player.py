"""The player that calls services and actions in its steps, or in those of a player of topics.

The load is open: a request is sent whether or not earlier ones are answered. A step is written as a
step of a playback, and an answer as a message of a monitor with the stamp of its step, so that what
is computed of them is what is computed of topics: latencies from the request and from its due time,
and answers that never came.

Requests are made of what the spec states, or of those of a recording, in turn or at their times.

The steps of another player are seen in the file that it writes. What passes until they are is taken
from the times of the answers: the graph has no part in it.

Answers are read without an executor, which would take a multiple of the time. Their times are those
at which the middleware received them.
"""

from __future__ import annotations

import itertools
import sys
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from rclpy.impl.implementation_singleton import rclpy_implementation as _implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from r2bspec.harness import rclpy_tools
from r2bspec.harness.control_channel import Channel
from r2bspec.harness.service_client import ServiceCallError, fill_message
from r2bspec.ipc import protocol
from r2bspec.ipc.buffers import read_messages
from r2bspec.ipc.playback_file import PlaybackReader
from r2bspec.ipc.sample_files import ARRIVAL_FIELDS, RowWriter, read_clocks
from r2bspec.ipc.schedule import ALL_INPUTS, TimelineMessage
from r2bspec.plan.plan import CallPlan
from r2bspec.record.sample_arrays import PLAYBACK_FIELDS

_LEAD_NS = 20_000_000
"""From the command to the first request."""

_IDLE_S = 0.01
"""Between two looks for a command while nothing is played."""

_EXACT_S = 0.0005
"""Waiting for answers ends so long before a request is due: it may take longer than it is told."""

_LONGEST_WAIT_S = 0.25
"""For answers, without a look for a command."""

_BETWEEN_LOOKS_S = 0.0005
"""Between two looks at what another player has played."""

_CALLS = QoSProfile(depth=1000)
"""Of the client: requests that wait for a busy service are not overwritten on this side."""

_SUCCEEDED = 4
"""action_msgs/msg/GoalStatus.STATUS_SUCCEEDED."""


class _Step(NamedTuple):
    """A step in which services are called.

    Attributes:
        stamp_ns: that of its inputs.
        late_ns: how long after its beginning the calls begin.
    """

    stamp_ns: int
    late_ns: int = 0


class _Answers:
    """The rows of one monitor: answers, each with the stamp of its step."""

    def __init__(self, rows_dir: Path, monitor: str) -> None:
        self._rows = RowWriter(rows_dir / f"{monitor}.rows", len(ARRIVAL_FIELDS))

    def add(self, step: _Step, received_ns: int) -> None:
        """Write an answer that the middleware received at this system time."""
        taken_ns, difference_ns = read_clocks()
        received_ns, taken_ns = received_ns - step.late_ns, taken_ns - step.late_ns
        self._rows.append(step.stamp_ns, received_ns, taken_ns, 0, difference_ns)


class _Exchange:
    """Sends requests to one service, and takes what it answers."""

    def __init__(
        self, node: Node, kind: Any, service: str, on_answer: Callable[[Any, int, Any], None]
    ) -> None:
        """Create the client.

        Args:
            node: the node of the player.
            kind: the class of the service.
            service: its full name.
            on_answer: gets what the request was sent with, the time of reception on the system
                clock in ns, and the response.
        """
        self._kind = kind
        self._on_answer = on_answer
        self._client = node.create_client(kind, service, qos_profile=_CALLS)
        self._waiting: dict[int, Any] = {}
        self.handle: Any = self._client.handle

    def is_there(self) -> bool:
        """Return whether a node offers the service."""
        return bool(self._client.service_is_ready())

    def send(self, request: Any, sent_with: Any) -> None:
        """Send a request; its answer comes with `sent_with`."""
        self._waiting[self.handle.send_request(request)] = sent_with

    def take(self) -> bool:
        """Take the next answer; False if there is none."""
        info, response = self.handle.take_response(self._kind.Response)
        if info is None:
            return False
        sent_with = self._waiting.pop(info.request_id.sequence_number, None)
        if sent_with is not None:
            self._on_answer(sent_with, info.received_timestamp, response)
        return True


class _Feedback:
    """Takes the feedback of an action."""

    def __init__(
        self, node: Node, kind: Any, topic: str, on_feedback: Callable[[bytes, int], None]
    ) -> None:
        self._kind = kind
        self._on_feedback = on_feedback
        # The callback is never called, because no executor has this node.
        subscription = node.create_subscription(kind, topic, lambda _message: None, _CALLS)
        self.handle: Any = subscription.handle

    def take(self) -> bool:
        """Take the next message; False if there is none."""
        taken = self.handle.take_message(self._kind, False)
        if taken is None:
            return False
        message, info = taken
        self._on_feedback(bytes(message.goal_id.uuid), int(info["received_timestamp"]))
        return True


class _Call:
    """What a service and an action have in common."""

    exchanges: tuple[_Exchange, ...]
    feedback: tuple[_Feedback, ...] = ()

    def __init__(self, plan: CallPlan, requests: list[Any]) -> None:
        self.target = plan.target
        self.is_recorded = bool(plan.source)
        self._requests = requests
        self._turns = itertools.cycle(range(len(requests)))
        self._every = 1 if plan.every is msgspec.UNSET else plan.every
        self._steps = 0
        self._has_failed = False

    def is_there(self) -> bool:
        """Return whether a node offers all of it."""
        return all(exchange.is_there() for exchange in self.exchanges)

    def take_step(self, step: _Step, position: int | None = None) -> None:
        """Send the request at a position, or the next one, if the step is the last of one call."""
        self._steps += 1
        if self._steps % self._every == 0:
            self.send(step, self._requests[next(self._turns) if position is None else position])

    def send(self, step: _Step, request: Any) -> None:
        """Send a request, or a goal, in a step."""
        raise NotImplementedError

    def _say_failed(self, response: Any) -> None:
        """Write the first answer that does not count to the log."""
        if not self._has_failed:
            self._has_failed = True
            sys.stderr.write(f"{self.target}: the first call that failed got {response}\n")


def _requests(plan: CallPlan, buffer_dir: Path, service: Any, make: Callable[[], Any]) -> list[Any]:
    """Return the requests or the goals of a call, in turn.

    Args:
        plan: the plan of the call.
        buffer_dir: has the recorded requests.
        service: the class of the service that takes them.
        make: makes one with the defaults of its type.

    Raises:
        ServiceCallError: a stated field, or a recorded request, is not of this type.
    """
    if not plan.source:
        return [fill_message(make(), fields) for fields in plan.requests]
    (stated,) = plan.requests
    requests = []
    for data in read_messages(buffer_dir, plan.source).values():
        try:
            (request,) = deserialize_message(bytes(data), service.Event).request
        except Exception as error:
            # rclpy raises RMWError, which is no public class, and others.
            raise ServiceCallError(
                f"playback.calls.{plan.name}: a recorded request cannot be read as {plan.type} of "
                f"this machine ({error}); was it recorded with another version of the type?"
            ) from error
        requests.append(fill_message(request.goal if plan.accepted else request, stated))
    return requests


class _ServiceCall(_Call):
    def __init__(self, node: Node, plan: CallPlan, rows_dir: Path, buffer_dir: Path) -> None:
        """Create the client.

        Raises:
            TypeNotFoundError: the type is not installed.
            ServiceCallError: it has no such fields, or a recorded request is not of this type.
        """
        kind = rclpy_tools.interface_class(plan.type)
        super().__init__(plan, _requests(plan, buffer_dir, kind, kind.Request))
        self._success = plan.success
        success = kind.Response.get_fields_and_field_types().get(plan.success)
        if plan.success and success != "boolean":
            what = f"is of type {success}" if success else "does not exist"
            raise ServiceCallError(
                f"playback.calls.{plan.name}: field {plan.success!r} of the response {what}, and "
                "'success' needs a boolean"
            )
        self._answers = _Answers(rows_dir, plan.name)
        self.exchanges = (_Exchange(node, kind, plan.target, self._on_answer),)

    def send(self, step: _Step, request: Any) -> None:
        self.exchanges[0].send(request, step)

    def _on_answer(self, step: _Step, received_ns: int, response: Any) -> None:
        if self._success and not getattr(response, self._success):
            self._say_failed(response)
        else:
            self._answers.add(step, received_ns)


class _ActionCall(_Call):
    """A goal, its acceptance, its result, which is asked for at once, and its feedback."""

    def __init__(self, node: Node, plan: CallPlan, rows_dir: Path, buffer_dir: Path) -> None:
        """Create the clients.

        Raises:
            TypeNotFoundError: the type is not installed.
            ServiceCallError: it has no such fields, or a recorded goal is not of this type.
        """
        kind = self._kind = rclpy_tools.interface_class(plan.type)
        super().__init__(plan, _requests(plan, buffer_dir, kind.Impl.SendGoalService, kind.Goal))
        self._accepted = _Answers(rows_dir, plan.accepted)
        self._results = _Answers(rows_dir, plan.name)
        inner = self._kind.Impl
        name = f"{plan.target}/_action"
        self.exchanges = (
            _Exchange(node, inner.SendGoalService, f"{name}/send_goal", self._on_accepted),
            _Exchange(node, inner.GetResultService, f"{name}/get_result", self._on_result),
        )
        self._goal_steps: dict[bytes, _Step] = {}
        if plan.feedback:
            self._feedback = _Answers(rows_dir, plan.feedback)
            topic = f"{name}/feedback"
            self.feedback = (_Feedback(node, inner.FeedbackMessage, topic, self._on_feedback),)

    def send(self, step: _Step, request: Any) -> None:
        goal_id, goal = uuid.uuid4().bytes, request
        request = self._kind.Impl.SendGoalService.Request(goal=goal)
        request.goal_id.uuid = list(goal_id)
        self._goal_steps[goal_id] = step
        self.exchanges[0].send(request, goal_id)

    def _on_accepted(self, goal_id: bytes, received_ns: int, response: Any) -> None:
        if not response.accepted:
            del self._goal_steps[goal_id]
            self._say_failed(response)
            return
        request = self._kind.Impl.GetResultService.Request()
        request.goal_id.uuid = list(goal_id)
        self.exchanges[1].send(request, goal_id)
        self._accepted.add(self._goal_steps[goal_id], received_ns)

    def _on_result(self, goal_id: bytes, received_ns: int, response: Any) -> None:
        step = self._goal_steps.pop(goal_id)
        if response.status == _SUCCEEDED:
            self._results.add(step, received_ns)
        else:
            self._say_failed(response)

    def _on_feedback(self, goal_id: bytes, received_ns: int) -> None:
        # What comes after the result, or to others, is not waited for.
        if goal_id in self._goal_steps:
            self._feedback.add(self._goal_steps[goal_id], received_ns)


class _FollowedSteps:
    """The steps of another player, from now on.

    Args:
        rows: as in `r2bspec.ipc.playback_file.PlaybackReader`.

    Attributes:
        latest_ns: the longest time after which a step was seen.
    """

    def __init__(self, rows: Path) -> None:
        self._reader = PlaybackReader(rows, PLAYBACK_FIELDS)
        self._taken = self._reader.count()
        self.latest_ns = 0

    def take(self) -> list[_Step]:
        """Return the steps that have been played since the last call."""
        if self._reader.count() <= self._taken:
            return []
        rows = self._reader.read(self._taken)
        self._taken += rows.size
        begun = rows["published_ns"].tolist()
        now_ns = time.monotonic_ns()
        stamps = rows["stamp_ns"].tolist()
        self.latest_ns = max(self.latest_ns, now_ns - begun[0])
        return [_Step(stamp, now_ns - ns) for stamp, ns in zip(stamps, begun, strict=True)]


class CallPlayer:
    """Calls services and actions in steps."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureCalls) -> None:
        self._channel = channel
        self._followed = _FollowedSteps(Path(settings.follows)) if settings.follows else None
        self._node = rclpy_tools.start_node("caller" if settings.follows else "player")
        folder, buffers = Path(settings.rows_dir), Path(settings.buffer_dir)
        self._calls = [
            (_ActionCall if plan.accepted else _ServiceCall)(self._node, plan, folder, buffers)
            for plan in settings.calls
        ]
        self._timeline = settings.timeline
        self._recorded = [call for call in self._calls if call.is_recorded]
        self._exchanges = [exchange for call in self._calls for exchange in call.exchanges]
        self._feedback = [each for call in self._calls for each in call.feedback]
        if self._followed is None:
            self._playback = RowWriter(folder / protocol.CALLED_ROWS, len(PLAYBACK_FIELDS))
        self._last_stamp_ns = 0
        self._is_over = False
        handle = self._node.context.handle
        self._set = _implementation.WaitSet(
            len(self._feedback), 0, 0, len(self._exchanges), 0, 0, handle
        )

    def serve(self) -> None:
        """Play, and read answers at the same time, until the command to shut down.

        Raises:
            ChannelClosedError: the controller has exited.
        """
        self._channel.send(protocol.Ready(rmw=rclpy_tools.loaded_rmw()))
        while not self._is_over:
            self._read_answers(_IDLE_S if self._followed is None else _BETWEEN_LOOKS_S)
            for step in self._followed.take() if self._followed is not None else ():
                for call in self._calls:
                    call.take_step(step)
            if not self._channel.wait(0.0):
                continue
            match self._channel.receive():
                case protocol.Play() as play:
                    self._channel.send(protocol.Played(steps=self._play(play)))
                case protocol.CountMatches():
                    counts = {call.target: int(call.is_there()) for call in self._calls}
                    self._channel.send(protocol.Matched(counts=counts))
                case protocol.Shutdown():
                    self._is_over = True
        if self._followed is not None:
            latest_ms = self._followed.latest_ns / 1e6
            sys.stderr.write(f"calls began up to {latest_ms:.3f} ms after their steps\n")

    def _play(self, play: protocol.Play) -> int:
        """Play steps; returns their number, which is smaller if it was stopped."""
        begin_ns = time.monotonic_ns() + _LEAD_NS
        for step in range(play.steps):
            message = self._timeline.message_of(step) if self._timeline is not None else None
            offset_ns = round(step * 1e9 / play.rate_hz) if message is None else message.offset_ns
            offset_ns += play.delays_ns[step] if play.delays_ns else 0
            if not self._wait_until(begin_ns + offset_ns):
                return step
            self._call_all(begin_ns + offset_ns, message)
        return play.steps

    def _wait_until(self, due_ns: int) -> bool:
        """Read answers until then; False if the playback is to be stopped."""
        while (left_s := (due_ns - time.monotonic_ns()) / 1e9) > _EXACT_S:
            self._read_answers(min(left_s - _EXACT_S, _LONGEST_WAIT_S))
            if self._is_stopped():
                return False
        time.sleep(max(0.0, left_s))
        return not self._is_stopped()

    def _is_stopped(self) -> bool:
        if not self._channel.wait(0.0):
            return False
        # Only `Stop` comes while steps are played, or the end of the run.
        self._is_over = isinstance(self._channel.receive(), protocol.Shutdown)
        return True

    def _call_all(self, due_ns: int, message: TimelineMessage | None) -> None:
        stamp_ns = self._last_stamp_ns = max(time.time_ns(), self._last_stamp_ns + 1)
        step = _Step(stamp_ns)
        published_ns = time.monotonic_ns()
        recorded = self._recorded[message.input] if message is not None else None
        for call in self._calls:
            if message is not None and call is recorded:
                call.take_step(step, message.position)
            elif message is None or call not in self._recorded:
                call.take_step(step)
        done_ns = time.monotonic_ns()
        inputs = ALL_INPUTS if message is None else 1 << message.input
        # Before any answer: a step that is answered has been written.
        self._playback.append(stamp_ns, due_ns, published_ns, done_ns, inputs)

    def _read_answers(self, timeout_s: float) -> None:
        """Wait for an answer, and write all that are there."""
        self._set.clear_entities()
        for exchange in self._exchanges:
            self._set.add_client(exchange.handle)
        for feedback in self._feedback:
            self._set.add_subscription(feedback.handle)
        self._set.wait(int(timeout_s * 1e9))
        # Feedback first: with the result, its goal is forgotten.
        ready: list[_Exchange | _Feedback] = [
            *(e for n, e in enumerate(self._feedback) if self._set.is_ready("subscription", n)),
            *(e for n, e in enumerate(self._exchanges) if self._set.is_ready("client", n)),
        ]
        for each in ready:
            while each.take():
                pass
