"""The observer: says what discovery shows of the graph, and records whole messages, on request.

Nothing here is timed. It publishes /tf_static and /clock where the spec has them. Between requests
it only looks, five times a second and for microseconds, for publishers that are no process's of the
run.
"""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node

from r2bspec.harness import rclpy_tools
from r2bspec.harness.clock_publisher import ClockPublisher
from r2bspec.harness.control_channel import Channel
from r2bspec.harness.message_recorder import MessageRecorder
from r2bspec.harness.observer_queries import discover, list_graph
from r2bspec.harness.parameter_lists import list_parameters
from r2bspec.harness.publisher_guard import LOOK_PERIOD_S, PublisherGuard
from r2bspec.harness.static_transforms import publish_static_transforms
from r2bspec.ipc import protocol
from r2bspec.ipc.stamps import TF_STATIC


class Observer:
    """Answers questions about nodes, topics and publishers."""

    def __init__(self, channel: Channel, settings: protocol.ConfigureObserver) -> None:
        self._channel = channel
        self._node = rclpy_tools.start_node("observer")
        self._clock = ClockPublisher(self._node) if settings.clock else None
        self._static_publisher = (
            publish_static_transforms(self._node, Path(settings.static_dir))
            if settings.static_dir
            else None
        )
        self._guard = PublisherGuard(self._node, settings.guarded)
        # Without topics to guard there is nothing to look at.
        self._period_s = LOOK_PERIOD_S if settings.guarded else None
        self._recorder: MessageRecorder | None = None

    def serve(self) -> None:
        """Answer commands until told to shut down."""
        try:
            self._serve()
        finally:
            if self._clock is not None:
                self._clock.close()

    def _serve(self) -> None:
        self._channel.send(protocol.Ready(rmw=rclpy_tools.loaded_rmw()))
        while True:
            if not self._channel.wait(self._period_s):
                self._guard.look()
                continue
            match self._channel.receive():
                case protocol.Discover(topics=topics):
                    self._channel.send(discover(self._node, topics))
                case protocol.ListGraph():
                    self._channel.send(list_graph(self._node))
                case protocol.ListParameters() as question:
                    self._channel.send(list_parameters(question))
                case protocol.ListForeign():
                    self._channel.send(protocol.ForeignPublishers(publishers=self._guard.foreign()))
                case protocol.Record(monitors=monitors, folder=folder):
                    self._recorder = MessageRecorder(self._node, monitors, Path(folder))
                    self._send_matches()
                case protocol.EndRecording():
                    recorder, self._recorder = self._recorder, None
                    if recorder is not None:
                        recorder.close()
                    self._send_matches()
                case protocol.CountMatches():
                    self._send_matches()
                case protocol.AwaitStatic():
                    if self._static_publisher is not None:
                        self._static_publisher.wait_for_acknowledgements()
                    self._send_matches()
                case protocol.Shutdown():
                    return
                case _:
                    continue

    def _send_matches(self) -> None:
        counts = self._recorder.matches() if self._recorder is not None else {}
        if self._static_publisher is not None:
            counts |= {TF_STATIC: self._static_publisher.matches()}
        self._channel.send(protocol.Matched(counts=counts))
