"""The profile by which Fast DDS is configured: transports, segments and discovery."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.middleware.fast_dds import default_segment_bytes, transport_profile

NAMESPACE = {"dds": "http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"}


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
    assert segment == default_segment_bytes(largest)
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
