"""Promise: who publishes on the topics of a run and is not of it makes the run invalid."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from r2bspec.ipc.protocol import RUN_ID_VARIABLE
from ros_runs import IMAGE, Bench, Running, node_of_others, relay_spec

INTRUDER = """
import sys, time
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image
rclpy.init()
node = Node("intruder", namespace="/elsewhere")
publisher = node.create_publisher(Image, sys.argv[1], 10)
print("there", flush=True)
while rclpy.ok():
    try:
        publisher.publish(Image())
    except Exception:
        break
    time.sleep(0.02)
node.destroy_node()
rclpy.try_shutdown()
"""


HIDES_ITS_RUN = """
import sys
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image
rclpy.init(args=sys.argv)
node = Node("program")
out = node.create_publisher(Image, "output", 100)
node.create_subscription(Image, "input", out.publish, 100)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("foreign"))
    (found.folder / "intruder.py").write_text(INTRUDER)
    return found


def variables_of(running: Running, process: str) -> dict[str, str]:
    text = Path(f"/proc/{running.child(process).pid}/environ").read_text()
    return dict(each.split("=", 1) for each in text.split("\0") if "=" in each)


@contextmanager
def intruder(bench: Bench, running: Running, topic: str) -> Iterator[int]:
    """A program of another user, as far as a run can tell: in its domain, without its id.

    It does not work in the folder of the bench, whose processes are taken for those of runs.
    """
    environment = variables_of(running, "monitor")
    del environment[RUN_ID_VARIABLE]
    command = [sys.executable, str(bench.folder / "intruder.py"), topic]
    with node_of_others(command, env=environment, cwd="/", start_new_session=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"there\n"
        yield process.pid


def long_spec() -> dict[str, Any]:
    spec = relay_spec()
    spec["benchmark"] |= {"iterations": 6}
    return spec


@pytest.mark.parametrize("topic", ["/r2b/output", pytest.param("/r2b/input", marks=only_nightly())])
def test_a_publisher_that_is_not_of_the_run_makes_it_invalid_and_is_named(
    bench: Bench, topic: str
) -> None:
    with bench.start(long_spec()) as running:
        running.wait_for("iteration 1 of")
        with intruder(bench, running, topic) as pid:
            done = running.finish()
    assert done.status == 4
    assert done.outcome == "invalid"
    record = done.run().record
    assert record.status == "invalid"
    number = pid.to_bytes(4, "little")[:2].hex()
    assert re.search(
        rf"published on {topic}: node /elsewhere/intruder "
        rf"\(GUID prefix 010f....{number}\w{{12}}; python\S* \({pid}\) of user \S+\)",
        record.reason,
    )
    assert "/elsewhere/intruder" in done.stdout


@only_nightly()
def test_one_that_has_left_before_the_end_is_named_too(bench: Bench) -> None:
    with bench.start(long_spec()) as running:
        running.wait_for("iteration 2 of")
        with intruder(bench, running, "/r2b/output"):
            running.wait_for("iteration 4 of")
        done = running.finish()
    assert done.run().record.status == "invalid"
    assert "/elsewhere/intruder" in done.run().record.reason


@only_nightly()
def test_one_in_the_domain_of_another_run_does_not_matter(bench: Bench) -> None:
    spec = long_spec()
    with bench.start(spec) as other:
        other.wait_for("iteration 1 of")
        with intruder(bench, other, "/r2b/output"), bench.start(spec) as running:
            done = running.finish()
        other.finish()
    done.assert_complete()


@only_nightly()
def test_a_process_of_the_run_is_known_without_its_id_in_the_environment(bench: Bench) -> None:
    (bench.folder / "program.py").write_text(HIDES_ITS_RUN)
    program = {
        "command": ["env", "-u", RUN_ID_VARIABLE, sys.executable, "program.py"],
        "publishes": {"output": IMAGE},
        "subscribes": {"input": IMAGE},
    }
    done = bench.run(relay_spec(graph={"nodes": {"program": program}}))
    done.assert_complete()
    assert done.run().record.reason == ""
