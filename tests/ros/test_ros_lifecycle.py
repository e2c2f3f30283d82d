"""Lifecycle nodes: configured and activated by the run, by a manager, by nobody.

States are changed by services, which are the same in C++. No C++ node is built here: that of the
demos of ROS runs where it is installed.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from r2bspec.errors import R2bspecError
from r2bspec.execute.processes.prerequisites import find_executable
from ros_runs import IMAGE, STRING, Bench, relay_spec
from ros_runs import bench as bench

# The first has no topics and no gain before it is configured, the second publishes when active.
NODES = """
import os

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn


class Late(LifecycleNode):
    def __init__(self, **kwargs):
        super().__init__("late", **kwargs)
        self.fails = self.declare_parameter("fails", "").value

    def on_configure(self, state):
        if self.fails == "raises":
            raise ValueError("there is no model")
        if self.fails == "refuses":
            self.get_logger().error("there is no camera")
            return TransitionCallbackReturn.FAILURE
        if self.fails == "dies":
            os._exit(3)
        self.declare_parameter("gain", 1.0)
        self.output = self.create_lifecycle_publisher(Image, "between", 10)
        self.input = self.create_subscription(Image, "input", self.output.publish, 10)
        return super().on_configure(state)


class Early(LifecycleNode):
    def __init__(self, **kwargs):
        super().__init__("early", **kwargs)
        self.output = self.create_lifecycle_publisher(Image, "output", 10)
        self.input = self.create_subscription(Image, "between", self.output.publish, 10)


class Manager(Node):
    # As a lifecycle manager does: all nodes are configured, then activated.

    def __init__(self, **kwargs):
        super().__init__("manager", **kwargs)
        names = ("late", "early")
        self.clients_of = {n: self.create_client(ChangeState, f"{n}/change_state") for n in names}
        self.todo = [(step, name) for step in (1, 3) for name in names]
        self.create_timer(0.05, self.next)

    def next(self):
        if self.todo and self.clients_of[self.todo[0][1]].service_is_ready():
            step, name = self.todo.pop(0)
            request = ChangeState.Request()
            request.transition.id = step
            self.clients_of[name].call_async(request)
"""


@pytest.fixture
def chain(bench: Bench) -> Any:
    """Runs both nodes in a row; `more` are further keys of each."""
    bench.write_node("nodes.py", NODES)

    def run(*arguments: str, others: Any = (), late: Any = (), **more: Any) -> Any:
        topics = {"late": ("input", "between"), "early": ("between", "output")}
        nodes = {
            name: {
                "python": f"./nodes.py:{name.capitalize()}",
                "subscribes": {before: IMAGE},
                "publishes": {after: IMAGE},
            }
            | more
            for name, (before, after) in topics.items()
        }
        nodes["late"] |= dict(late)
        return bench.run(relay_spec(graph={"nodes": nodes | dict(others)}), *arguments)

    return run


def test_nodes_are_configured_then_activated_in_the_order_of_the_spec(chain: Any) -> None:
    done = chain(lifecycle="active", late={"parameters": {"gain": 2.0}})
    done.assert_counts(20)
    phases = [event for event in done.events() if event.startswith("phase ")]
    at = phases.index("phase configure")
    names = ("graph", "configure", "activate", "graph")
    assert phases[at - 1 : at + 3] == [f"phase {name}" for name in names]


@only_nightly()
def test_a_manager_in_the_graph_is_left_to_it(chain: Any) -> None:
    manager = {"python": "./nodes.py:Manager", "publishes": {"unused": IMAGE}}
    done = chain(others={"manager": manager}, late={"parameters": {"gain": 2.0}})
    done.assert_counts(20)
    assert "phase configure" not in done.events()


@pytest.mark.parametrize(
    ("fails", "output"),
    [
        pytest.param("raises", "there is no model", marks=only_nightly()),
        ("refuses", "there is no camera"),
    ],
)
def test_a_transition_that_fails_is_named_with_its_cause(
    chain: Any, fails: str, output: str
) -> None:
    done = chain(lifecycle="active", late={"parameters": {"fails": fails}})
    assert done.status == 2
    cause = "/r2b/late could not configure: on_configure did not succeed"
    assert f"R2B605 lifecycle-transition-failed]: {cause}" in done.error
    assert "lifecycle: active" in done.error
    assert output in done.error


@only_nightly()
def test_a_process_that_ends_meanwhile_is_named_and_nobody_waits_for_its_answer(chain: Any) -> None:
    done = chain(lifecycle="active", late={"parameters": {"fails": "dies"}})
    assert done.status == 4
    assert "/r2b/late could not configure: process late exited with status 3" in done.error
    (observer,) = (
        process for process in done.run().record.processes if process.name == "harness.observer"
    )
    assert (observer.exit_code, observer.signals) == (0, ())


def test_a_node_that_nothing_activates_is_said_and_not_waited_for(chain: Any) -> None:
    done = chain(late={"lifecycle": "active"})
    assert done.status == 2
    assert "R2B237" in done.error
    assert "/r2b/early is a lifecycle node and unconfigured: nothing has activated it" in (
        done.error
    )
    assert "write 'lifecycle: active'" in done.error


@only_nightly()
def test_a_node_without_states_is_named(bench: Bench) -> None:
    spec = relay_spec()
    spec["graph"]["nodes"]["relay"]["lifecycle"] = "active"
    spec["benchmark"]["start_timeout"] = "8s"
    done = bench.run(spec)
    assert done.status == 4
    assert "lifecycle node /r2b/relay did not appear within 8 s" in done.error
    assert "Remove 'lifecycle' if it has no states" in done.stderr


PROGRAM = """#!{python}
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import Image


class Late(LifecycleNode):
    def __init__(self):
        super().__init__("late")
        self.declare_parameter("fails", False)

    def on_configure(self, state):
        assert not self.get_parameter("fails").value
        self.output = self.create_lifecycle_publisher(Image, "output", 10)
        self.input = self.create_subscription(Image, "input", self.output.publish, 10)
        return super().on_configure(state)


rclpy.init()
try:
    rclpy.spin(Late())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""


@only_nightly()
@pytest.mark.parametrize("fails", [False, True])
def test_an_executable_is_brought_up_by_the_services_that_it_has(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, fails: bool
) -> None:
    program = tmp_path / "prefix/lib/mine/late"
    index = tmp_path / "prefix/share/ament_index/resource_index/packages"
    for folder in (program.parent, index):
        folder.mkdir(parents=True)
    (index / "mine").touch()
    program.write_text(PROGRAM.format(python=sys.executable))
    program.chmod(0o755)
    known = os.environ.get("AMENT_PREFIX_PATH", "")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'prefix'}:{known}")
    node = {
        "package": "mine",
        "executable": "late",
        "lifecycle": "active",
        "parameters": {"fails": fails},
        "publishes": {"output": IMAGE},
        "subscribes": {"input": IMAGE},
    }
    done = bench.run(relay_spec(graph={"nodes": {"relay": node}}))
    if fails:
        assert done.status == 2
        assert "/r2b/relay could not configure: on_configure did not succeed" in done.error
    else:
        done.assert_counts(20)


def has_lifecycle_talker() -> bool:
    try:
        find_executable("lifecycle", "lifecycle_talker")
    except R2bspecError:
        return False
    return True


@pytest.mark.skipif(
    not has_lifecycle_talker(), reason="needs the package 'lifecycle' of the demos, in C++"
)
def test_a_node_in_cpp_is_brought_up_in_the_same_way(bench: Bench) -> None:
    spec = relay_spec()
    spec["graph"]["nodes"]["talker"] = {
        "package": "lifecycle",
        "executable": "lifecycle_talker",
        "lifecycle": "active",
        "publishes": {"lifecycle_chatter": STRING},
    }
    done = bench.run(spec)
    done.assert_complete()
    assert done.events().count("phase activate") == 1
