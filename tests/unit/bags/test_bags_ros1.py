"""ROS 1 recordings are read as what ROS 2 would have recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from data_bags import START_NS, refusal_of, typestore
from r2bspec.bags.bag_index import index_bag
from r2bspec.bags.bag_reader import read_messages
from r2bspec.bags.recording import DataError

IMAGE = "sensor_msgs/msg/Image"


@pytest.fixture
def store() -> Any:
    return get_typestore(Stores.ROS1_NOETIC)


def header(store: Any, number: int) -> Any:
    stamp = store.types["builtin_interfaces/msg/Time"](1_700_000_000 + number, 5)
    return store.types["std_msgs/msg/Header"](77, stamp, "camera")


def record(path: Path, store: Any, messages: list[tuple[str, str, Any]], **more: Any) -> Path:
    """Write messages of ROS 1, 10 ms apart; (topic, type, message or bytes)."""
    with Writer(path) as writer:
        connections: dict[str, Any] = {}
        for number, (topic, kind, message) in enumerate(messages):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store, **more)
            raw = message if isinstance(message, bytes) else store.serialize_ros1(message, kind)
            writer.write(connections[topic], START_NS + number * 10_000_000, raw)
    return path


def only(bag: Path, topic: str) -> Any:
    (message,) = read_messages(bag, [topic])
    return message


def test_an_image_keeps_all_but_the_sequence_number(tmp_path: Path, store: Any) -> None:
    pixels = np.arange(12, dtype=np.uint8)
    message = store.types[IMAGE](header(store, 3), 2, 2, "rgb8", 0, 6, pixels)
    bag = record(tmp_path / "old.bag", store, [("/image", "sensor_msgs/msg/Image", message)])
    index = index_bag(bag)
    assert (index.storage, index.notes) == (
        "ros1",
        ("recorded by ROS 1: messages are converted to those of ROS 2",),
    )
    info = index.topics["/image"]
    assert (info.type, info.serialization, info.count) == (IMAGE, "cdr", 1)

    found = typestore().deserialize_cdr(only(bag, "/image").data, IMAGE)
    assert not hasattr(found.header, "seq")
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (1_700_000_003, 5)
    assert found.header.frame_id == "camera"
    assert (found.height, found.width, found.encoding, found.step) == (2, 2, "rgb8", 6)
    assert found.data.tolist() == pixels.tolist()
    assert only(bag, "/image").data == bytes(typestore().serialize_cdr(found, IMAGE))


def test_transforms_get_the_name_that_ros2_knows(tmp_path: Path, store: Any) -> None:
    kinds = store.types
    vector = kinds["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0)
    turn = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    stamped = kinds["geometry_msgs/msg/TransformStamped"](
        header(store, 0), "base", kinds["geometry_msgs/msg/Transform"](vector, turn)
    )
    definition = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(definition, "tf/msg/tfMessage"))
    message = store.types["tf/msg/tfMessage"]([stamped, stamped])
    bag = record(tmp_path / "old.bag", store, [("/tf", "tf/msg/tfMessage", message)])
    assert index_bag(bag).topics["/tf"].type == "tf2_msgs/msg/TFMessage"
    found = typestore().deserialize_cdr(only(bag, "/tf").data, "tf2_msgs/msg/TFMessage")
    assert [transform.child_frame_id for transform in found.transforms] == ["base", "base"]
    assert found.transforms[1].transform.translation.y == 2.0


def test_a_type_that_changed_its_layout_is_migrated(
    tmp_path: Path, store: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    # ROS 2 added fields to BatteryState's cousin Range: 'variance', since Jazzy.
    kind = "sensor_msgs/msg/Range"
    message = store.types[kind](header(store, 0), 1, 0.5, 0.1, 4.0, 2.5)
    bag = record(tmp_path / "old.bag", store, [("/range", kind, message)])
    found = typestore().deserialize_cdr(only(bag, "/range").data, kind)
    assert found.range == 2.5
    assert found.max_range == 4.0
    assert found.variance == 0.0
    # The libraries below print, and standard output belongs to results.
    assert capsys.readouterr().out == ""


def test_a_type_of_ones_own_is_converted_by_its_recorded_definition(
    tmp_path: Path, store: Any
) -> None:
    kind = "my_robot/msg/Wheel"
    text = "std_msgs/Header header\nuint8 number\nfloat64[] angles\nstring[] names\n"
    store.register(get_types_from_msg(text, kind))
    message = store.types[kind](header(store, 1), 7, np.array([1.5, 2.5]), ["left", "right"])
    bag = record(tmp_path / "old.bag", store, [("/wheel", kind, message)])
    target = get_typestore(Stores.ROS2_JAZZY)
    target.register(get_types_from_msg(text, kind))
    found: Any = target.deserialize_cdr(only(bag, "/wheel").data, kind)
    assert (found.number, found.angles.tolist(), found.names) == (7, [1.5, 2.5], ["left", "right"])
    assert found.header.stamp.sec == 1_700_000_001


def test_a_definition_that_cannot_be_read_is_no_stack_trace(tmp_path: Path, store: Any) -> None:
    kind = "std_msgs/msg/String"
    message = store.types[kind]("hello")
    bag = record(tmp_path / "old.bag", store, [("/good", kind, message), ("/bad", kind, message)])
    content = bag.read_bytes()
    place = content.rindex(b"string data")
    bag.write_bytes(content[:place] + b"strin\0 data" + content[place + 11 :])
    assert index_bag(bag).message_count == 2
    with pytest.raises(DataError, match="cannot be converted to ROS 2") as caught:
        list(read_messages(bag, ["/bad"]))
    assert caught.value.code == "R2B306"


def test_a_message_that_is_not_of_its_type_is_damage(tmp_path: Path, store: Any) -> None:
    bag = record(tmp_path / "old.bag", store, [("/talk", "std_msgs/msg/String", b"\xff\0\0\0abc")])
    assert refusal_of(lambda: list(read_messages(bag, ["/talk"]))).code == "R2B304"
