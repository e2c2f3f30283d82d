"""Promise: what cannot be read or written is named, and what could be written can be used."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import Bench, Finished, relay_spec

NODES = """
import sys


class Talkative(Node):
    def __init__(self, **kwargs):
        super().__init__("talkative", **kwargs)
        self.count = 0
        self.out = self.create_publisher(Image, "output", 100)
        self.create_subscription(Image, "input", self.answer, 100)

    def answer(self, message):
        self.count += 1
        # Not in the warm-up, which a busy machine repeats: there the disk would be full too soon.
        if self.count > 60:
            print("word " * 20_000, file=sys.stderr, flush=True)
        self.out.publish(message)


class TalkativeFromTheStart(Talkative):
    def answer(self, message):
        print("word " * 20_000, file=sys.stderr, flush=True)
        self.out.publish(message)


class SilentWithoutRoom(Talkative):
    def answer(self, message):
        try:
            print("word " * 20_000, file=sys.stderr, flush=True)
        except OSError:
            return
        if self.count < 0:
            self.out.publish(message)
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("storage"))
    found.write_node("nodes.py", NODES)
    return found


SmallDisk = Callable[[int], Path]


@pytest.fixture
def small_disk(bench: Bench) -> Iterator[SmallDisk]:
    """Mounts a file system of a few kibibytes; needs the rights of root."""
    mounted: list[Path] = []

    def mount(kibibytes: int) -> Path:
        folder = Path(tempfile.mkdtemp(prefix=f"disk{kibibytes}-", dir=bench.folder))
        command = ["mount", "-t", "tmpfs", "-o", f"size={kibibytes}k", "tmpfs", str(folder)]
        try:
            subprocess.run(command, check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError):
            pytest.skip("this user cannot mount a small disk")
        mounted.append(folder)
        return folder

    yield mount
    for folder in mounted:
        subprocess.run(["umount", str(folder)], check=True)  # noqa: S607


def assert_names_the_file(bench: Bench, done: Finished) -> None:
    """See that the run tells which file the disk had no room for, and can be judged."""
    assert done.status == 4
    assert done.error.startswith("error[R2B651 run-folder-not-writable]")
    assert re.search(rf"{re.escape(str(done.folder))}/\S+ cannot be written", done.error)
    assert "No space left on device" in done.error
    record = done.run().record
    assert record.status == "incomplete"
    assert record.reason.startswith("R2B651: ")
    assert bench.judge(done.folder).status == 4


@only_nightly()
@pytest.mark.parametrize("kibibytes", [120, 140, 170, 200])
def test_a_disk_without_room_for_the_samples(
    bench: Bench, small_disk: SmallDisk, kibibytes: int
) -> None:
    # Some of it is written before a playback, and some by the monitor as it goes.
    spec = relay_spec()
    spec["benchmark"] |= {"iterations": 50}
    done = bench.run(spec, output=small_disk(kibibytes) / "run")
    assert_names_the_file(bench, done)


def test_a_disk_without_room_for_the_messages(bench: Bench, small_disk: SmallDisk) -> None:
    done = bench.run(relay_spec(), output=small_disk(60) / "run")
    assert done.status == 4
    assert "No space left on device" in done.error
    assert str(done.folder) in done.error
    # What took the room is gone, so that there is some for the record.
    assert "No space left" in done.run().record.reason
    assert bench.judge(done.folder).status == 4


def test_a_disk_that_fills_up_in_mid_run(bench: Bench, small_disk: SmallDisk) -> None:
    spec = relay_spec(graph={"nodes": {"relay": {"python": "./nodes.py:Talkative"}}})
    spec["benchmark"] |= {"iterations": 50}
    done = bench.run(spec, output=small_disk(4096) / "run")
    assert_names_the_file(bench, done)
    assert [each.name for each in done.folder.iterdir() if each.name.startswith(".")] == []


@only_nightly()
@pytest.mark.parametrize(
    ("node", "kibibytes"), [("TalkativeFromTheStart", 1024), ("SilentWithoutRoom", 1280)]
)
def test_a_disk_that_a_node_fills_in_the_warm_up(
    bench: Bench, small_disk: SmallDisk, node: str, kibibytes: int
) -> None:
    # Whether the node then raises or publishes nothing, the full disk is what is reported.
    spec = relay_spec(graph={"nodes": {"relay": {"python": f"./nodes.py:{node}"}}})
    spec["benchmark"] |= {"iterations": 50, "start_timeout": "20 s"}
    done = bench.run(spec, output=small_disk(kibibytes) / "run")
    assert_names_the_file(bench, done)


def test_a_file_system_that_is_read_only(bench: Bench, small_disk: SmallDisk) -> None:
    disk = small_disk(64)
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)  # noqa: S607
    done = bench.run(relay_spec(), output=disk / "run")
    assert done.status == 2
    assert done.error.startswith("error[R2B651 run-folder-not-writable]")
    assert f"{disk / 'run'} cannot be created: Read-only file system" in done.error


def test_a_folder_that_may_not_be_written_to(bench: Bench) -> None:
    folder = bench.folder / "read_only"
    folder.mkdir()
    folder.chmod(0o500)
    if os.access(folder, os.W_OK):
        pytest.skip("this user may write everywhere")
    done = bench.run(relay_spec(), output=folder / "run")
    assert done.status == 2
    assert "cannot be created: Permission denied" in done.error


@only_nightly()
def test_a_disk_that_a_profiler_fills_costs_no_verdict(bench: Bench, small_disk: SmallDisk) -> None:
    filling = "sh -c 'cat /dev/zero > $(profile).big; exec \"$@\"' sh"
    done = bench.run(relay_spec(), "--profile", filling, output=small_disk(4096) / "run")
    done.assert_complete()
    (profile,) = done.run().record.profiles
    assert profile.error == "the profile was removed, because the disk is full"
    assert profile.files == ()
    assert bench.judge(done.folder).status == done.status
