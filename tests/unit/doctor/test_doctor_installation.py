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
from r2bspec.doctor import installation
from r2bspec.doctor.checkup import CheckResult, System
from r2bspec.doctor.installation import check_ros, check_vision, probe_imports
from r2bspec.middleware.middleware import RMW_VARIABLE
from r2bspec.native.build import BuildError

MISSING = {"error": "ModuleNotFoundError: No module named 'rclpy'"}


def imported(said: str | None = None) -> dict[str, Any]:
    return {"seconds": 0.1, "version": "1.2", "file": "/opt/x/__init__.py", "said": said}


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """State what can be imported and which wheels are installed."""

    def state(known: dict[str, dict[str, Any]], wheels: tuple[str, ...] = ()) -> None:
        def answer(_system: System, *names: str) -> dict[str, dict[str, Any]]:
            return {name: known.get(name, imported()) for name in names}

        monkeypatch.setattr(installation, "probe_imports", answer)
        monkeypatch.setattr(
            importlib.metadata,
            "distributions",
            lambda: [SimpleNamespace(metadata={"Name": n}, version="7.1") for n in wheels],
        )

    return state


def rclpy(rmw: str = "rmw_fastrtps_cpp") -> dict[str, dict[str, Any]]:
    return {installation._MIDDLEWARE: imported(rmw)}


def by_name(**environ: str) -> dict[str, CheckResult]:
    """The checks of ROS in an environment."""
    return {check.name: check for check in check_ros(System(environ=environ))}


def test_without_rclpy_there_is_a_problem_and_a_way_out(here: Callable[..., None]) -> None:
    here({installation._MIDDLEWARE: MISSING})
    checks = by_name()
    assert checks["rclpy"].status == "problem"
    assert "r2bspec[ros]" in checks["rclpy"].advice
    assert checks["distributions"].status == "warn"


def test_a_middleware_that_is_not_installed_is_named_with_a_way_out() -> None:
    pytest.importorskip("rclpy")
    check = by_name(**os.environ | {RMW_VARIABLE: "rmw_absent_cpp"})["rclpy"]
    assert check.status == "problem"
    assert "rmw_absent_cpp" in check.found
    # Of a message of rcl, what is for its developers is left out.
    assert not any(each in check.found for each in ("[ERROR]", ".c:", "JSON"))
    assert check.advice == f"rmw_absent_cpp is not installed: install it, or unset {RMW_VARIABLE}"


def test_wheels_alone_are_fine(here: Callable[..., None]) -> None:
    here(rclpy(), wheels=("ros-jazzy-rclpy", "ros-rclpy", "numpy"))
    checks = by_name()
    assert {check.status for check in checks.values()} == {"ok"}
    assert checks["distributions"].found == "jazzy 7.1 as wheels"


def test_a_sourced_workspace_is_named_with_its_base(here: Callable[..., None]) -> None:
    here(rclpy())
    check = by_name(ROS_DISTRO="jazzy", AMENT_PREFIX_PATH="/home/me/install:/opt/ros/jazzy")[
        "distributions"
    ]
    assert check.status == "ok"
    assert check.found == "jazzy sourced from /opt/ros/jazzy and 1 more"


def test_two_distributions_at_once_are_warned_of(here: Callable[..., None]) -> None:
    here(rclpy(), wheels=("ros-jazzy-rclpy",))
    check = by_name(ROS_DISTRO="humble", AMENT_PREFIX_PATH="/opt/ros/humble")["distributions"]
    assert check.status == "warn"
    assert "mixed" in check.advice


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


def test_another_middleware_than_runs_configure_is_warned_of(here: Callable[..., None]) -> None:
    here(rclpy("rmw_cyclonedds_cpp"))
    check = by_name()["middleware"]
    assert "set RMW_IMPLEMENTATION=rmw_cyclonedds_cpp" in check.advice
    check = by_name(RMW_IMPLEMENTATION="rmw_cyclonedds_cpp")["middleware"]
    assert "RMW_IMPLEMENTATION=" not in check.advice


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


def test_message_packages_that_are_missing_are_named(here: Callable[..., None]) -> None:
    here(rclpy() | {"stereo_msgs.msg": MISSING})
    check = by_name()["messages"]
    assert check.status == "warn"
    assert check.data["missing"] == ["stereo_msgs"]


@pytest.mark.parametrize(("found", "status"), [(imported(), "ok"), (MISSING, "warn")])
def test_opencv_is_wanted_but_not_needed(
    here: Callable[..., None], found: dict[str, Any], status: str
) -> None:
    here({"cv2": found})
    assert [check.status for check in check_vision(System(environ={}))] == [status]


def test_a_fresh_interpreter_tells_what_it_can_import() -> None:
    found = probe_imports(
        System(), "json", "platform:system", "no_such_module", "json:no_such_name"
    )
    assert found["json"]["seconds"] > 0
    assert found["json"]["file"].endswith("__init__.py")
    assert found["platform:system"]["said"] == "Linux"
    assert "ModuleNotFoundError" in found["no_such_module"]["error"]
    assert "AttributeError" in found["json:no_such_name"]["error"]


@pytest.mark.parametrize("program", ["/no/such/python", "/bin/false"])
def test_an_interpreter_that_says_nothing_is_an_error_and_no_crash(program: str) -> None:
    found = probe_imports(System(python=program), "json")
    assert list(found["json"]) == ["error"]


def test_a_module_that_prints_or_exits_does_not_spoil_the_answer(tmp_path: Path) -> None:
    (tmp_path / "loud.py").write_text("print('hello')\n")
    (tmp_path / "leaves.py").write_text("raise SystemExit(3)\n")
    path = f"{tmp_path}:{Path(__file__).parents[3]}"
    found = probe_imports(
        System(environ={**System().environ, "PYTHONPATH": path}), "loud", "leaves"
    )
    assert "error" not in found["loud"]
    assert "SystemExit" in found["leaves"]["error"]


def test_a_module_that_ends_the_interpreter_is_quoted(tmp_path: Path) -> None:
    (tmp_path / "dies.py").write_text(
        "import os, sys\nsys.stderr.write('no such middleware\\n')\n"
        "sys.stderr.flush()\nos._exit(102)\n"
    )
    (tmp_path / "goes.py").write_text("import os\nos._exit(102)\n")
    path = f"{tmp_path}:{Path(__file__).parents[3]}"
    system = System(environ={**System().environ, "PYTHONPATH": path})
    assert probe_imports(system, "dies") == {"dies": {"error": "no such middleware"}}
    assert probe_imports(system, "goes") == {"goes": {"error": "it ended with status 102"}}


def test_the_command_prints_what_programs_and_people_read(
    here: Callable[..., None], tmp_path: Path, call: Call
) -> None:
    here({installation._MIDDLEWARE: MISSING})
    answer = json.loads(call("doctor", "--runs", tmp_path, "--format", "json", status=1).out)
    assert answer["status"] == "problem"
    assert "problem" in {check["status"] for check in answer["checks"]}
    text = call("doctor", "--runs", tmp_path, status=1).out
    assert {check["topic"] for check in answer["checks"]} <= set(text.splitlines())
    assert "\x1b[" not in text


def test_without_a_compiler_there_is_a_problem_and_a_way_out(tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    (check,) = installation.check_native(System(environ={"PATH": str(tmp_path)}))
    assert check.status == "problem"
    assert "no C compiler" in check.found
    assert "apt install gcc" in check.advice


def test_what_was_built_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "harness_program", lambda _: Path("/cache/r2bspec_harness"))
    (check,) = installation.check_native(System(environ={}))
    assert (check.status, check.found) == ("ok", "/cache/r2bspec_harness")


def test_only_the_first_line_of_a_compiler_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: object) -> Path:
        raise BuildError("cc cannot compile x:\nerror 1\nerror 2", hint="install it")

    monkeypatch.setattr(installation, "harness_program", refuse)
    (check,) = installation.check_native(System(environ={}))
    assert (check.found, check.advice) == ("cc cannot compile x:", "install it")
