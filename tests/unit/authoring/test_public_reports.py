"""What people reported in public about recordings and graphs, each as a small input of our own.

A recording is tried as a user would: `data info`, `init`, `validate`. What is no recording has its
test where its subject is tested (`ELSEWHERE`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import pytest

from command_line import Call
from command_line import call as call
from data_bags import START_NS, write_mcap
from recorded_inputs import CLOCK, IMAGE, MAP, MS, SCAN, Recorded, S, node, offered, record, series

SCANS = series("/scan", SCAN, 40, 10)
CDR = [(row.topic, row.time_ns - START_NS, row.data) for row in SCANS]
TRANSFORMS = "tf2_msgs/msg/TFMessage"
READS_SCAN = node(("scan", SCAN, "answer", "10"))
READS_BOTH = node(("image", IMAGE, "keep", "10"), ("scan", SCAN, "answer", "10"))
READS_MAP = node(("map", MAP, "keep", "LATCHED"), ("scan", SCAN, "answer", "10"))
EARLY_NS, LATE_NS = 1, 1_649_138_880 * S


class Report(NamedTuple):
    """What people have, and what is right.

    Attributes:
        source: where it was reported: project and number.
        recording: the messages, or what writes them as ``bag.mcap`` into a folder.
        source_text: of the node.
        info: what `data info` says.
        spec: what `init` writes; nothing where it refuses.
        valid: the codes that `validate` then has, none of which is an error.
        edit: what is replaced in the spec, as people had it before.
        then: what `validate` says of that.
        profiles: offered profiles, by topic.
        parameters: a parameter file of the node.
    """

    source: str
    recording: list[Recorded] | Callable[[Path], Any]
    source_text: str = READS_SCAN
    info: str = ""
    spec: str = ""
    valid: tuple[str, ...] = ()
    edit: tuple[str, str] = ("", "")
    then: str = ""
    profiles: Mapping[str, Any] = MappingProxyType({})
    parameters: str = ""


def with_protobuf(folder: Path) -> None:
    """Write scans beside a topic whose messages are protobuf."""
    from mcap.writer import Writer

    with (folder / "bag.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        scans = writer.register_channel(
            "/scan", "cdr", writer.register_schema(SCAN, "ros2msg", b"")
        )
        schema = writer.register_schema("foxglove.Annotations", "protobuf", b"")
        others = writer.register_channel("/annotations", "protobuf", schema)
        for _, offset_ns, data in CDR:
            writer.add_message(scans, START_NS + offset_ns, data, START_NS + offset_ns)
            writer.add_message(others, START_NS + offset_ns, b"any", START_NS + offset_ns)
        writer.finish()  # type: ignore[no-untyped-call]


def killed(folder: Path) -> None:
    whole = write_mcap(folder / "whole", CDR, kind=SCAN).read_bytes()
    (folder / "bag.mcap").write_bytes(whole[: len(whole) * 2 // 3])


REPORTS: dict[str, Report] = {
    "a recorder that was started before /clock": Report(
        "driving_log_replayer PR 468, rosbag2 #764",
        series("/scan", SCAN, 5, 1e9, start_ns=EARLY_NS)
        + series("/scan", SCAN, 30, 10, start_ns=LATE_NS),
        info="30 of its 35 messages after it: use 'window: {start: 1649138879.999 s}'.",
        spec="window: {start: 1649138879.999 s}",
        edit=("  window: {start: 1649138879.999 s}\n", ""),
        then="use one part: 'window: {start: 1649138879.999 s}'",
    ),
    "stamps that were never set": Report(
        "ros_comm #60, navigation2 #2897",
        series("/scan", SCAN, 40, 10, stamp=lambda _: 0),
        info="/scan was never stamped: all of its 40 stamps are 0.",
        spec="scan: {from: recorded/scan",
        valid=("R2B327",),
    ),
    "two machines whose clocks are 5 s apart": Report(
        "message_filters PR 166",
        SCANS
        + series("/image", IMAGE, 40, 10, stamp=lambda time_ns: time_ns + 5 * S, late_ns=7 * MS),
        READS_BOTH,
        info="/image has stamps that are 4.993 s ahead of the times of recording.",
        spec="clock_ahead: 5 s",
        edit=(", clock_ahead: 5 s", ""),
        then="write 'clock_ahead: 5 s'",
    ),
    "a map that was published once": Report(
        "rosbag2 #1482, #2333, #1159",
        series("/map", MAP, 1, 10, start_ns=START_NS - 1000) + SCANS,
        READS_MAP,
        info="/map was offered with durability transient_local.",
        spec="map: {from: recorded/map, format: nav_msgs/msg/OccupancyGrid, rate: once}",
        edit=("  topics:\n", "  window: {start: 1 s}\n  topics:\n"),
        then="no problems",
        profiles={"/map": offered(durability="TRANSIENT_LOCAL")},
    ),
    "a map that every step needs": Report(
        "rosbag2 #1482",
        series("/map", MAP, 1, 10, start_ns=START_NS - 1000) + SCANS,
        READS_MAP,
        spec="rate: once",
        edit=(", rate: once", ""),
        then="write 'rate: once' for map",
    ),
    "recorded quality of service": Report(
        "rosbag2 #125, #1237",
        SCANS,
        node(("scan", SCAN, "answer", "qos_profile_sensor_data")),
        info="/scan was offered with reliability best_effort, durability transient_local.",
        spec="qos: {reliability: best_effort, durability: transient_local}",
        profiles={"/scan": offered("BEST_EFFORT", "TRANSIENT_LOCAL")},
    ),
    "quality of service in the source": Report(
        "durability of a QoSProfile in a variable",
        SCANS,
        node(("scan", SCAN, "answer", "LATCHED")),
        spec="qos: {durability: transient_local}",
        edit=("durability: transient_local", "durability: volatile"),
        then="R2B216",
    ),
    "a deadline": Report(
        "rosbag2 PR 355",
        SCANS,
        node(("scan", SCAN, "answer", "QoSProfile(depth=1, deadline=Duration(seconds=0.2))")),
        spec="qos: {deadline: 200 ms}",
        edit=(", qos: {deadline: 200 ms}", ""),
        then="R2B216",
    ),
    "MCAP without repeated channels": Report(
        "mcap PR 1172",
        lambda folder: write_mcap(folder / "bag.mcap", CDR, kind=SCAN, repeat_channels=False),
        info="messages  40",
        spec="/scan: recorded/scan # 10 Hz, 40 messages",
    ),
    "MCAP with channels of two encodings": Report(
        "rosbag2 #1245",
        with_protobuf,
        info="foxglove.Annotations as protobuf",
        spec="/scan: recorded/scan # 10 Hz, 40 messages",
    ),
    "a recorder that was killed": Report("rosbag2 #2003", killed, info="'mcap recover bag.mcap"),
    "a flat parameter file": Report(
        "launch_ros #156",
        SCANS,
        node(
            ("scan", SCAN, "answer", "10"),
            before="        self.declare_parameter('image', 'none.png')\n",
        ),
        spec="parameters:\n        image: map.png",
        edit=("parameters:\n        image: map.png", "parameters: ./own.yaml"),
        then="write its values here, as a map",
        parameters="image: map.png\n",
    ),
    "a simulator": Report(
        "autoware #10330, rosbag2 #2239",
        series("/scan", SCAN, 40, 10, stamp=lambda time_ns: time_ns - START_NS + 12_300 * MS)
        + series("/clock", CLOCK, 400, 100, stamp=lambda time_ns: time_ns - START_NS),
        info="/scan is stamped by a simulated clock, from 12.3 s.",
        spec="clock: true",
        valid=("R2B327",),
        edit=("  clock: true # a node has 'use_sim_time: true'\n", ""),
        then="write 'playback: {clock: true}' to publish it",
        parameters="tested: {ros__parameters: {use_sim_time: true}}\n",
    ),
}

ELSEWHERE = {
    "ROS_DISCOVERY_SERVER without a server (Fast-DDS #2031)": (
        "execute/test_execute_environment.py",
        "test_what_changes_discovery_is_named",
    ),
    "0 to n outputs for an input": (
        "judge/test_judge_own_pace.py",
        "test_of_any_number_each_output_has_a_latency_and_none_is_missed",
    ),
    "a quota of CPU time (docker --cpus)": (
        "doctor/test_doctor_machine.py",
        "test_cores_and_the_quota_on_them",
    ),
    "use and memory of GPUs (ros2_benchmark 4.5)": (
        "execute/test_execute_devices.py",
        "test_a_gpu_is_measured_for_the_machine_and_for_its_process",
    ),
}


@pytest.mark.parametrize("name", REPORTS)
def test_what_people_have_becomes_a_spec_that_is_valid(
    tmp_path: Path, call: Call, name: str
) -> None:
    report = REPORTS[name]
    bag = "./bag.mcap" if callable(report.recording) else "./bag"
    if callable(report.recording):
        report.recording(tmp_path)
    else:
        record(tmp_path / "bag", report.recording, report.profiles)
    Path("node.py").write_text(report.source_text)
    more = ["--params-file", "own.yaml"] if report.parameters else []
    Path("own.yaml").write_text(report.parameters)
    assert report.info in "".join(call("data", "info", bag)[1:])
    made = call("init", "made", "--node", "./node.py:Tested", "--from-bag", bag, *more)
    if not report.spec:
        assert (made.status, report.info in made.err) == (2, True)
        return
    text = Path("made.r2b.yaml").read_text()
    assert report.spec in text
    assert codes(call("validate", "made.r2b.yaml", status=0).out) == [*report.valid]
    if report.then:
        assert report.edit[0] in text
        Path("made.r2b.yaml").write_text(text.replace(*report.edit, 1))
        assert report.then in call("validate", "made.r2b.yaml").out


def codes(said: str) -> list[str]:
    return re.findall(r"\[(R2B\d+) ", said)


def test_static_transforms_without_their_type(call: Call, tmp_path: Path) -> None:
    """rosbag2 #1049: there is no wheel of tf2_msgs, and `validate` says so."""
    pytest.importorskip("rclpy")
    if find_spec("tf2_msgs") is not None:
        pytest.skip("tf2_msgs is installed here")
    record(tmp_path / "bag", [*SCANS, *series("/tf_static", TRANSFORMS, 1, 1)])
    Path("node.py").write_text(READS_SCAN)
    call("init", "made", "--node", "./node.py:Tested", "--from-bag", "./bag", status=0)
    text = Path("made.r2b.yaml").read_text()
    Path("made.r2b.yaml").write_text(
        text.replace("  topics:", "  publish_tf_static: true\n  topics:")
    )
    said = call("validate", "made.r2b.yaml").out
    assert codes(said) == ["R2B681"]
    assert "there is no wheel of tf2_msgs" in said


@pytest.mark.parametrize("name", ELSEWHERE)
def test_what_is_no_recording_is_tested_where_its_subject_is(name: str) -> None:
    file, function = ELSEWHERE[name]
    assert f"def {function}(" in (Path(__file__).parents[1] / file).read_text()
