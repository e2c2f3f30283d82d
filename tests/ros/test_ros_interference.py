"""What stands around the graph: setup, probes, later steps, containers, and nodes of others."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest

from nightly import only_nightly
from r2bspec.execute.processes.prerequisites import reserved_domain
from r2bspec.report.findings_text import code_with_slug

pytest.importorskip("rclpy")

from ros_runs import IMAGE, Bench, Finished, node_of_others, relay_node, relay_spec, write_bag

NODES = """
class Notebook(Node):
    def __init__(self, **kwargs):
        super().__init__("notebook", **kwargs)
        self.out = self.create_publisher(Image, "noted", 10)
        # As many as an iteration has: a machine that stands still loses none of them.
        self.create_subscription(Image, "left", self.note, 200)
        self.create_subscription(Image, "right", lambda message: None, 200)
        self.file = open("notes", "a", buffering=1)

    def note(self, message):
        self.file.write(f"{message.data[0]}\\n")
        self.out.publish(message)


def hungry(**kwargs):
    node = Node("hungry", **kwargs)
    out = node.create_publisher(Image, "output", 10)
    eaten = []

    def eat(message):
        eaten.append(b"x" * (32 << 20))
        out.publish(message)

    node.create_subscription(Image, "input", eat, 10)
    return node
"""

MAKES = "import sys; open(sys.argv[1], 'a').write('made ')"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    made = Bench(tmp_path_factory.mktemp("interference"))
    made.write_node("nodes.py", NODES)
    # The second bag begins 40 ms later; its stamps are those of the first from there on.
    (made.folder / "kept").touch()
    write_bag(made.folder / "left", {"/left": [0, 33, 66, 99, 125]})
    write_bag(made.folder / "right", {"/right": [33, 66, 99, 125]})
    return made


@pytest.fixture(scope="module")
def everything(bench: Bench) -> Finished:
    spec = relay_spec(
        setup={
            "model": {"command": [sys.executable, "-c", MAKES, "model"], "creates": "model"},
            "note": {"command": ["echo", "noted"]},
            "kept": {"command": ["false"], "creates": "kept"},
        },
        data_loader={
            "bags": ["./left", "./right"],
            "window": {"start": "0.01 s", "end": "0.13 s"},
            "topics": {"/left": "kept/left", "/right": "kept/right"},
        },
        playback={
            "mode": "sweeping",
            "inputs": {
                "left": {"from": "kept/left", "format": IMAGE},
                "right": {"from": "kept/right", "format": IMAGE},
            },
        },
        containers={
            "box": {
                "executable": "python",
                "executor": "multi_threaded",
                "threads": 2,
                "cpus": [min(os.sched_getaffinity(0))],
                "nice": 1,
                "memory_limit": "4 GiB",
            }
        },
        graph={"nodes": {"notebook": {"python": "./nodes.py:Notebook", "container": "box"}}},
        ready={
            "file": {"file": "model"},
            "topic": {"topic": "left"},
            "service": {"service": "notebook/get_parameters"},
        },
        after_ready={
            "command": {"command": ["echo", "stands"]},
            "call": {
                "service": {
                    "name": "notebook/set_parameters",
                    "type": "rcl_interfaces/srv/SetParameters",
                    "request": {
                        "parameters": [
                            {"name": "use_sim_time", "value": {"type": 1, "bool_value": False}}
                        ]
                    },
                }
            },
        },
        monitors={"noted": {"topic": "noted", "format": IMAGE}},
    )
    # Of a short iteration, one late message at its end is much of the rate.
    spec["benchmark"]["duration"] = "3 s"
    return bench.run(spec)


def test_it_runs(everything: Finished) -> None:
    assert everything.status == 0, everything.stderr
    assert everything.monitor("noted")["missed"] == 0


def test_setup_steps_run_once_and_in_order(bench: Bench, everything: Finished) -> None:
    assert (bench.folder / "model").read_text() == "made "
    assert everything.log("setup.note") == "noted\n"
    names = [process.name for process in everything.run().record.processes]
    assert names[:2] == ["setup.model", "setup.note"]
    # What is there is not made again.
    assert "kept: kept already exists" in everything.events()


def test_later_steps_were_done(everything: Finished) -> None:
    assert everything.log("after_ready.command") == "stands\n"
    ended = {process.name: process.exit_code for process in everything.run().record.processes}
    assert ended["after_ready.call"] == 0


def test_several_bags_are_one_recording_with_one_window(everything: Finished) -> None:
    # From 10 ms after the first message of both: the left one's first is out.
    (noted,) = [
        event for event in everything.events() if "kept/left" in event and "kept/right" in event
    ]
    assert noted == "/r2b/kept/left: 4 messages, /r2b/kept/right: 4 messages"


def test_sweeping_goes_back_and_forth(bench: Bench, everything: Finished) -> None:
    seen = [int(line) for line in (bench.folder / "notes").read_text().split()]
    once_around = [1, 2, 3, 4, 3, 2]
    # The first messages may be played before discovery has told the node of their writer.
    offsets = range(len(once_around))
    assert len(seen) > len(once_around)
    assert any(
        seen == [once_around[(offset + index) % len(once_around)] for index in range(len(seen))]
        for offset in offsets
    )


SERVICE = {"name": "nobody", "type": "rcl_interfaces/srv/GetParameters", "request": {}}


@pytest.mark.parametrize(
    ("changes", "code", "said"),
    [
        pytest.param(
            {"setup": {"bad": {"command": [sys.executable, "-c", "print('why'); exit(3)"]}}},
            "R2B648",
            ("setup.bad exited with status 3", "why"),
            id="a setup step fails",
            marks=only_nightly(),
        ),
        pytest.param(
            {"setup": {"idle": {"command": ["true"], "creates": "never"}}},
            "R2B648",
            ("setup step idle succeeded, but never does not exist",),
            id="a setup step does not create what it says",
            marks=only_nightly(),
        ),
        pytest.param(
            {"setup": {"slow": {"command": ["sleep", "600"], "timeout": "200 ms"}}},
            "R2B648",
            ("setup.slow did not exit within 0.2 s",),
            id="a setup step takes too long",
            marks=only_nightly(),
        ),
        pytest.param(
            {"ready": {"never": {"file": "nowhere", "timeout": "200 ms"}}},
            "R2B646",
            ("ready.never: file nowhere does not exist after 0.2 s",),
            id="a probe is never satisfied",
        ),
        pytest.param(
            {"after_ready": {"call": {"service": SERVICE, "timeout": "300 ms"}}},
            "R2B647",
            ("service /r2b/nobody does not exist",),
            id="a service is not there",
            marks=only_nightly(),
        ),
        pytest.param(
            {"graph": {"nodes": {"relay": relay_node(cpus=[4095])}}},
            "R2B636",
            ("process relay cannot run on CPUs 4095",),
            id="a processor is not there",
            marks=only_nightly(),
        ),
        pytest.param(
            {
                "graph": {
                    "nodes": {"eater": {"python": "./nodes.py:hungry", "memory_limit": "400 MiB"}}
                }
            },
            "R2B635",
            ("process eater uses", "its limit is 400 MiB"),
            id="a node takes more memory than it may",
        ),
    ],
)
def test_what_goes_wrong_is_named(
    bench: Bench, changes: dict[str, object], code: str, said: tuple[str, ...]
) -> None:
    done = bench.run(relay_spec(**changes))
    assert done.error.startswith(f"error[{code_with_slug(code)}]"), done.stderr
    assert all(each in done.error for each in said), done.error
    assert done.status == 4


def test_a_node_of_others_takes_part(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "relay.py"
    program.write_text(
        "import rclpy\n"
        "from r2bspec.nodes import RelayNode\n"
        "rclpy.init()\n"
        f"rules = ['--ros-args', '-r', '__node:=theirs', '-p', 'format:={IMAGE}']\n"
        "node = RelayNode(namespace='/r2b', cli_args=rules, use_global_arguments=False)\n"
        "print('stands', flush=True)\n"
        "rclpy.spin(node)\n"
    )
    endpoints = {"subscribes": {"input": IMAGE}, "publishes": {"output": IMAGE}}
    spec = relay_spec(
        transport="inherit", graph={"nodes": {"theirs": {"external": True} | endpoints}}
    )
    with reserved_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        with node_of_others([sys.executable, program]) as theirs:
            assert theirs.stdout is not None
            assert theirs.stdout.readline() == b"stands\n"
            done = bench.run(spec)
            done.assert_complete()
            assert theirs.poll() is None, "the run ended a node that is not its own"


@only_nightly()
def test_an_external_node_that_is_not_there_is_missed(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", "127.0.0.1:11811")
    spec = relay_spec(
        graph={
            "nodes": {
                "relay": relay_node(),
                "absent": {"external": True, "subscribes": {"input": IMAGE}},
            }
        },
        benchmark={"duration": "1 s", "iterations": 1, "rates": ["20 Hz"], "start_timeout": "3 s"},
    )
    finished = bench.run(spec)
    assert finished.status == 4
    assert re.search(r"yaml:\d+:\d+: error\[R2B649[^\n]+absent", finished.stderr)
    assert "ROS_DISCOVERY_SERVER is not passed on to the run" in finished.stderr
