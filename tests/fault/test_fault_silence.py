"""Promise: when messages do not arrive, the first break on their way is named, and where it stands.

What these nodes do cannot be told without running them: their topics have made-up names.
"""

from __future__ import annotations

import re
from typing import Any

import pytest

from r2bspec.report.findings_text import code_with_slug

pytest.importorskip("rclpy")

from ros_runs import IMAGE, Bench, Finished, quick_input, relay_node, relay_spec
from ros_runs import nothing_left as nothing_left

NODES = """
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import String

OUTPUT, INPUT, MASK = "".join(["out", "put"]), "".join(["in", "put"]), "".join(["ma", "sk"])


class Passes(Node):
    kind, qos = Image, 10

    def __init__(self, **kwargs):
        super().__init__("passes", **kwargs)
        self.out = self.create_publisher(self.kind, OUTPUT, self.qos)
        self.create_subscription(Image, INPUT, self.answer, 10)

    def answer(self, message):
        self.out.publish(message)


class Swallows(Passes):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.create_subscription(Image, MASK, lambda _: None, 10)

    def answer(self, message):
        pass


class OfAnotherType(Passes):
    kind = String


class BestEffort(Passes):
    qos = qos_profile_sensor_data
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("silence"))
    found.write_node("nodes.py", NODES)
    return found


def chain(kind: str, **remappings: str) -> dict[str, Any]:
    """A relay, then the node of a kind; the monitor watches what comes out of that."""
    rules = {"input": "between"} | remappings
    spec = relay_spec(
        graph={
            "nodes": {
                "first": relay_node(remappings={"output": "between"}),
                "second": {"python": f"./nodes.py:{kind}", "remappings": rules},
            }
        }
    )
    spec["benchmark"]["start_timeout"] = "6 s"
    return spec


def error_at(done: Finished) -> tuple[str, str]:
    """The code of the only error that has a place in the spec, and the line that it marks."""
    (found,) = re.findall(
        r"^\S+\.r2b\.yaml:(\d+):\d+: error\[(R2B\d+) [a-z0-9-]+\]", done.stderr, re.MULTILINE
    )
    line, code = found
    (spec,) = set(re.findall(r"^(\S+\.r2b\.yaml):\d", done.stderr, re.MULTILINE))
    return code, (done.folder.parent / spec).read_text().splitlines()[int(line) - 1].strip()


def test_a_remapping_that_matched_nothing_is_why_a_topic_is_missing(bench: Bench) -> None:
    spec = chain("Passes", outptu="last")
    spec["monitors"]["out"]["topic"] = "last"
    done = bench.run(spec)
    assert done.status == 2
    assert error_at(done) == ("R2B204", "outptu: last")
    assert (
        "no publisher on /r2b/last, to which monitor subscribes; /r2b/output, published by "
        "/r2b/second, has no subscription"
    ) in done.error


def test_types_that_differ(bench: Bench) -> None:
    done = bench.run(chain("OfAnotherType"))
    assert done.status == 2
    assert error_at(done) == ("R2B210", "topic: output")
    assert (
        "monitor subscribes to /r2b/output as sensor_msgs/msg/Image, but /r2b/second publishes "
        in done.error
    )
    assert "/r2b/second publishes /r2b/output as std_msgs/msg/String" in done.error


def test_an_input_that_nobody_reads(bench: Bench) -> None:
    spec = relay_spec(graph={"nodes": {"second": {"python": "./nodes.py:Passes"}}})
    spec["playback"]["inputs"] = {"inptu": quick_input("loaded")}
    spec["benchmark"]["start_timeout"] = "4 s"
    done = bench.run(spec)
    assert done.status == 2
    assert error_at(done) == ("R2B208", "inptu:")
    assert (
        "no subscription to /r2b/inptu, which is played; the closest name is /r2b/input, to which "
        "/r2b/second subscribes"
    ) in done.error


def test_qos_that_never_matches(bench: Bench) -> None:
    spec = chain("BestEffort")
    spec["graph"]["nodes"]["third"] = relay_node(remappings={"input": "output", "output": "last"})
    spec["monitors"]["out"]["topic"] = "last"
    done = bench.run(spec)
    assert done.status == 2
    assert error_at(done) == ("R2B216", "input: output")
    assert "/r2b/third requests a QoS on /r2b/output that /r2b/second does not offer" in done.error
    # The count of a subscription with a compatible QoS.
    assert re.search(r"/r2b/output .*best_effort.*; 10 messages$", done.error, re.MULTILINE)


def test_a_node_that_swallows_messages(bench: Bench) -> None:
    spec = chain("Swallows")
    spec["monitors"]["between"] = {"topic": "between", "format": IMAGE}
    done = bench.run(spec)
    assert done.status == 4
    assert done.run().record.status == "incomplete"
    assert done.error.startswith(
        "error[R2B641 no-output]: no messages on /r2b/output: /r2b/second publishes nothing on "
        "/r2b/output, although it subscribes to /r2b/between (10 messages); it also subscribes to "
        "/r2b/mask, which has no publisher\n"
    )
    assert re.search(r"/r2b/input .*publishers: player .*; 10 messages$", done.error, re.MULTILINE)
    assert bench.judge(done.folder).status in {3, 4}


def test_a_remapping_that_changes_nothing_ends_no_run_that_can_go_on(bench: Bench) -> None:
    done = bench.run(chain("Passes", usnued="elsewhere"))
    done.assert_complete()
    assert f"warning[{code_with_slug('R2B204')}]: /r2b/second has no topic 'usnued'" in done.stderr
    (difference,) = done.result()["differences"]
    assert difference["harmless"]
