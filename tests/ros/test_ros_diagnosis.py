"""Promise: what can never work is said as soon as it is certain, and where in the spec it stands.

What these nodes do cannot be told without running them: their topics and parameters have made-up
names, or they are programs that r2bspec cannot look into.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from command_line import Call
from nightly import only_nightly
from r2bspec.record.run_folder import open_run
from r2bspec.report.findings_text import code_with_slug

pytest.importorskip("rclpy")

from ros_runs import IMAGE, Bench, quick_input, relay_node, relay_spec
from ros_runs import bench as bench

PROGRAM = """
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image

rclpy.init()
node = Node("plain")
node.declare_parameter("gain", 1.0)
publisher = node.create_publisher(Image, "out", 10)
node.create_subscription(Image, "image", publisher.publish, 10)
try:
    rclpy.spin(node)
except BaseException:
    pass
"""
NODES = """
import threading
import time

from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import String

OUTPUT, INPUT, MASK = "".join(["out", "put"]), "".join(["in", "put"]), "".join(["ma", "sk"])


class Passes(Node):
    kind, qos = Image, 10

    def __init__(self, **kwargs):
        super().__init__("passes", **kwargs)
        for name in ("spe" + "ed", "ra" + "te"):
            self.declare_parameter(name, 0)
        self.begin()

    def begin(self):
        self.out = self.create_publisher(self.kind, OUTPUT, self.qos)
        self.create_subscription(Image, INPUT, self.answer, 10)

    def answer(self, message):
        self.out.publish(message)


class Swallows(Passes):
    def begin(self):
        super().begin()
        self.create_subscription(Image, MASK, lambda _: None, 10)

    def answer(self, message):
        pass


class OfAnotherType(Passes):
    kind = String


class BestEffort(Passes):
    qos = qos_profile_sensor_data


class LoadsForLong(Passes):
    def begin(self):
        threading.Thread(target=self.load, daemon=True).start()

    def load(self):
        began = time.monotonic()
        while time.monotonic() - began < 14:
            sum(range(1000))
        super().begin()


class Raises(Passes):
    def begin(self):
        raise ValueError("the calibration file is missing")


class Hangs(Passes):
    def begin(self):
        time.sleep(600)


class Dies(Passes):
    def begin(self):
        print("no licence", flush=True)
        raise SystemExit(7)


def nothing(**kwargs):
    return None
"""


@pytest.fixture(scope="module", autouse=True)
def programs(bench: Bench) -> None:
    (bench.folder / "plain.py").write_text(PROGRAM)
    (bench.folder / "broken.py").write_text("import a_module_that_is_not_there\n")


def graph(start_timeout: str = "60 s", **nodes: dict[str, Any]) -> dict[str, Any]:
    spec = relay_spec(graph={"nodes": nodes})
    spec["benchmark"]["start_timeout"] = start_timeout
    return spec


def node(kind: str, **keys: Any) -> dict[str, Any]:
    return {"python": f"./nodes.py:{kind}"} | keys


def program(**keys: Any) -> dict[str, Any]:
    return {"command": [sys.executable, "./plain.py"], **keys}


REMAPPED = {"image": "input", "out": "output"}


def chain(kind: str, start_timeout: str = "6 s", **remappings: str) -> dict[str, Any]:
    """A relay, then the node of a kind; the monitor watches what comes out of that."""
    return graph(
        start_timeout,
        first=relay_node(remappings={"output": "between"}),
        second=node(kind, remappings={"input": "between"} | remappings),
    )


# What is wrong in the spec


def wrong_output() -> dict[str, Any]:
    spec = chain("Passes", outptu="last")
    spec["monitors"]["out"]["topic"] = "last"
    return spec


def wrong_input() -> dict[str, Any]:
    spec = graph(second=node("Passes"))
    spec["playback"]["inputs"] = {"inptu": quick_input("loaded")}
    return spec


def third_reads_best_effort() -> dict[str, Any]:
    spec = chain("BestEffort")
    spec["graph"]["nodes"]["third"] = relay_node(remappings={"input": "output", "output": "last"})
    spec["monitors"]["out"]["topic"] = "last"
    return spec


@dataclass(frozen=True)
class Wrong:
    """A spec, the code of its error, the line that it marks, and what is said besides.

    Attributes:
        certain: whether the start ends before its time is over, also on a busy machine.
    """

    spec: Callable[[], dict[str, Any]]
    code: str
    line: str
    words: tuple[str, ...]
    certain: bool = True


WRONG = {
    "a remapping that matches nothing": Wrong(
        wrong_output,
        "R2B204",
        "outptu: last",
        (
            "no publisher on /r2b/last, to which monitor subscribes",
            "/r2b/output, published by /r2b/second, has no subscription",
        ),
        certain=False,
    ),
    "QoS that never matches": Wrong(
        third_reads_best_effort,
        "R2B216",
        "input: output",
        (
            "/r2b/third requests a QoS on /r2b/output that /r2b/second does not offer",
            "best_effort",
            # The count of a subscription with a compatible QoS.
            "; 10 messages",
        ),
    ),
    "a parameter of a program": Wrong(
        lambda: graph(plain=program(remappings=REMAPPED, parameters={"gian": 2.0})),
        "R2B211",
        "gian: 2.0",
        ("/r2b/plain declares no parameter 'gian'", "did you mean 'gain'?"),
    ),
}
ALSO_WRONG = {
    "an input that nobody reads": Wrong(
        wrong_input,
        "R2B208",
        "inptu:",
        (
            "no subscription to /r2b/inptu, which is played",
            "the closest name is /r2b/input, to which /r2b/second subscribes",
        ),
    ),
    "types that differ": Wrong(
        lambda: chain("OfAnotherType"),
        "R2B210",
        "topic: output",
        ("/r2b/second publishes /r2b/output as std_msgs/msg/String",),
        certain=False,
    ),
}


def nightly_of(table: dict[str, Any]) -> list[Any]:
    return [pytest.param(name, marks=only_nightly()) for name in table]


@pytest.mark.parametrize("name", [*WRONG, *nightly_of(ALSO_WRONG)])
def test_what_is_wrong_is_said_once_at_its_line(bench: Bench, name: str) -> None:
    wrong = (WRONG | ALSO_WRONG)[name]
    done = bench.run(wrong.spec())
    # To try again would not help: the spec is to blame, as where validate finds the same.
    assert done.status == 2
    found = re.findall(
        r"^(\S+\.r2b\.yaml):(\d+):\d+: error\[(R2B\d+) [a-z0-9-]+\]", done.stderr, re.MULTILINE
    )
    marked = [
        Path(file).read_text().splitlines()[int(line) - 1]
        for file, line, code in found
        if code == wrong.code
    ]
    assert [line for line in marked if line.strip().startswith(wrong.line)]
    for words in wrong.words:
        assert words in done.error
    assert done.stderr.replace("not ready so far: " + wrong.words[0], "").count(wrong.words[0]) == 1
    if wrong.certain:
        assert "was not ready after" not in done.stderr
    assert done.run().record.status == "incomplete"


@only_nightly()
def test_a_plan_from_a_file_has_no_places_but_the_same_code(bench: Bench) -> None:
    spec = bench.write(graph(relay=node("Passes", parameters={"rtae": 3})), "planned")
    plan = bench.folder / "planned.json"
    made = subprocess.run(
        [sys.executable, "-m", "r2bspec", "plan", str(spec)],
        check=False,
        capture_output=True,
        cwd=bench.folder,
    )
    plan.write_bytes(made.stdout)
    done = bench.run(plan)
    assert done.status == 2
    assert done.error.startswith(
        f"error[{code_with_slug('R2B211')}]: /r2b/relay declares no parameter 'rtae'"
    )


def test_a_remapping_that_changes_nothing_ends_no_run_that_can_go_on(bench: Bench) -> None:
    done = bench.run(chain("Passes", "60 s", usnued="elsewhere"))
    done.assert_complete()
    assert f"warning[{code_with_slug('R2B204')}]: /r2b/second has no topic 'usnued'" in done.stderr
    (difference,) = done.result()["differences"]
    assert difference["harmless"]


@only_nightly()
def test_a_parameter_of_a_program_that_resembles_no_other_is_a_warning(bench: Bench) -> None:
    done = bench.run(graph(plain=program(remappings=REMAPPED, parameters={"speed": 2.0})))
    done.assert_complete()
    (difference,) = done.run().record.differences
    assert (difference.code, difference.name, difference.harmless) == ("R2B211", "speed", True)
    assert "/r2b/plain declares no parameter 'speed'; ROS ignores it" in done.stderr


# What does not come up, or does not answer


def test_a_node_that_swallows_messages_is_named_and_then_not_waited_for(bench: Bench) -> None:
    spec = chain("Swallows", "15 s")
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
    early = done.stderr.split("error[", 1)[0]
    assert "no messages on /r2b/output so far: /r2b/second publishes nothing" in early
    assert "all nodes are idle and answer: the start is no longer waited for" in early
    assert bench.judge(done.folder).status in {3, 4}


@only_nightly()
def test_a_busy_node_is_waited_for(bench: Bench) -> None:
    # It computes for longer than a third of this.
    done = bench.run(graph("30 s", slow=node("LoadsForLong")))
    done.assert_complete()
    assert "idle" not in done.stderr
    assert "not ready so far: no subscription to /r2b/input" in done.stderr


@only_nightly()
def test_an_idle_program_without_the_topics_is_not_waited_for(bench: Bench) -> None:
    spec = graph("12 s", plain=program(subscribes={"first": IMAGE}, publishes={"second": IMAGE}))
    spec["playback"]["inputs"] = {"first": spec["playback"]["inputs"].pop("input")}
    spec["monitors"]["out"]["topic"] = "second"
    done = bench.run(spec)
    assert done.status == 4
    early, late = done.stderr.split("error[", 1)
    assert "not ready so far: no subscription to /r2b/first" in early
    assert re.search(r"is not ready and has not changed for \d+ s, with all nodes idle", late)
    assert "Remove inputs that no node reads (/r2b/first); 'r2bspec interfaces SPEC'" in late


FAILS = {
    "Raises": (
        {2},
        "/r2b/relay cannot be created: ValueError: the calibration file is missing",
        # The log has what a developer of the node needs.
        'raise ValueError("the calibration file is missing")',
    ),
    "Hangs": ({4}, "process relay did not respond within 1 s", ""),
}
ALSO_FAILS = {
    "Dies": ({4}, "process relay exited with status 7", "no licence"),
    "nothing": ({2, 4}, "nothing gives a NoneType, not an rclpy node", ""),
}


@pytest.mark.parametrize("kind", [*FAILS, *nightly_of(ALSO_FAILS)])
def test_a_node_that_does_not_come_up_ends_the_run(bench: Bench, kind: str) -> None:
    statuses, words, log = (FAILS | ALSO_FAILS)[kind]
    done = bench.run(graph("1 s" if kind == "Hangs" else "60 s", relay=node(kind)))
    assert done.status in statuses
    record = done.run().record
    assert record.status == "incomplete"
    code, _, reason = record.reason.partition("\n")[0].partition(": ")
    reason = reason.removesuffix("; its last output:")
    assert f"error[{code_with_slug(code)}]: {reason}" in done.error
    assert words in done.error
    assert log in done.log("relay")


# Before anything starts

Refused = Callable[[dict[str, Any], Path], str]


@pytest.fixture
def refused(bench: Bench, call: Call) -> Refused:
    """The words of a refusal to run a spec."""
    return lambda spec, output: (
        call("run", bench.write(spec, "refused"), "--output", output, status=2).err
    )


@pytest.mark.parametrize(
    ("loader", "words"),
    [
        (
            {"bag": "./bag", "topics": {"/camrea": "loaded"}},
            ("r2b.yaml:6:", "/camrea", "/camera"),
        ),
        ({"bag": "./gab", "topics": {"/camera": "loaded"}}, ("r2b.yaml:4:", "./gab")),
    ],
    ids=["topic", "bag"],
)
def test_a_recording_without_what_is_loaded(
    bench: Bench, refused: Refused, loader: dict[str, Any], words: tuple[str, ...]
) -> None:
    output = bench.folder / "not made"
    said = refused(relay_spec(data_loader=loader), output)
    for word in words:
        assert word in said
    assert not output.exists()


def test_an_output_folder_that_cannot_be_made(bench: Bench, refused: Refused) -> None:
    (bench.folder / "a_file").write_text("")
    said = refused(relay_spec(), bench.folder / "a_file" / "run")
    assert "a_file/run cannot be created" in said


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        (
            {"package": "no_such_package", "executable": "node"},
            "'no_such_package' is not installed",
        ),
        ({"command": ["no-such-program"]}, "program 'no-such-program' is not on PATH"),
        ({"command": ["./spec.txt"]}, "./spec.txt: No such file"),
        ({"python": "no_such_module.Node"}, "no_such_module"),
        ({"python": "./broken.py:Broken"}, "a_module_that_is_not_there"),
        ({"python": "./nothing.py:Node"}, "nothing.py"),
    ],
    ids=["package", "program", "path", "module", "import", "file"],
)
def test_what_is_not_installed_is_named(
    tmp_path: Path, refused: Refused, missing: dict[str, Any], words: str
) -> None:
    if "python" not in missing:
        missing = missing | {"publishes": {"output": IMAGE}}
    other = relay_node(remappings={"output": "elsewhere"})
    assert words in refused(graph(relay=missing, other=other), tmp_path / "run")
    if "package" in missing or missing.get("command") == ["no-such-program"]:
        # It is missed before any other is started.
        assert open_run(tmp_path / "run").record.processes == ()
