"""`r2bspec data`, as a person or a script uses it."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from command_line import Call, Said
from data_bags import chatter, write_bag

Data = Callable[..., Said]


@pytest.fixture
def data(call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Data:
    """The verb, with a cache of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return partial(call, "data")


def test_lists_what_a_spec_can_name(
    data: Data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = write_bag(tmp_path / "real" / "r2b_cafe", chatter())
    monkeypatch.setenv("R2B_DATASETS", str(real.parent))
    lines = data("list").out.splitlines()
    assert lines[0].split() == ["dataset", "source", "content"]
    assert lines[1].startswith(f"r2b_cafe        {real}")
    assert any(line.startswith("r2b_storage") and "AprilTag" in line for line in lines)
    listed = json.loads(data("list", "--format", "json").out)
    assert {entry["name"]: entry["kind"] for entry in listed}["r2b_cafe"] == "recorded"


def test_makes_a_dataset_and_says_where(data: Data) -> None:
    arguments = ("make", "r2b_storage", "--topics", "d455_1_imu", "--window", "0 s:20 ms")
    first = json.loads(data(*arguments, "--format", "json").out)
    again = json.loads(data(*arguments, "--format", "json").out)
    assert first == {**again, "made": True}
    assert not again["made"]
    shown = data(*arguments).out
    assert first["path"] in shown
    assert first["sha256"] in shown
    assert "/d455_1_imu  sensor_msgs/msg/Imu         4  200 Hz    340 B\n" in shown


@pytest.mark.parametrize("window", ["0:1", "1 s", "a:b"])
def test_refuses_windows_without_units_or_ends(data: Data, window: str) -> None:
    data("make", "r2b_storage", "--window", window, status=2)


def test_informs_about_a_bag(data: Data, bag: Path) -> None:
    shown = data("info", bag).out
    assert "messages  6\n" in shown
    assert "/ping  std_msgs/msg/String         3  50 Hz\n" in shown
    index = json.loads(data("info", bag, "--format", "json").out)
    assert index["topics"]["/pong"]["count"] == 3
    assert len(index["sha256"]) == 64


def test_informs_about_a_dataset_without_making_it(data: Data, tmp_path: Path) -> None:
    assert "not created yet" in data("info", "r2b_lounge").out
    assert not (tmp_path / "cache").exists()


def test_verifies_by_exit_code(data: Data, bag: Path) -> None:
    assert data("verify", bag, status=0).out == f"{bag} is consistent\n"
    (bag / "metadata.yaml").write_text("broken: [")
    bad = data("verify", bag, "--format", "json", status=1)
    assert len(json.loads(bad.out)["problems"]) == 1
    data("verify", bag / "nothing", status=2)


def test_verifies_a_dataset_by_its_name(
    data: Data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_bag(tmp_path / "sets" / "my_drive", chatter())
    monkeypatch.setenv("R2B_DATASETS", str(tmp_path / "sets"))
    monkeypatch.chdir(tmp_path)
    verified = data("verify", "my_drive", status=0).out
    assert verified == f"{tmp_path / 'sets' / 'my_drive'} is consistent\n"
    assert "my_drive" in data("verify", "my_dive", status=2).err
