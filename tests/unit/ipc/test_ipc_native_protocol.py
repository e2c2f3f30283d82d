"""Commands of native parts are words and replies are lines; schedules and playbacks are files."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import pytest

from r2bspec.ipc import protocol
from r2bspec.ipc.buffers import TF, TF_STATIC, TF_TYPE, BufferWriter
from r2bspec.ipc.native_protocol import NativeCodec
from r2bspec.ipc.playback_file import ENTRY_DTYPE, HEADER_BYTES, PlaybackReader
from r2bspec.ipc.schedule import BetweenMessage, CyclicSchedule
from r2bspec.language.spec import QoS
from r2bspec.plan.package_advice import ros_package_advice
from r2bspec.plan.plan import InputPlan, MonitorPlan
from r2bspec.record.sample_arrays import PLAYBACK_FIELDS
from transform_bags import transforms

IMAGE = "sensor_msgs/msg/Image"
IMAGE_WORDS = (
    "libsensor_msgs__rosidl_typesupport_c.so",
    "rosidl_typesupport_c__get_message_type_support_handle__sensor_msgs__msg__Image",
    IMAGE,
)
TF_WORDS = (
    "libtf2_msgs__rosidl_typesupport_c.so",
    "rosidl_typesupport_c__get_message_type_support_handle__tf2_msgs__msg__TFMessage",
    TF_TYPE,
)
OUT = MonitorPlan(name="out", topic="/out", type=IMAGE, match="stamp", qos=QoS())
NAMED = msgspec.structs.replace(OUT, name="b", qos=QoS(reliability="best_effort", depth=3))
INPUT = InputPlan(topic="/in", type=IMAGE, source="/loaded", bag_topic="", qos=QoS())


def words(command: object, codec: NativeCodec | None = None) -> list[str]:
    text = (codec or NativeCodec()).encode(command)
    assert text.endswith(b"\0")
    return [os.fsdecode(each) for each in text[:-1].split(b"\0")]


def player(folder: Path, *topics: str) -> protocol.ConfigurePlayer:
    return protocol.ConfigurePlayer(
        inputs=(INPUT,),
        buffer_dir=str(folder),
        rows=str(folder / "played"),
        transforms=topics,
    )


def write_buffer(folder: Path, topic: str, kind: str, *messages: bytes) -> None:
    writer = BufferWriter(folder, topic, kind, has_header=True)
    for number, data in enumerate(messages):
        writer.append(number, data)
    writer.close()


@pytest.fixture
def codec(tmp_path: Path) -> NativeCodec:
    """That of a player, for which five messages are buffered."""
    write_buffer(tmp_path, "/loaded", IMAGE, *[bytes(20)] * 5)
    codec = NativeCodec()
    codec.encode(player(tmp_path))
    return codec


def test_topics_have_the_paths_of_their_rows() -> None:
    codec = NativeCodec()
    folder = "/a b\n%c/\N{SNOWMAN}\udcff"
    assert words(protocol.ConfigureMonitor(monitors=(), rows_dir=folder)) == [
        *("monitor", f"{folder}/monitor.held", "0"),
    ]
    codec.encode(protocol.ConfigureMonitor(monitors=(), rows_dir="/a rows"))
    named = (*IMAGE_WORDS, "/a rows/b.rows", "2", "2", "1", "3", "0", "0", "1", "0", "/out")
    rows, qos = "/a rows/out.rows", ("1", "2", "1", "10", "0", "0", "1", "0", "/out")
    assert words(protocol.Subscribe(monitors=(NAMED, OUT)), codec) == [
        *("subscribe", "2", *named, *IMAGE_WORDS, rows, *qos),
    ]
    assert words(protocol.StartTap(monitors=(OUT,)), codec) == [
        *("start_tap", "1", *IMAGE_WORDS, rows, *qos),
    ]
    with pytest.raises(ValueError, match="known quality of service"):
        words(protocol.Subscribe(monitors=(msgspec.structs.replace(OUT, qos=None),)), codec)


def test_a_player_has_its_inputs_and_transforms_after_them(tmp_path: Path) -> None:
    own = [*IMAGE_WORDS, "1", "2", "1", "10", "0", "0", "1", "0", "/in", f"{tmp_path}/loaded.cdr"]
    assert words(player(tmp_path)) == ["player", "1", *own]
    tf = [*TF_WORDS, "1", "2", "1", "100", "0", "0", "1", "0", "/tf", f"{tmp_path}/tf.cdr"]
    assert words(player(tmp_path, TF, TF_STATIC)) == ["player", "2", *own, *tf]


def followed(folder: Path, codec: NativeCodec, schedule: CyclicSchedule) -> list[list[int]]:
    """Of each entry of the playlist: source, offset, size, place, what is added to the stamp."""
    path = Path(words(protocol.LoadSchedule(schedule=schedule), codec)[1])
    assert path.parent == folder
    return [
        [int(each[name]) for name in ("source", "offset", "size", "place", "add_ns")]
        for each in played(path)
    ]


def played(path: Path) -> Any:
    return np.fromfile(path, dtype=ENTRY_DTYPE, offset=HEADER_BYTES)


@pytest.mark.parametrize(
    ("timestamp", "header", "size", "place"),
    [("header", 1, 20, 4), ("header", 0, 20, -1), ("header", 1, 11, -1), ("none", 1, 20, -1)],
)
def test_a_header_gets_the_stamp_where_there_is_one(
    tmp_path: Path, timestamp: Literal["header", "none"], header: int, size: int, place: int
) -> None:
    write_buffer(tmp_path, "/loaded", IMAGE, bytes(size))
    codec = NativeCodec()
    given = msgspec.structs.replace(INPUT, timestamp=timestamp)
    codec.encode(msgspec.structs.replace(player(tmp_path), inputs=(given,)))
    assert codec.decode(f"ready {header}".encode()) == protocol.Ready(headers={"/in": bool(header)})
    found = followed(tmp_path, codec, CyclicSchedule(steps=((0,),)))
    assert found == [[0, 0, size, place, 0]]


def test_a_playback_goes_on_where_the_last_one_was_stopped(
    tmp_path: Path, codec: NativeCodec
) -> None:
    schedule = CyclicSchedule(steps=tuple((n,) for n in range(5)))
    followed(tmp_path, codec, schedule)
    rows = PlaybackReader(tmp_path / "played", PLAYBACK_FIELDS)
    for number, first, complete in ((1, 0, 3), (2, 3, 4), (3, 2, 0)):
        path = tmp_path / f"played-{number}"
        assert words(protocol.Play(rate_hz=10.0, steps=4), codec) == ["play", str(path)]
        found = played(path)
        assert found["offset"].tolist() == [20 * ((first + n) % 5) for n in range(4)]
        assert found["step"].tolist() == [0, 1, 2, 3]
        assert found["due_ns"].tolist() == [n * 10**8 for n in range(4)]
        # The player publishes so many of them.
        np.memmap(path, dtype="<i8", mode="r+", shape=(1,))[0] = complete
    assert rows.count() == 7
    followed(tmp_path, codec, schedule)
    codec.encode(protocol.Play(rate_hz=10.0, steps=1))
    assert played(tmp_path / "played-4")["offset"].tolist() == [0]


def test_the_counts_of_a_player_are_those_of_its_inputs_and_transforms(tmp_path: Path) -> None:
    codec = NativeCodec()
    codec.encode(player(tmp_path, TF_STATIC, TF))
    assert codec.decode(b"ready 1 0\n") == protocol.Ready(headers={"/in": True})
    assert codec.decode(b"matched 2 1\n") == protocol.Matched(counts={"/in": 2, TF: 1})
    assert codec.decode(b"played 17\n") == protocol.Played(steps=17)
    write_buffer(tmp_path, "/loaded", IMAGE, bytes(20))
    followed(tmp_path, codec, CyclicSchedule(steps=((0,),)))
    assert codec.decode(b"played 0\n") == protocol.Ready()
    codec.encode(protocol.Play(rate_hz=1.0, steps=1))
    assert codec.decode(b"played 1\n") == protocol.Played(steps=1)


def test_the_counts_of_a_monitor_are_those_of_its_topics_and_of_what_is_watched() -> None:
    codec = NativeCodec()
    a, b, c, d = (msgspec.structs.replace(OUT, topic=f"/{each}") for each in "abcd")
    codec.encode(protocol.ConfigureMonitor(monitors=(a, d), rows_dir="/rows"))
    assert codec.decode(b"ready rmw_fastrtps_cpp") == protocol.Ready(rmw="rmw_fastrtps_cpp")
    codec.encode(protocol.Subscribe(monitors=(a,)))
    assert codec.decode(b"matched 1") == protocol.Matched(counts={"/a": 1})
    codec.encode(protocol.StartTap(monitors=(b, c)))
    assert codec.decode(b"matched 3 -1 1") == protocol.Matched(counts={"/a": 1, "/c": 3})
    codec.encode(protocol.Subscribe(monitors=(d,)))
    assert codec.decode(b"matched 2 3 -1 1") == protocol.Matched(counts={"/a": 1, "/c": 3, "/d": 2})
    codec.encode(protocol.StopTap())
    assert codec.decode(b"matched 1 0") == protocol.Matched(counts={"/a": 0, "/d": 1})


@pytest.mark.parametrize(
    ("line", "code", "message", "hint"),
    [
        (
            b"failed R2B681 message type a_msgs/msg/\xff is not installed\n",
            "R2B681",
            "message type a_msgs/msg/\ufffd is not installed",
            ros_package_advice("a_msgs"),
        ),
        (b"failed R2B630 x", "R2B630", "x", ""),
        (
            b"failed errno %d /a: b\xff: No room\n" % errno.ENOSPC,
            "R2B651",
            "/a: b\ufffd cannot be written: No room",
            "Make room on that disk",
        ),
        (b"failed errno %d memory: No more\n" % errno.ENOMEM, "R2B630", "memory: No more", ""),
    ],
)
def test_a_failure_has_its_code_a_text_and_what_to_do(
    line: bytes, code: str, message: str, hint: str
) -> None:
    found = NativeCodec().decode(line)
    assert isinstance(found, protocol.Failed)
    assert (found.code, found.message) == (code, message)
    assert hint in found.hint
    assert bool(hint) == bool(found.hint)


def test_damaged_transforms_are_an_error(tmp_path: Path) -> None:
    stamp = 5 * 10**9 + 7
    one, two = (transforms(*[("m", "n", stamp)] * count) for count in (1, 2))
    write_buffer(tmp_path, "/loaded", IMAGE, bytes(20))
    schedule = CyclicSchedule(steps=((0,),), between=(BetweenMessage(0.5, 1, 0, 10),))
    codec = NativeCodec()
    codec.encode(player(tmp_path, TF))
    for message, places in ((one, [8]), (two, [8, 92])):
        write_buffer(tmp_path, TF, TF_TYPE, message)
        assert followed(tmp_path, codec, schedule)[1:] == [
            [1, 0, len(message), place, stamp - 10] for place in places
        ]
    write_buffer(tmp_path, TF, TF_TYPE, one[:50])
    with pytest.raises(ValueError, match="/tf is truncated"):
        codec.encode(protocol.LoadSchedule(schedule=schedule))


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (protocol.ListGraph(), "no command of a native part: ListGraph"),
        (protocol.Subscribe(monitors=(OUT,)), "configured before it gets topics"),
        (protocol.LoadSchedule(schedule=CyclicSchedule(steps=((0,),))), "configured before"),
        (protocol.Play(rate_hz=1.0, steps=1), "before it plays"),
    ],
)
def test_what_a_native_part_does_not_know_is_an_error(command: object, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        words(command)
