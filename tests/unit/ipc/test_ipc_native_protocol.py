"""Messages of native parts are lines of words; a schedule goes into a file."""

from __future__ import annotations

import struct
from pathlib import Path

import msgspec
import pytest

from r2bspec.ipc import protocol
from r2bspec.ipc.buffers import BufferWriter
from r2bspec.ipc.native_protocol import NativeCodec
from r2bspec.ipc.schedule import CyclicSchedule, CyclicTransform
from r2bspec.ipc.transform_stamps import TF, TF_STATIC, TF_TYPE
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import InputPlan, MonitorPlan

IMAGE = "sensor_msgs/msg/Image"
OUT = MonitorPlan(name="out", topic="/out", type=IMAGE, match="stamp", qos=QoS())
NAMED = msgspec.structs.replace(OUT, name="b", qos=QoS(reliability="best_effort", depth=3))
INPUT = InputPlan(topic="/in", type=IMAGE, source="/loaded", bag_topic="", qos=QoS())
TRANSFORM = (
    *(b"\0\1\0\0", struct.pack("<I", 1), struct.pack("<iI", 5, 7)),
    *(2 * (struct.pack("<I", 2) + b"m\0\0\0"), bytes(4), bytes(56)),
)


def line(command: object, codec: NativeCodec | None = None) -> str:
    text = (codec or NativeCodec()).encode(command).decode("ascii")
    assert text.endswith("\n")
    assert text.count("\n") == 1
    return text[:-1]


def player(folder: Path, transforms: tuple[str, ...] = ()) -> protocol.ConfigurePlayer:
    return protocol.ConfigurePlayer(
        inputs=(INPUT,),
        buffer_dir=str(folder),
        rows=str(folder / "played"),
        transforms=transforms,
        clock=bool(transforms),
    )


def write_buffer(folder: Path, topic: str, kind: str, *messages: bytes) -> None:
    writer = BufferWriter(folder, topic, kind, has_header=True)
    for number, data in enumerate(messages):
        writer.append(number, data)
    writer.close()


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        (protocol.Unwatch(), "unwatch"),
        (protocol.CountMatches(), "count"),
        (protocol.Stop(), "stop"),
        (protocol.Shutdown(), "shutdown"),
        (protocol.ConfigureHarness(parts=("player", "monitor")), "harness"),
        (protocol.Play(rate_hz=29.97, steps=100), "play 29.97 100"),
        (
            protocol.ConfigureMonitor(monitors=(OUT, NAMED), rows_dir="/rows"),
            f"monitor /rows 1 {IMAGE}",
        ),
        (
            protocol.Subscribe(monitors=(NAMED, OUT)),
            (
                f"subscribe 2 b /out {IMAGE} best_effort,volatile,keep_last,3 "
                f"out /out {IMAGE} reliable,volatile,keep_last,10"
            ),
        ),
        (
            protocol.Watch(monitors=(OUT,)),
            f"watch 1 out /out {IMAGE} reliable,volatile,keep_last,10",
        ),
        (
            protocol.ConfigureMonitor(monitors=(), rows_dir="/a b\n%c/\N{SNOWMAN}"),
            "monitor /a%20b%0A%25c/%E2%98%83 0",
        ),
    ],
)
def test_a_command_is_one_line_of_words(command: object, expected: str) -> None:
    assert line(command) == expected


def test_a_player_has_its_inputs_and_transforms_after_them(tmp_path: Path) -> None:
    write_buffer(tmp_path, TF_STATIC, TF_TYPE, b"latched")
    qos = "reliable,volatile,keep_last"
    assert line(player(tmp_path)) == (f"player {tmp_path}/played 0  0 1 1 /in {IMAGE} {qos},10 1")
    assert line(player(tmp_path, (TF, TF_STATIC))) == (
        f"player {tmp_path}/played 1 {tmp_path}/tf_static.cdr 7 1 2 "
        f"/in {IMAGE} {qos},10 1 /tf {TF_TYPE} {qos},100 0"
    )


def test_each_schedule_has_a_playlist_of_its_own(tmp_path: Path) -> None:
    write_buffer(tmp_path, "/loaded", IMAGE, bytes(20))
    codec = NativeCodec()
    codec.encode(player(tmp_path))
    schedule = CyclicSchedule(steps=((0,),))
    for number in (1, 2):
        path = tmp_path / f"played.playlist-{number}"
        assert line(protocol.Follow(schedule=schedule), codec) == f"follow {path}"
        assert path.read_bytes().startswith(b"R2BPLAY1")


def test_damaged_transforms_are_an_error(tmp_path: Path) -> None:
    whole = b"".join(TRANSFORM)
    write_buffer(tmp_path, "/loaded", IMAGE, bytes(20))
    schedule = CyclicSchedule(steps=((0,),), transforms=(CyclicTransform(0.5, 0, 0),))
    codec = NativeCodec()
    codec.encode(player(tmp_path, (TF,)))
    write_buffer(tmp_path, TF, TF_TYPE, whole)
    codec.encode(protocol.Follow(schedule=schedule))
    for size in range(8, len(whole), 7):
        write_buffer(tmp_path, TF, TF_TYPE, whole[:size])
        with pytest.raises(ValueError, match="/tf is truncated"):
            codec.encode(protocol.Follow(schedule=schedule))


def test_the_counts_of_a_player_are_those_of_its_inputs_and_transforms(tmp_path: Path) -> None:
    write_buffer(tmp_path, TF_STATIC, TF_TYPE, b"latched")
    codec = NativeCodec()
    codec.encode(player(tmp_path, (TF_STATIC, TF)))
    assert codec.decode(b"ready 1\n") == protocol.Ready(headers={"/in": True})
    assert codec.decode(b"ready") == protocol.Ready()
    found = codec.decode(b"matched 2 1 0\n")
    assert found == protocol.Matched(counts={"/in": 2, "/tf": 1, "/tf_static": 0})
    assert codec.decode(b"played 17\n") == protocol.Played(steps=17)


def test_the_counts_of_a_monitor_are_those_of_its_topics_and_of_what_is_watched() -> None:
    codec = NativeCodec()
    a, b, c, d = (msgspec.structs.replace(OUT, topic=f"/{each}") for each in "abcd")
    codec.encode(protocol.ConfigureMonitor(monitors=(a, d), rows_dir="/rows"))
    assert codec.decode(b"ready rmw_fastrtps_cpp") == protocol.Ready(rmw="rmw_fastrtps_cpp")
    codec.encode(protocol.Subscribe(monitors=(a,)))
    assert codec.decode(b"matched 1") == protocol.Matched(counts={"/a": 1})
    codec.encode(protocol.Watch(monitors=(b, c)))
    assert codec.decode(b"matched 1 - 3") == protocol.Matched(counts={"/a": 1, "/c": 3})
    codec.encode(protocol.Subscribe(monitors=(d,)))
    assert codec.decode(b"matched 1 - 3 2") == protocol.Matched(counts={"/a": 1, "/c": 3, "/d": 2})
    codec.encode(protocol.Unwatch())
    assert codec.decode(b"matched 0 1") == protocol.Matched(counts={"/a": 0, "/d": 1})


def test_a_failure_has_its_code_a_text_and_what_to_do() -> None:
    found = NativeCodec().decode(b"failed R2B651 /a b cannot be written: \xff full\n")
    assert isinstance(found, protocol.Failed)
    assert (found.code, found.message) == ("R2B651", "/a b cannot be written: \ufffd full")
    assert found.hint.startswith("Make room on that disk")
    assert NativeCodec().decode(b"failed R2B630 x") == protocol.Failed(code="R2B630", message="x")


@pytest.mark.parametrize("reply", [b"", b"hello", b"matched 1 2", b"played x", b"\xff\n"])
def test_another_line_is_no_reply(reply: bytes) -> None:
    with pytest.raises((msgspec.DecodeError, ValueError)):
        NativeCodec().decode(reply)


def test_what_a_native_part_does_not_know_is_an_error() -> None:
    with pytest.raises(ValueError, match="no command of a native part: Survey"):
        line(protocol.Survey())
    unknown = msgspec.structs.replace(OUT, qos=None)
    with pytest.raises(ValueError, match="known quality of service"):
        line(protocol.Subscribe(monitors=(unknown,)))
    with pytest.raises(ValueError, match="configured before"):
        line(protocol.Follow(schedule=CyclicSchedule(steps=((0,),))))
