"""Messages go the way that a spec names, and no other."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

pytest.importorskip("rclpy")

from r2bspec.execute.processes.environment import RunEnvironment
from r2bspec.execute.processes.prerequisites import reserved_domain
from r2bspec.ipc.network import why_not_emulated
from r2bspec.middleware.fast_dds import default_segment_bytes
from ros_runs import HANG_S, Bench, relay_spec
from ros_runs import bench as bench
from run_simulation import Simulation

IMAGE_BYTES = 1280 * 720 * 3

LOOK = """
import os, pathlib, rclpy
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("looks")
publisher = node.create_publisher(String, "a", 10)
maps = pathlib.Path("/proc/self/maps").read_text()
print(sorted({each.split()[-1] for each in maps.splitlines() if "/dev/shm/fast" in each}))
for name in {each.split()[-1] for each in maps.splitlines() if "/dev/shm/fast" in each}:
    print("size", os.stat(name).st_size)
inodes = {os.readlink(f"/proc/self/fd/{each}") for each in os.listdir("/proc/self/fd")
          if os.path.exists(f"/proc/self/fd/{each}")}
for line in list(open("/proc/net/udp"))[1:]:
    words = line.split()
    if f"socket:[{words[9]}]" in inodes:
        print("bound", words[1].split(":")[0])
node.destroy_node()
rclpy.shutdown()
"""


def seen(tmp_path: Path, transport: Any) -> str:
    """What a process of a run has open: segments with their sizes, and addresses of sockets."""
    plan = Simulation().plan()
    made = msgspec.structs.replace(plan, transport=transport)
    with reserved_domain() as domain:
        environment = RunEnvironment(
            made, run_id="t", domain=domain, scratch=tmp_path, largest_message_bytes=IMAGE_BYTES
        )
        done = subprocess.run(
            [sys.executable, "-c", LOOK],
            env=environment.for_node({}),
            capture_output=True,
            text=True,
            timeout=HANG_S,
            check=True,
        )
    return done.stdout


def sizes(said: str) -> list[int]:
    return [int(each) for each in re.findall(r"size (\d+)", said)]


def test_udp_is_udp_alone_and_listens_to_no_other_machine(tmp_path: Path) -> None:
    """The middleware would add shared memory of its own, and prefer it."""
    said = seen(tmp_path, "udp")
    assert sizes(said) == []
    # 127.0.0.1, in the byte order of this machine.
    assert set(re.findall(r"bound (\w+)", said)) == {"0100007F"}


def test_shared_memory_is_as_large_as_the_messages_need_and_there_is_no_other(
    tmp_path: Path,
) -> None:
    found = sizes(seen(tmp_path, "shared_memory"))
    segments = [each for each in found if each > 1 << 18]
    assert len(segments) == 1, found
    assert segments[0] >= default_segment_bytes(IMAGE_BYTES)


REFUSED = why_not_emulated()
HAS_NETEM = REFUSED is None
# Where the kernel has no netem, another discipline shows which way messages go.
INSTEAD = """#!/bin/sh
shift 6
exec {tc} qdisc add dev lo root tbf rate 1gbit burst 1mb latency 50ms
"""


@pytest.mark.skipif(
    not HAS_NETEM and "sch_netem" not in str(REFUSED), reason=f"no namespace: {REFUSED}"
)
def test_messages_of_a_run_with_a_network_pass_it(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tc = shutil.which("tc", path="/usr/sbin:/sbin:/usr/bin:/bin")
    if not HAS_NETEM:
        (tmp_path / "tc").write_text(INSTEAD.format(tc=tc))
        (tmp_path / "tc").chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    look = f"{tc} -s qdisc show dev lo > {tmp_path}/seen"
    done = bench.run(
        relay_spec(
            transport="udp",
            network={"delay": "20 ms"},
            after_ready={"look": {"command": ["sh", "-c", look]}},
        )
    )
    done.assert_counts(20)
    seen = (tmp_path / "seen").read_text()
    assert ("netem" if HAS_NETEM else "tbf") in seen
    (packets,) = re.findall(r"Sent \d+ bytes (\d+) pkt", seen)
    assert int(packets) > 0
    if HAS_NETEM:
        # To the graph, and from it.
        assert done.monitor()["latency"]["p50"] >= 0.04
