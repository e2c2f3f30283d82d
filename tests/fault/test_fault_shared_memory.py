"""Promise: shared memory that is small or fills up spoils no run without a word.

The runs have a /dev/shm of their own, so that nobody else's is filled.
"""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from ros_runs import Bench, relay_spec

STEPS = 20


def own_shared_memory(size: str) -> list[str]:
    """A command that runs what follows it with a small /dev/shm; needs the rights of root."""
    script = f'mount --make-rprivate / && mount -t tmpfs -o size={size} tmpfs /dev/shm && exec "$@"'
    through = ["unshare", "--mount", "sh", "-c", script, "sh"]
    if subprocess.run([*through, "true"], capture_output=True, check=False).returncode:
        pytest.skip("this user cannot give a process a /dev/shm of its own")
    return through


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return Bench(tmp_path_factory.mktemp("shared_memory"))


@only_nightly()
def test_shared_memory_without_room_is_named_or_done_without(bench: Bench) -> None:
    with bench.start(relay_spec(), through=own_shared_memory("64k")) as running:
        done = running.finish()
    if done.status in {2, 4} and "error[" in done.stderr:
        assert "/dev/shm" in done.error  # noqa: S108 - what the message must name
    else:
        done.assert_counts(STEPS)


def test_shared_memory_that_fills_up_in_mid_run_loses_nothing(bench: Bench) -> None:
    spec = relay_spec()
    spec["benchmark"] |= {"iterations": 2}
    with bench.start(spec, through=own_shared_memory("64m")) as running:
        running.wait_for("iteration 1 of 2")
        memory = Path(f"/proc/{running.child('player').pid}/root/dev/shm")
        filler = memory / "filler"
        with pytest.raises(OSError, match="No space left"), filler.open("wb", buffering=0) as file:
            while True:
                file.write(bytes(1 << 20))
        assert filler.stat().st_size > 0
        done = running.finish()
    done.assert_counts(2 * STEPS)


def test_what_does_not_fit_is_refused_before_player_and_nodes_start(bench: Bench) -> None:
    with bench.start(relay_spec(), through=own_shared_memory("16m")) as running:
        done = running.finish()
    assert done.status == 2, done.stderr
    assert "R2B664" in done.error
    assert "has 16 MiB free; the 4 processes of the measure phase need" in done.error
    assert "--shm-size=" in done.error
    assert "transport: udp" in done.error
    # These import ROS while the recording is read, and have no shared memory without a role.
    started = {process.role: process for process in done.run().record.processes}
    assert set(started) <= {"host", "observer"}
    assert {each.exit_code for each in started.values()} <= {0, -signal.SIGTERM}


@only_nightly()
def test_udp_is_the_way_out(bench: Bench) -> None:
    with bench.start(relay_spec(transport="udp"), through=own_shared_memory("16m")) as running:
        done = running.finish()
    done.assert_counts(STEPS)
