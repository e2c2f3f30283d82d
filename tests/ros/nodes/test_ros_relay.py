"""The relay node, with real messages."""

from __future__ import annotations

from time import perf_counter_ns
from typing import Any

import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time
from node_graph import node_graph
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header, String

from r2bspec.nodes import RelayNode


def serialized(step: int) -> bytes:
    header = Header(stamp=Time(sec=step, nanosec=1), frame_id="a")
    message = Image(header=header, width=3, height=1, encoding="mono8", step=3, data=[step] * 3)
    data: bytes = serialize_message(message)
    return data


@pytest.mark.parametrize("jitter", ["none", "exponential"])
def test_messages_pass_byte_for_byte_and_in_order(jitter: str) -> None:
    # Padding bytes that are not zero are kept too: nothing is taken apart and built anew.
    sent = [serialized(step) for step in range(8)]
    sent[3] = sent[3][:2] + b"\x00\x01" + sent[3][4:]
    with node_graph() as graph:
        graph.add(RelayNode, parameters={"service_time_ms": 1.0, "jitter": jitter, "seed": 4})
        heard = graph.listen(Image, "output", raw=True)
        writer = graph.writer(Image, "input")
        for data in sent:
            writer.publish(data)
        graph.spin_until(lambda: len(heard) == len(sent))
    assert [data[4:] for data in heard] == [data[4:] for data in sent]
    assert [data for index, data in enumerate(heard) if index != 3] == [
        data for index, data in enumerate(sent) if index != 3
    ]


@pytest.mark.parametrize("kind", [String, PointCloud2])
def test_the_format_is_a_parameter(kind: Any) -> None:
    name = f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
    with node_graph() as graph:
        graph.add(RelayNode, parameters={"format": name})
        heard = graph.listen(kind, "output", raw=True)
        data = serialize_message(kind())
        graph.writer(kind, "input").publish(data)
        graph.spin_until(lambda: heard)
    assert heard == [data]


@pytest.mark.parametrize("spin", [True, False])
def test_a_message_takes_its_service_time_at_least(spin: bool) -> None:
    with node_graph() as graph:
        graph.add(RelayNode, parameters={"service_time_ms": 20.0, "spin": spin})
        heard = graph.listen(Image, "output", raw=True)
        writer = graph.writer(Image, "input")
        start_ns = perf_counter_ns()
        for step in range(5):
            writer.publish(serialized(step))
        graph.spin_until(lambda: len(heard) == 5)
    assert perf_counter_ns() - start_ns >= 5 * 20_000_000


def test_the_queue_depth_is_that_of_both_topics() -> None:
    with node_graph() as graph:
        node = graph.add(RelayNode, parameters={"queue_depth": 3})
        endpoints: list[Any] = [*node.publishers, *node.subscriptions]
        depths = {endpoint.topic_name: endpoint.qos_profile.depth for endpoint in endpoints}
    assert (depths["/input"], depths["/output"]) == (3, 3)
