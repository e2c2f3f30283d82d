"""What processes of a run find in their environment; values of secrets reach them and no report."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import msgspec
import pytest

import r2bspec
from r2bspec.execute.processes.environment import (
    RunEnvironment,
    inherited_environment,
    make_redactor,
)
from r2bspec.execute.processes.process import ManagedProcess
from r2bspec.ipc.process_cleanup import SessionLeader
from r2bspec.middleware.middleware import TransportKind, discovery_settings
from r2bspec.plan.plan import Plan
from run_simulation import Simulation

NEEDED_BY_ROS = dict.fromkeys(
    ("AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "RMW_IMPLEMENTATION", "PYTHONPATH", "HOME"), "value"
)
MODULE_NAMES = str(Path(r2bspec.__file__).parent / "harness" / "module_names")

SECRETS = {
    "GITHUB_TOKEN": "t0",
    "AWS_SECRET_ACCESS_KEY": "t1",
    "PASSWORD": "t2",
    "SSH_AUTH_SOCK": "t3",
    "MY_PATH": "t4",
    "http_proxy": "http://user:t5@proxy",
}


TRANSPORTS: tuple[TransportKind, ...] = ("shared_memory", "udp", "inherit")
CONFIGURED = TRANSPORTS[:2]


def plan(transport: TransportKind = "shared_memory", environment: tuple[str, ...] = ()) -> Plan:
    return msgspec.structs.replace(
        Simulation().plan(), transport=transport, environment=environment
    )


def environment(tmp_path: Path, used: Plan) -> RunEnvironment:
    return RunEnvironment(
        used, run_id="abc", domain=7, scratch=tmp_path, largest_message_bytes=1_000_000
    )


@pytest.mark.parametrize(
    ("environ", "named", "inherited"),
    [
        (SECRETS | {"PATH": "/bin", "LC_ALL": "C"}, (), {"PATH", "LC_ALL"}),
        (SECRETS, ("PASSWORD", "AWS_*"), {"PASSWORD", "AWS_SECRET_ACCESS_KEY"}),
        # Names are told apart by case.
        ({"path": "a", "Path": "b"}, (), set()),
        (NEEDED_BY_ROS, (), {*NEEDED_BY_ROS}),
    ],
)
def test_what_ros_programs_need_and_what_the_spec_names_is_inherited(
    environ: dict[str, str], named: tuple[str, ...], inherited: set[str]
) -> None:
    assert inherited_environment(environ, named) == {name: environ[name] for name in inherited}


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


USERS = {
    "PATH": "/bin",
    "ROS_DOMAIN_ID": "42",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "ROS_LOCALHOST_ONLY": "0",
    "ROS_STATIC_PEERS": "robot.local",
    "ROS_DISCOVERY_SERVER": "10.0.0.1:11811",
    "ROS_SUPER_CLIENT": "true",
    "CYCLONEDDS_URI": "<Tracing/>",
    "ZENOH_ROUTER_CHECK_ATTEMPTS": "3",
    "SECRET": "s",
}
"""What a user may have set for other work."""


def of_a_node(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    rmw: str,
    transport: TransportKind,
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
def test_with_fast_dds_a_profile_says_everything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rmw: str
) -> None:
    profile = str(tmp_path / "transport.xml")
    selected = {"RMW_IMPLEMENTATION": rmw} if rmw else {}
    for transport in CONFIGURED:
        assert of_a_node(tmp_path, monkeypatch, rmw, transport) == expected(
            tmp_path,
            **selected,
            ROS_AUTOMATIC_DISCOVERY_RANGE="SYSTEM_DEFAULT",
            FASTRTPS_DEFAULT_PROFILES_FILE=profile,
            FASTDDS_DEFAULT_PROFILES_FILE=profile,
        )
    # An inherited one is kept on the host by the variable of ROS.
    assert of_a_node(tmp_path, monkeypatch, rmw, "inherit") == expected(
        tmp_path, **selected, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST"
    )


@pytest.mark.parametrize("rmw", ["rmw_cyclonedds_cpp", "rmw_zenoh_cpp", "rmw_connextdds"])
def test_with_another_middleware_discovery_is_kept_on_the_host_and_nothing_else_is_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rmw: str
) -> None:
    # A run refuses the other transports; `r2bspec interfaces` starts nodes all the same.
    for transport in TRANSPORTS:
        assert of_a_node(tmp_path, monkeypatch, rmw, transport) == expected(
            tmp_path, RMW_IMPLEMENTATION=rmw, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST"
        )
    assert list(tmp_path.iterdir()) == []


def test_what_changes_discovery_is_passed_on_where_the_spec_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "environ", USERS)
    named = msgspec.structs.replace(plan("udp"), environment=("ROS_DISCOVERY_SERVER",))
    passed = environment(tmp_path, named).for_node({})
    assert passed["ROS_DISCOVERY_SERVER"] == "10.0.0.1:11811"
    assert "ROS_SUPER_CLIENT" not in passed


@pytest.mark.parametrize(
    ("transport", "named", "of_processes", "said"),
    [
        ("udp", [], {}, ""),
        ("udp", ["ROS_DISCOVERY_SERVER"], {}, "ROS_DISCOVERY_SERVER can change which nodes"),
        ("udp", [], {"talker": ["ROS_DOMAIN_ID", "MODE"]}, "ROS_DOMAIN_ID (of talker) can change"),
        ("inherit", [], {}, "CYCLONEDDS_URI can change which nodes"),
    ],
)
def test_what_changes_discovery_is_named(
    transport: TransportKind, named: list[str], of_processes: dict[str, list[str]], said: str
) -> None:
    environ = USERS | {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}
    text = discovery_settings(environ, transport, named, of_processes)
    assert text.startswith(said)
    assert bool(text) == bool(said)


PRINTED = {
    "API_TOKEN": "abc.+(123",
    "DB_PASSWORD": "abc.+(123-and-more",
    "SHORT_KEY": "on",
    "EMPTY_KEY": "",
    "DATA_DIR": "/data/of/somebody",
}


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("with abc.+(123 in it, twice: abc.+(123", "with *** in it, twice: ***"),
        ("the longer one: abc.+(123-and-more.", "the longer one: ***."),
        ("on /data/of/somebody", "on /data/of/somebody"),
    ],
)
def test_values_of_secrets_are_redacted(text: str, shown: str) -> None:
    assert make_redactor(PRINTED)(text) == shown


def test_a_log_is_redacted_before_it_is_cut(tmp_path: Path) -> None:
    """A secret of which the cut would leave the end is gone, too."""
    secret = "".join(f"{number:04d}," for number in range(4000))
    log = tmp_path / "node.log"
    log.write_text(f"{secret}\nended\n")
    redact = make_redactor({"A_KEY": secret})
    with SessionLeader([sys.executable, "-c", ""]) as ended:
        process = ManagedProcess("node", "host", ended, log, None, redact)
    assert process.log_tail() == "***\nended"
