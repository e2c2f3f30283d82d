"""`r2bspec data`, as a person or a script uses it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from data_bags import chatter, refusal_of, write_bag
from r2bspec.bags.recording import DataError
from r2bspec.cli.main import command
from r2bspec.errors import UsageError


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def run(*arguments: str) -> Result:
    result = CliRunner().invoke(command, ["data", *arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_lists_what_a_spec_can_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = write_bag(tmp_path / "real" / "r2b_cafe", chatter())
    monkeypatch.setenv("R2B_DATASETS", str(real.parent))
    lines = run("list").stdout.splitlines()
    assert lines[0].split() == ["dataset", "source", "content"]
    assert lines[1].startswith(f"r2b_cafe        {real}")
    assert any(line.startswith("r2b_storage") and "AprilTag" in line for line in lines)
    listed = json.loads(run("list", "--format", "json").stdout)
    assert {entry["name"]: entry["kind"] for entry in listed}["r2b_cafe"] == "recorded"


def test_makes_a_dataset_and_says_where() -> None:
    arguments = ("make", "r2b_storage", "--topics", "d455_1_imu", "--window", "0 s:20 ms")
    first = json.loads(run(*arguments, "--format", "json").stdout)
    again = json.loads(run(*arguments, "--format", "json").stdout)
    assert first == {**again, "made": True}
    assert not again["made"]
    shown = run(*arguments).stdout
    assert first["path"] in shown
    assert first["sha256"] in shown
    assert "/d455_1_imu  sensor_msgs/msg/Imu         4  200 Hz    340 B\n" in shown


def test_a_window_can_be_given_by_its_ends() -> None:
    arguments = ("make", "r2b_storage", "--topics", "/d455_1_imu", "--format", "json")
    by_ends = run(*arguments, "--start", "10 ms", "--end", "30ms")
    assert json.loads(by_ends.stdout)["made"]
    for window in ("10 ms:30 ms", "0.01 s : 0.03 s"):
        assert not json.loads(run(*arguments, "--window", window).stdout)["made"]


@pytest.mark.parametrize("window", ["1", "0:1", "1 s", "a:b"])
def test_refuses_windows_without_units(window: str) -> None:
    with pytest.raises(UsageError):
        run("make", "r2b_storage", "--window", window)


def test_refuses_two_ways_of_saying_the_same() -> None:
    with pytest.raises(UsageError):
        run("make", "r2b_storage", "--window", "0 s:1 s", "--end", "1 s")


def test_a_bare_number_is_answered_with_its_unit() -> None:
    result = run("make", "r2b_storage", "--end", "3")
    assert result.exit_code == 2
    assert "did you mean '3 s'?" in result.stderr


def test_informs_about_a_bag(bag: Path) -> None:
    shown = run("info", str(bag)).stdout
    assert "messages  6\n" in shown
    assert "/ping  std_msgs/msg/String         3  40 Hz\n" in shown
    index = json.loads(run("info", str(bag), "--format", "json").stdout)
    assert index["topics"]["/pong"]["count"] == 3
    assert len(index["sha256"]) == 64


def test_informs_about_a_dataset_without_making_it(tmp_path: Path) -> None:
    assert "not created yet" in run("info", "r2b_lounge").stdout
    assert not (tmp_path / "cache").exists()


def test_verifies_by_exit_code(bag: Path, tmp_path: Path) -> None:
    good = run("verify", str(bag))
    assert (good.exit_code, good.stdout) == (0, f"{bag} is consistent\n")
    (bag / "metadata.yaml").write_text("broken: [")
    bad = run("verify", str(bag), "--format", "json")
    assert bad.exit_code == 1
    assert len(json.loads(bad.stdout)["problems"]) == 1
    with pytest.raises(DataError):
        run("verify", str(tmp_path / "nothing"))


def test_verifies_a_dataset_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_bag(tmp_path / "sets" / "my_drive", chatter())
    monkeypatch.setenv("R2B_DATASETS", str(tmp_path / "sets"))
    monkeypatch.chdir(tmp_path)
    good = run("verify", "my_drive")
    assert (good.exit_code, good.stdout) == (
        0,
        f"{tmp_path / 'sets' / 'my_drive'} is consistent\n",
    )
    error = refusal_of(run, "verify", "my_dive")
    assert "my_drive" in f"{error} {error.hint}"
