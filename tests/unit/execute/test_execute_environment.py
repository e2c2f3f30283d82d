"""What processes of a run find in their environment."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

import msgspec
import pytest

import r2bspec
from r2bspec.execute.processes.environment import RunEnvironment, inherited_environment
from r2bspec.middleware.fast_dds import transport_profile
from r2bspec.plan.plan import Plan
from run_simulation import Simulation

MODULE_NAMES = str(Path(r2bspec.__file__).parent / "harness" / "module_names")

SECRETS = {
    "GITHUB_TOKEN": "t0",
    "AWS_SECRET_ACCESS_KEY": "t1",
    "PASSWORD": "t2",
    "SSH_AUTH_SOCK": "t3",
    "MY_PATH": "t4",
    "http_proxy": "http://user:t5@proxy",
}


def plan(
    transport: Literal["inherit", "shared_memory", "udp"] = "shared_memory",
    environment: tuple[str, ...] = (),
) -> Plan:
    return msgspec.structs.replace(
        Simulation().plan(), transport=transport, environment=environment
    )


def environment(tmp_path: Path, used: Plan) -> RunEnvironment:
    return RunEnvironment(
        used, run_id="abc", domain=7, scratch=tmp_path, largest_message_bytes=1_000_000
    )


def test_secrets_are_not_inherited() -> None:
    assert inherited_environment(SECRETS | {"PATH": "/bin", "LC_ALL": "C"}, ()) == {
        "PATH": "/bin",
        "LC_ALL": "C",
    }


def test_secrets_that_the_spec_names_are_inherited() -> None:
    assert inherited_environment(SECRETS, ("PASSWORD", "AWS_*")) == {
        "PASSWORD": SECRETS["PASSWORD"],
        "AWS_SECRET_ACCESS_KEY": "t1",
    }


def test_names_are_told_apart_by_case() -> None:
    assert inherited_environment({"path": "a", "Path": "b"}, ()) == {}


@pytest.mark.parametrize(
    "name", ["AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "RMW_IMPLEMENTATION", "PYTHONPATH", "HOME"]
)
def test_what_ros_programs_need_is_inherited(name: str) -> None:
    assert inherited_environment({name: "value"}, ()) == {name: "value"}


def test_no_process_of_a_run_gets_a_secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in SECRETS.items():
        monkeypatch.setenv(name, value)
    made = environment(tmp_path, plan(environment=("PASSWORD",)))
    for each in (made.for_harness(), made.for_node({})):
        assert each["PASSWORD"] == "t2"
        assert set(each) & set(SECRETS) == {"PASSWORD"}


def test_every_process_has_the_run_id_and_a_domain_of_this_host_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "0")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    made = environment(tmp_path, plan())
    for each in (made.for_harness(), made.for_node({})):
        assert each["R2BSPEC_RUN_ID"] == "abc"
        assert each["ROS_DOMAIN_ID"] == "7"
        # The profile of the transport says it, see below.
        assert each["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SYSTEM_DEFAULT"
        assert "ROS_LOCALHOST_ONLY" not in each
    for each in (environment(tmp_path, plan("inherit")).for_node({}),):
        assert each["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_modules_are_found_although_processes_run_in_the_folder_of_the_spec(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", "/opt/lib:src")
    made = environment(tmp_path, plan())
    assert made.for_node({})["PYTHONPATH"] == f"/opt/lib:{tmp_path}/src:{MODULE_NAMES}"


@pytest.mark.parametrize("path", [":/opt/lib", "/opt/lib:", "/opt/lib::", "::/opt/lib"])
def test_an_empty_entry_does_not_mean_the_folder_of_the_spec(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", path)
    made = environment(tmp_path, plan())
    assert made.for_harness()["PYTHONPATH"] == "/opt/lib"
    assert made.for_node({})["PYTHONPATH"] == f"/opt/lib:{MODULE_NAMES}"


def test_a_node_gets_the_changes_of_the_spec_and_nothing_of_the_harness(tmp_path: Path) -> None:
    made = environment(tmp_path, plan())
    node = made.for_node({"MODE": "fast", "PATH": "/opt/bin"})
    assert node["MODE"] == "fast"
    assert node["PATH"] == "/opt/bin"
    assert not [name for name in node if name.startswith("MALLOC_")]
    assert [name for name in made.for_harness() if name.startswith("MALLOC_")]
    assert "MODE" not in made.for_harness()


def test_an_inherited_transport_is_left_as_the_user_has_set_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", "/home/user/mine.xml")
    made = environment(tmp_path, plan("inherit"))
    assert made.for_node({})["FASTRTPS_DEFAULT_PROFILES_FILE"] == "/home/user/mine.xml"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("transport", ["shared_memory", "udp"])
def test_a_chosen_transport_is_a_profile_in_the_scratch_folder(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    transport: Literal["shared_memory", "udp"],
) -> None:
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", "/home/user/mine.xml")
    made = environment(tmp_path, plan(transport))
    for each in (made.for_harness(), made.for_node({})):
        profile = Path(each["FASTRTPS_DEFAULT_PROFILES_FILE"])
        assert profile.parent == tmp_path
        assert each["FASTDDS_DEFAULT_PROFILES_FILE"] == str(profile)
        assert profile.read_text() == transport_profile(transport, 1_000_000)


USERS = {
    "PATH": "/bin",
    "ROS_DOMAIN_ID": "42",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "ROS_LOCALHOST_ONLY": "0",
    "ROS_STATIC_PEERS": "robot.local",
    "CYCLONEDDS_URI": "<Tracing/>",
    "ZENOH_ROUTER_CHECK_ATTEMPTS": "3",
    "SECRET": "s",
}
"""What a user may have set for other work."""


def of_a_node(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    rmw: str,
    transport: Literal["inherit", "shared_memory", "udp"],
) -> dict[str, str]:
    """The whole environment of a node, where a user has set these variables."""
    selected = {"RMW_IMPLEMENTATION": rmw} if rmw else {}
    monkeypatch.setattr(os, "environ", USERS | selected)
    return environment(tmp_path, plan(transport)).for_node({"MODE": "fast"})


def expected(tmp_path: Path, **more: str) -> dict[str, str]:
    """What every process has, with any middleware, and `more`."""
    return {
        "PATH": "/bin",
        "CYCLONEDDS_URI": "<Tracing/>",
        "ZENOH_ROUTER_CHECK_ATTEMPTS": "3",
        "R2BSPEC_RUN_ID": "abc",
        "R2BSPEC_MODULES_FOLDER": str(tmp_path / "modules"),
        "ROS_DOMAIN_ID": "7",
        "PYTHONPATH": MODULE_NAMES,
        "PYTHONUNBUFFERED": "1",
        "ROS_LOG_DIR": str(tmp_path / "ros_logs"),
        "MODE": "fast",
        **more,
    }


@pytest.mark.parametrize("rmw", ["", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp"])
@pytest.mark.parametrize("transport", ["shared_memory", "udp"])
def test_with_fast_dds_a_profile_says_everything(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    rmw: str,
    transport: Literal["shared_memory", "udp"],
) -> None:
    profile = str(tmp_path / "transport.xml")
    assert of_a_node(tmp_path, monkeypatch, rmw, transport) == expected(
        tmp_path,
        **({"RMW_IMPLEMENTATION": rmw} if rmw else {}),
        ROS_STATIC_PEERS="robot.local",
        ROS_AUTOMATIC_DISCOVERY_RANGE="SYSTEM_DEFAULT",
        FASTRTPS_DEFAULT_PROFILES_FILE=profile,
        FASTDDS_DEFAULT_PROFILES_FILE=profile,
    )


def test_with_fast_dds_an_inherited_transport_is_kept_on_the_host(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert of_a_node(tmp_path, monkeypatch, "", "inherit") == expected(
        tmp_path, ROS_STATIC_PEERS="robot.local", ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST"
    )


@pytest.mark.parametrize("rmw", ["rmw_cyclonedds_cpp", "rmw_zenoh_cpp", "rmw_connextdds"])
@pytest.mark.parametrize("transport", ["inherit", "shared_memory", "udp"])
def test_with_another_middleware_discovery_is_kept_on_the_host_and_nothing_else_is_set(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    rmw: str,
    transport: Literal["inherit", "shared_memory", "udp"],
) -> None:
    # A run refuses the other transports; `r2bspec interfaces` starts nodes all the same.
    assert of_a_node(tmp_path, monkeypatch, rmw, transport) == expected(
        tmp_path, RMW_IMPLEMENTATION=rmw, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST"
    )
    assert list(tmp_path.iterdir()) == []
