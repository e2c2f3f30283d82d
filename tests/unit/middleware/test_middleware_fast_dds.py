"""Fast DDS: its profile, and what dead processes leave of it in shared memory."""

from __future__ import annotations

import fcntl
import mmap
import os
import stat
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.middleware.fast_dds import MIDDLEWARE, default_segment_bytes, transport_profile

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


@pytest.fixture
def memory(tmp_path: Path) -> Path:
    """Stands for /dev/shm; locks and maps on its files are real."""
    return tmp_path


def make(memory: Path, name: str, *, lock: bool = True) -> None:
    (memory / name).write_bytes(bytes(mmap.PAGESIZE))
    (memory / f"sem.{name}_mutex").touch()
    if lock:
        (memory / f"{name}_el").touch()


@contextmanager
def owner(memory: Path, name: str) -> Iterator[None]:
    """Hold the lock as a participant does."""
    with (memory / f"{name}_el").open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def names(memory: Path) -> set[str]:
    return {each.name for each in memory.iterdir()}


def test_a_segment_in_use_stays(memory: Path) -> None:
    make(memory, "fastrtps_0123")
    before = names(memory)
    with owner(memory, "fastrtps_0123"):
        assert MIDDLEWARE.remove_dead_shm_files(memory) == []
        assert names(memory) == before
    assert MIDDLEWARE.remove_dead_shm_files(memory) == ["fastrtps_0123"]


def test_a_segment_without_a_lock_is_removed_unless_it_is_mapped(memory: Path) -> None:
    make(memory, "fastrtps_mapped", lock=False)
    make(memory, "fastrtps_dead", lock=False)
    with (memory / "fastrtps_mapped").open("r+b") as file, mmap.mmap(file.fileno(), 0):
        assert MIDDLEWARE.remove_dead_shm_files(memory) == ["fastrtps_dead"]
    assert names(memory) == {"fastrtps_mapped", "sem.fastrtps_mapped_mutex"}


def test_what_is_older_than_the_run_stays(memory: Path) -> None:
    make(memory, "fastrtps_old")
    make(memory, "fastrtps_older", lock=False)
    for each in memory.iterdir():
        os.utime(each, (1_000.0, 1_000.0))
    make(memory, "fastrtps_new")
    assert MIDDLEWARE.remove_dead_shm_files(memory, since_s=time.time() - 3600) == ["fastrtps_new"]
    assert "fastrtps_old" in names(memory)
    assert "fastrtps_older" in names(memory)


def test_files_of_another_user_stay(memory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make(memory, "fastrtps_0123")
    make(memory, "fastrtps_4567", lock=False)
    before = names(memory)
    monkeypatch.setattr(os, "getuid", lambda: os.geteuid() + 1)
    assert MIDDLEWARE.remove_dead_shm_files(memory) == []
    assert names(memory) == before


def test_only_segments_that_these_processes_map_are_made_private(tmp_path: Path) -> None:
    memory, proc = tmp_path / "shm", tmp_path / "proc"
    for folder in (memory, proc / "7"):
        folder.mkdir(parents=True)
    elsewhere = tmp_path / "elsewhere"
    for each in (memory / "fastrtps_mine", memory / "fastrtps_other", elsewhere):
        each.touch()
        each.chmod(0o644)
    (memory / "fastrtps_link").symlink_to(elsewhere)
    names = ("mine", "link", "gone")
    (proc / "7" / "maps").write_text(
        "".join(f"7f00-7f10 rw-s 0 00:1 42   {memory}/fastrtps_{name}\n" for name in names)
    )
    assert MIDDLEWARE.readable_shm_files(memory) == ["fastrtps_mine", "fastrtps_other"]
    MIDDLEWARE.make_shm_files_private([7, 8], memory, proc)
    assert stat.S_IMODE((memory / "fastrtps_mine").stat().st_mode) == 0o600
    assert stat.S_IMODE((memory / "fastrtps_other").stat().st_mode) == 0o644
    assert stat.S_IMODE(elsewhere.stat().st_mode) == 0o644
    assert MIDDLEWARE.readable_shm_files(memory) == ["fastrtps_other"]
