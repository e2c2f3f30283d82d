"""Recordings as people have them: a first spec is valid, and says how each input is played."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import pytest
import yaml

from data_bags import START_NS
from nightly import sampled
from r2bspec.authoring.sources import InitSources, spec_from_sources
from r2bspec.bags import recorded_times
from r2bspec.check import check
from r2bspec.errors import UsageError
from r2bspec.language.load_spec import load_spec
from recorded_inputs import (
    IMAGE,
    IMU,
    MAP,
    MS,
    POINTS,
    SCAN,
    TWIST,
    Recorded,
    S,
    node,
    offered,
    record,
    series,
)


class First(NamedTuple):
    """A first spec, and what `validate` says of it: codes and severities."""

    spec: dict[str, Any]
    text: str
    findings: list[tuple[str, str]]
    messages: str

    @property
    def inputs(self) -> dict[str, Any]:
        """The inputs without their sources and types."""
        return {
            topic: {key: value for key, value in entry.items() if key not in {"from", "format"}}
            for topic, entry in self.spec["playback"]["inputs"].items()
        }


def first_spec(folder: Path, source: str, bag: str = "./bag") -> First:
    (folder / "node.py").write_text(source)
    sources = InitSources(bag=str(folder / bag), node="./node.py:Tested")
    text = spec_from_sources("tested", folder, sources).text
    return First(yaml.safe_load(text), text, *found(folder, text))


def found(folder: Path, text: str) -> tuple[list[tuple[str, str]], str]:
    (folder / "tested.r2b.yaml").write_text(text)
    findings = check(load_spec(folder / "tested.r2b.yaml", environ={}))
    kept = [each for each in findings if each.code not in {"R2B681", "R2B620"}]
    return (
        [(each.code, str(each.severity)) for each in kept],
        "\n".join(f"{each.message}: {each.help}" for each in kept),
    )


SCANS = series("/scan", SCAN, 40, 10)
_SCAN_NODE = (("scan", SCAN, "answer", "10"),)
_FUSION = (("image", IMAGE, "keep", "10"), ("scan", SCAN, "answer", "10"))
_CLOCK = ("R2B327", "info")

TWO_CAMERAS = [
    *series("/left/image", IMAGE, 90, 30),
    *series("/right/image", IMAGE, 90, 30, late_ns=4 * MS, stamp=lambda time_ns: time_ns + 3 * MS),
    *series("/points", POINTS, 30, 10),
]
"""Two cameras without a common trigger, and a lidar."""


def squeezed(rows: list[Recorded], factor: float) -> list[Recorded]:
    """Return messages that were recorded an hour later, in less time."""
    later_ns = START_NS + 3600 * S
    return [
        row._replace(time_ns=later_ns + round((row.time_ns - START_NS) * factor)) for row in rows
    ]


class Case(NamedTuple):
    rows: list[Recorded]
    subscriptions: tuple[tuple[str, str, str, str], ...]
    inputs: dict[str, dict[str, Any]]
    findings: tuple[tuple[str, str], ...] = ()
    rate: str = "10 Hz"
    profiles: Mapping[str, Any] = MappingProxyType({})


CASES: dict[str, Case] = {
    "stamps of both inputs never set": Case(
        series("/scan", SCAN, 40, 10, stamp=lambda _: 0)
        + series("/image", IMAGE, 40, 10, stamp=lambda _: 0, late_ns=7 * MS),
        _FUSION,
        {"scan": {}, "image": {}},
        (_CLOCK,),
    ),
    "stamps of one input never set": Case(
        series("/scan", SCAN, 40, 10)
        + series("/image", IMAGE, 40, 10, stamp=lambda _: 0, late_ns=7 * MS),
        _FUSION,
        {"scan": {}, "image": {"rate": "recorded"}},
        (_CLOCK,),
    ),
    "two machines": Case(
        series("/scan", SCAN, 40, 10)
        + series("/image", IMAGE, 40, 10, stamp=lambda time_ns: time_ns + 5 * S, late_ns=7 * MS),
        _FUSION,
        {"scan": {}, "image": {"clock_ahead": "5 s"}},
    ),
    "two machines, different rates": Case(
        series("/scan", SCAN, 100, 10)
        + series("/image", IMAGE, 300, 30, stamp=lambda time_ns: time_ns - 2 * S, late_ns=7 * MS),
        _FUSION,
        {"scan": {"clock_ahead": "2 s"}, "image": {"rate": "recorded"}},
    ),
    "a camera and an IMU": Case(
        series("/image", IMAGE, 90, 30) + series("/imu", IMU, 600, 200),
        (("image", IMAGE, "answer", "10"), ("imu", IMU, "keep", "50")),
        {"image": {}, "imu": {"rate": "recorded"}},
        rate="30 Hz",
    ),
    "an IMU that makes the node publish": Case(
        series("/image", IMAGE, 90, 30) + series("/imu", IMU, 600, 200),
        (("image", IMAGE, "keep", "10"), ("imu", IMU, "answer", "50")),
        {"image": {"rate": "recorded"}, "imu": {}},
        rate="200 Hz",
    ),
    "two cameras without a common trigger": Case(
        TWO_CAMERAS,
        (("left/image", IMAGE, "answer", "10"), ("right/image", IMAGE, "keep", "10")),
        {"left/image": {}, "right/image": {"pairing": {"slop": "3 ms"}}},
        rate="30 Hz",
    ),
    "maps before the scans": Case(
        series("/map", MAP, 2, 1, start_ns=START_NS - 2 * S) + series("/scan", SCAN, 12, 10),
        (("map", MAP, "keep", "LATCHED"), *_SCAN_NODE),
        {"map": {"rate": "once"}, "scan": {}},
        profiles={"/map": offered(durability="TRANSIENT_LOCAL")},
    ),
    "a map before a gap": Case(
        series("/map", MAP, 1, 10, start_ns=1) + series("/scan", SCAN, 40, 10),
        (("map", MAP, "keep", "10"), *_SCAN_NODE),
        {"map": {"rate": "once"}, "scan": {}},
    ),
    "a converter that wrote its own times": Case(
        squeezed(series("/scan", SCAN, 100, 10) + series("/image", IMAGE, 300, 30), 0.01),
        _FUSION,
        {"scan": {}, "image": {"rate": "recorded"}},
        (_CLOCK,),
    ),
    "commands without a header": Case(
        series("/scan", SCAN, 40, 10) + series("/cmd_vel", TWIST, 80, 20),
        (*_SCAN_NODE, ("cmd_vel", TWIST, "keep", "10")),
        {"scan": {}, "cmd_vel": {"rate": "recorded"}},
    ),
    "a profile that the node accepts": Case(
        series("/scan", SCAN, 40, 10),
        (("scan", SCAN, "answer", "qos_profile_sensor_data"),),
        {"scan": {"qos": {"reliability": "best_effort"}}},
        profiles={"/scan": offered("BEST_EFFORT")},
    ),
    "a profile that the node does not accept": Case(
        series("/scan", SCAN, 40, 10),
        (("scan", SCAN, "answer", "LATCHED"),),
        {"scan": {"qos": {"durability": "transient_local"}}},
        profiles={"/scan": offered("BEST_EFFORT", "TRANSIENT_LOCAL")},
    ),
}


@pytest.mark.parametrize(
    ("name", "storage"),
    [*((name, "sqlite3") for name in CASES), *((name, "mcap") for name in sampled(CASES, 4))],
)
def test_a_first_spec_plays_a_recording_as_it_is(
    tmp_path: Path, name: str, storage: Literal["sqlite3", "mcap"]
) -> None:
    case = CASES[name]
    record(tmp_path / "bag", case.rows, case.profiles, storage)
    first = first_spec(tmp_path, node(*case.subscriptions))
    assert (first.inputs, first.findings) == (case.inputs, [*case.findings]), first.text
    assert first.spec["benchmark"]["rates"] == [case.rate]
    assert first.spec["slos"]["keeps_up"]["at"] == case.rate


def test_a_recording_without_messages_is_refused(tmp_path: Path) -> None:
    record(tmp_path / "bag", [])
    with pytest.raises(UsageError, match="has no messages"):
        first_spec(tmp_path, node(*_SCAN_NODE))


def test_a_timeline_whose_steps_never_have_all_inputs_is_refused(tmp_path: Path) -> None:
    record(tmp_path / "bag", CASES["a camera and an IMU"].rows[1:])
    first = first_spec(tmp_path, node(*CASES["a camera and an IMU"].subscriptions))
    late = first.text.replace(", rate: recorded", "").replace(
        "playback:", "playback:\n  mode: timeline\n  timeline: {translations: {imu: 1 ms}}"
    )
    late = late.replace("  rates: [30 Hz]", "").replace("    at: 30 Hz", "")
    findings, messages = found(tmp_path, late)
    assert ("R2B658", "error") in findings
    assert "write 'answers: [image]'" in messages


@pytest.mark.parametrize(
    ("before", "argument"),
    [
        ("", "QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)"),
        ("", "LATCHED"),
        ("        qos = LATCHED\n", "qos"),
        ("", "IMPORTED"),
    ],
    ids=["inline", "constant", "variable", "constant of another file"],
)
def test_a_profile_in_the_source_is_compared_with_what_is_played(
    tmp_path: Path, before: str, argument: str
) -> None:
    record(tmp_path / "bag", series("/scan", SCAN, 40, 10))
    (tmp_path / "profiles.py").write_text(
        "from rclpy.qos import DurabilityPolicy, QoSProfile\n"
        "IMPORTED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)\n"
    )
    first = first_spec(tmp_path, node(("scan", SCAN, "answer", argument), before=before))
    assert first.findings == []
    lines = first.text.splitlines()
    volatile = "\n".join(line for line in lines if "durability" not in line)
    findings, messages = found(tmp_path, volatile.replace(", qos: {", ", qos: {}"))
    assert findings == [("R2B216", "error")]
    assert "requests durability 'transient_local'" in messages


@pytest.mark.parametrize("at_s", [15, 29.9])
def test_a_map_of_a_later_time_is_in_the_window(tmp_path: Path, at_s: float) -> None:
    maps = series("/map", MAP, 1, 1, start_ns=START_NS + round(at_s * S))
    record(tmp_path / "bag", series("/scan", SCAN, 300, 10) + maps)
    first = first_spec(tmp_path, node(("map", MAP, "keep", "LATCHED"), *_SCAN_NODE))
    assert (first.inputs["map"], first.findings) == ({"rate": "once"}, [])


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_of_a_large_recording_gaps_and_the_first_stamps_are_known(
    tmp_path: Path, storage: Literal["sqlite3", "mcap"], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorded_times, "MAX_STAMPS_BYTES", 1_000)
    monkeypatch.setattr(recorded_times, "_SAMPLE_BYTES", 500)
    early = series("/scan", SCAN, 15, 10, start_ns=1, stamp=lambda _: 0)
    record(tmp_path / "bag", early + series("/scan", SCAN, 40, 10), storage=storage)
    first = first_spec(tmp_path, node(*_SCAN_NODE))
    assert "window: {start: 1699999999.999 s}" in first.text
    whole = re.sub(r"  # Most of.*\n  window: .*\n", "", first.text)
    findings, messages = found(tmp_path, whole)
    assert findings == [("R2B324", "warning"), _CLOCK]
    assert re.search(r"'scan' was never stamped: its first \d+ stamps are 0", messages)
