"""What processes of a run find in their environment."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.execute.processes.environment import (
    RunEnvironment,
    inherited_environment,
    segment_bytes,
    transport_profile,
)
from r2bspec.plan.plan import Plan
from run_simulation import Simulation

NAMESPACE = {"dds": "http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"}

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
    assert made.for_node({})["PYTHONPATH"] == f"/opt/lib:{tmp_path}/src"


@pytest.mark.parametrize("path", [":/opt/lib", "/opt/lib:", "/opt/lib::", "::/opt/lib"])
def test_an_empty_entry_does_not_mean_the_folder_of_the_spec(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", path)
    assert environment(tmp_path, plan()).for_node({})["PYTHONPATH"] == "/opt/lib"


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


def descriptors(profile: str) -> dict[str, ET.Element]:
    """The transports of a profile by name, each used by its participant."""
    root = ET.fromstring(profile)  # noqa: S314 - written by the function under test
    found = {
        each.findtext("dds:transport_id", "", NAMESPACE): each
        for each in root.iterfind(".//dds:transport_descriptor", NAMESPACE)
    }
    used = [
        each.text for each in root.iterfind(".//dds:userTransports/dds:transport_id", NAMESPACE)
    ]
    assert used == list(found)
    assert root.findtext(".//dds:useBuiltinTransports", "", NAMESPACE) == "false"
    return found


@given(largest=st.integers(0, 2**28))
def test_shared_memory_holds_several_of_the_largest_message(largest: int) -> None:
    found = descriptors(transport_profile("shared_memory", largest))
    assert [each.findtext("dds:type", "", NAMESPACE) for each in found.values()] == ["SHM", "UDPv4"]
    segment = int(found["shm"].findtext("dds:segment_size", "", NAMESPACE))
    message = int(found["shm"].findtext("dds:maxMessageSize", "", NAMESPACE))
    assert segment == segment_bytes(largest)
    # Two full queues of ten, as far as the 32 bits go that the size is read into.
    assert segment >= min(20 * largest, 2**32 - 2**20)
    assert largest < message <= segment
    assert segment < 2**32


def test_processes_announce_themselves_for_as_long_as_they_live() -> None:
    # Player and monitor are seconds older than the graph, which has to find them at once.
    root = ET.fromstring(transport_profile("udp", 1_000_000))  # noqa: S314 - as above
    period_ns = root.findtext(".//dds:leaseAnnouncement/dds:nanosec", "", NAMESPACE)
    assert 0 < int(period_ns) <= 500_000_000
    assert root.find(".//dds:leaseAnnouncement/dds:sec", NAMESPACE) is None


@pytest.mark.parametrize("transport", ["shared_memory", "udp"])
def test_processes_find_each_other_on_this_host_only(transport: str) -> None:
    profile = transport_profile(transport, 1_000_000)
    root = ET.fromstring(profile)  # noqa: S314 - written by the function under test
    asked = root.findall(".//dds:initialPeersList/dds:locator/dds:udpv4/dds:address", NAMESPACE)
    assert [each.text for each in asked] == ["127.0.0.1"]
    # What stands here takes the place of multicast.
    assert root.find(".//dds:metatrafficUnicastLocatorList/dds:locator", NAMESPACE) is not None
    used = descriptors(profile)["udp"].findall("dds:interfaceWhiteList/dds:address", NAMESPACE)
    assert [each.text for each in used] == ["127.0.0.1"]


def test_udp_uses_no_shared_memory() -> None:
    found = descriptors(transport_profile("udp", 10_000_000))
    assert [each.findtext("dds:type", "", NAMESPACE) for each in found.values()] == ["UDPv4"]
