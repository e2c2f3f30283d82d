"""What the doctor says of ROS, OpenCV and the native harness."""

from __future__ import annotations

import importlib.metadata
import json
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from command_line import Call
from r2bspec.doctor import checks
from r2bspec.doctor.checks import check_ros
from r2bspec.doctor.checkup import CheckResult, System
from r2bspec.extras import install_command
from r2bspec.middleware.middleware import RMW_VARIABLE

MISSING = {"error": "ModuleNotFoundError: No module named 'rclpy'"}


def imported(said: str | None = None) -> dict[str, Any]:
    return {"seconds": 0.1, "version": "1.2", "file": "/opt/x/__init__.py", "said": said}


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """State what can be imported and which wheels are installed."""

    def state(known: dict[str, dict[str, Any]], wheels: tuple[str, ...] = ()) -> None:
        def answer(_system: System, *names: str) -> dict[str, dict[str, Any]]:
            return {name: known.get(name, imported()) for name in names}

        monkeypatch.setattr(checks, "probe_imports", answer)
        monkeypatch.setattr(
            importlib.metadata,
            "distributions",
            lambda: [SimpleNamespace(metadata={"Name": n}, version="7.1") for n in wheels],
        )

    return state


def rclpy(rmw: str = "rmw_fastrtps_cpp") -> dict[str, dict[str, Any]]:
    return {checks._MIDDLEWARE: imported(rmw)}


def by_name(**environ: str) -> dict[str, CheckResult]:
    """The checks of ROS in an environment."""
    return {check.name: check for check in check_ros(System(environ=environ))}


def test_without_rclpy_there_is_a_problem_and_a_way_out(here: Callable[..., None]) -> None:
    here({checks._MIDDLEWARE: MISSING})
    found = by_name()
    assert found["rclpy"].status == "problem"
    assert install_command("ros") in found["rclpy"].advice
    assert found["distributions"].status == "warn"


def test_a_middleware_that_is_not_installed_is_named_with_a_way_out() -> None:
    pytest.importorskip("rclpy")
    check = by_name(**os.environ | {RMW_VARIABLE: "rmw_absent_cpp"})["rclpy"]
    assert check.status == "problem"
    assert "rmw_absent_cpp" in check.found
    # Of a message of rcl, what is for its developers is left out.
    assert not any(each in check.found for each in ("[ERROR]", ".c:", "JSON"))
    assert check.advice == f"rmw_absent_cpp is not installed: install it, or unset {RMW_VARIABLE}"


def test_middleware_that_transports_cannot_configure_is_warned_of(
    here: Callable[..., None], tmp_path: Path
) -> None:
    here(rclpy("rmw_cyclonedds_cpp"))
    index = tmp_path / "share/ament_index/resource_index/rmw_typesupport"
    index.mkdir(parents=True)
    (index / "rmw_fastrtps_cpp").touch()
    check = by_name(AMENT_PREFIX_PATH=str(tmp_path))["middleware"]
    assert check.status == "warn"
    assert check.found == "rmw_cyclonedds_cpp (also here: rmw_fastrtps_cpp)"
    assert "transport: inherit" in check.advice


@pytest.mark.parametrize(
    ("rmw", "variable", "told"),
    [
        ("rmw_cyclonedds_cpp", "CYCLONEDDS_URI", True),
        ("rmw_zenoh_cpp", "ZENOH_SESSION_CONFIG_URI", True),
        ("rmw_zenoh_cpp", "CYCLONEDDS_URI", False),
        ("rmw_fastrtps_cpp", "FASTDDS_DEFAULT_PROFILES_FILE", False),
    ],
)
def test_a_variable_that_can_let_discovery_leave_the_host_is_named(
    here: Callable[..., None], rmw: str, variable: str, told: bool
) -> None:
    here(rclpy(rmw))
    environ = {"RMW_IMPLEMENTATION": rmw, variable: "x"}
    check = by_name(**environ)["middleware"]
    assert (f"{variable} is set" in check.advice) == told


def test_the_command_prints_what_programs_and_people_read(
    here: Callable[..., None], tmp_path: Path, call: Call
) -> None:
    here({checks._MIDDLEWARE: MISSING})
    answer = json.loads(call("doctor", "--runs", tmp_path, "--format", "json", status=1).out)
    assert answer["status"] == "problem"
    assert "problem" in {check["status"] for check in answer["checks"]}
    text = call("doctor", "--runs", tmp_path, status=1).out
    assert {check["topic"] for check in answer["checks"]} <= set(text.splitlines())
    assert "\x1b[" not in text


def test_without_a_compiler_there_is_a_problem_and_a_way_out(tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    (check,) = checks.check_native(System(environ={"PATH": str(tmp_path)}))
    assert check.status == "problem"
    assert "no C compiler" in check.found
    assert "apt install gcc" in check.advice
