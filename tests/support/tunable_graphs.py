"""Graphs that miss their objectives, or waste processor time, as they are deployed, and do not in
another deployment that is known because the graph was made for it.

What decides are sleeps, queues, copies and the number of processes, and not how fast the machine
is, so that the known deployment is the better one beside other programs, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from c_nodes import c_node_spec
from ros_runs import IMAGE, Bench, relay_node

_RATE_HZ = 10
"""So slow that what other programs take of the processors matters little."""

NODES = """
import time

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup


class TwoInputs(Node):
    def __init__(self, **kwargs):
        super().__init__("two_inputs", **kwargs)
        sleep_ms = self.declare_parameter("sleep_ms", 0.0).value
        publisher = self.create_publisher(Image, "output", 100)

        def slow(message):
            time.sleep(sleep_ms / 1e3)

        def slow_relay(message):
            slow(message)
            publisher.publish(message)

        for topic, callback in (("input", slow_relay), ("other", slow)):
            group = MutuallyExclusiveCallbackGroup()
            self.create_subscription(Image, topic, callback, 100, callback_group=group)
"""


class TunableGraph(NamedTuple):
    """A graph, and a deployment of it that keeps its objectives.

    Attributes:
        name: of the graph.
        spec: as it is deployed today.
        known: assignments, each ``path=value``, of the better deployment; none if today's is it.
        today_meets: whether today's deployment keeps the objectives, too, so that it is the cost
            that another one improves.
        image_size: width and height of the recorded images.
    """

    name: str
    spec: dict[str, Any]
    known: tuple[str, ...]
    today_meets: bool = False
    image_size: tuple[int, int] = (640, 480)


def write_graph(graph: TunableGraph, folder: Path) -> Path:
    """The spec of a graph in a folder, with its recording and its Python file."""
    bench = Bench(folder, size=graph.image_size)
    bench.write_node("nodes.py", NODES)
    return bench.write(graph.spec)


def tunable_graphs() -> Iterator[TunableGraph]:
    """Twenty of them: ten kinds, two of each."""
    for size in (2, 3):
        yield _chain(size)
        yield _fork(size)
        yield _light_chain(size)
        yield _today_best(size)
        yield _transport(size - 1)
    for sleep_ms in (60.0, 75.0):
        yield _callbacks(sleep_ms)
        yield _queue(sleep_ms)
        yield _callbacks_in_container(sleep_ms)
        yield _mixed(sleep_ms)
        yield _work(2 * sleep_ms)


def _chain(size: int) -> TunableGraph:
    """Relays that sleep, one after the other in one thread, longer than a period."""
    nodes = _relays(size, 150.0 / size)
    return TunableGraph(
        f"chain of {size}", _spec(nodes, placement="shared"), ("graph.placement=separate",)
    )


def _fork(size: int) -> TunableGraph:
    """The same, beside each other."""
    nodes = {
        f"n{number}": _sleeper(150.0 / size, {"input": "image", "output": f"out{number}"})
        for number in range(size)
    }
    spec = _spec(nodes, placement="shared", output=f"out{size - 1}")
    return TunableGraph(f"fork of {size}", spec, ("graph.placement=separate",))


def _light_chain(size: int) -> TunableGraph:
    """Nodes that do nothing, each with a process, a middleware and a copy of its own."""
    nodes = _relays(size, 0.0)
    return TunableGraph(
        f"light chain of {size}", _spec(nodes), ("graph.placement=shared",), today_meets=True
    )


def _today_best(size: int) -> TunableGraph:
    """Sleeping nodes that have threads of their own already."""
    return TunableGraph(
        f"chain of {size}, well deployed", _spec(_relays(size, 60.0)), (), today_meets=True
    )


def _transport(size: int) -> TunableGraph:
    """Relays in C whose images go through the network stack."""
    nodes = {
        name: c_node_spec("relay", remappings=dict(relay["remappings"]))
        for name, relay in _relays(size, 0.0).items()
    }
    spec = _spec(nodes, transport="udp", values={"graph.nodes.n0.nice": [5]})
    return TunableGraph(
        f"C over UDP, {size}",
        spec,
        ("transport=shared_memory",),
        today_meets=True,
        image_size=(1920, 1080),
    )


def _callbacks(sleep_ms: float) -> TunableGraph:
    """Two callbacks of a node that sleep, in one thread."""
    nodes = {"two": _two_inputs(sleep_ms, "image", "out")}
    known = ("graph.nodes.two.executor=multi_threaded", "graph.nodes.two.threads=2")
    return TunableGraph(f"two callbacks, {sleep_ms:g} ms", _spec(nodes, output="out"), known)


def _queue(sleep_ms: float) -> TunableGraph:
    """A queue of one message before a service time that varies."""
    relay = _sleeper(sleep_ms - 10.0, {"input": "image", "output": "out"})
    relay["parameters"] |= {"jitter": "exponential", "queue_depth": 1, "seed": int(sleep_ms)}
    path = "graph.nodes.relay.parameters.queue_depth"
    spec = _spec({"relay": relay}, output="out", values={path: [5, 50]})
    spec["slos"]["all"]["require"] = ["drop_rate <= 10 %"]
    return TunableGraph(f"queue, {sleep_ms:g} ms", spec, (f"{path}=50",))


def _callbacks_in_container(sleep_ms: float) -> TunableGraph:
    """Two such nodes in one container: neither threads of two nor other processes are enough."""
    nodes = {
        "first": _two_inputs(sleep_ms, "image", "middle") | {"container": "stack"},
        "second": _two_inputs(sleep_ms, "middle", "out") | {"container": "stack"},
    }
    spec = _spec(nodes, output="out")
    spec["containers"] = {"stack": {"executable": "python"}}
    known = ("containers.stack.executor=multi_threaded", "containers.stack.threads=4")
    return TunableGraph(f"two callbacks of two nodes, {sleep_ms:g} ms", spec, known)


def _mixed(sleep_ms: float) -> TunableGraph:
    """A relay in C, then two in Python that sleep in one thread."""
    nodes = _relays(3, sleep_ms)
    nodes["n0"] = c_node_spec("relay", remappings=dict(nodes["n0"]["remappings"]))
    spec = _spec(nodes, placement="shared")
    return TunableGraph(f"C and Python, {sleep_ms:g} ms", spec, ("graph.placement=separate",))


def _work(work_ms: float) -> TunableGraph:
    """A parameter that decides how long a node works, beside levers that change nothing of it."""
    relay = relay_node(work_ms, remappings={"input": "image", "output": "out"})
    path = "graph.nodes.relay.parameters.service_time_ms"
    spec = _spec({"relay": relay}, output="out", values={path: [work_ms / 2, 1.0]})
    return TunableGraph(f"work, {work_ms:g} ms", spec, (f"{path}=1.0",))


def _relays(size: int, sleep_ms: float) -> dict[str, dict[str, Any]]:
    topics = ["image", *(f"out{number}" for number in range(size))]
    return {
        f"n{number}": _sleeper(sleep_ms, {"input": topics[number], "output": topics[number + 1]})
        for number in range(size)
    }


def _sleeper(sleep_ms: float, remappings: Mapping[str, str]) -> dict[str, Any]:
    node = relay_node(sleep_ms, remappings=dict(remappings))
    node["parameters"]["spin"] = False
    return node


def _two_inputs(sleep_ms: float, topic: str, output: str) -> dict[str, Any]:
    return {
        "python": "./nodes.py:TwoInputs",
        "parameters": {"sleep_ms": sleep_ms},
        "remappings": {"input": topic, "other": topic, "output": output},
    }


def _spec(
    nodes: Mapping[str, Any],
    *,
    output: str = "",
    placement: str = "separate",
    transport: str = "shared_memory",
    values: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    topic = output or f"out{len(nodes) - 1}"
    return {
        "r2bspec": 1,
        "name": "tunable",
        "data_loader": {"bag": "./bag", "topics": {"/camera": "loaded"}},
        "playback": {"buffer": 5, "inputs": {"image": {"from": "loaded", "format": IMAGE}}},
        "transport": transport,
        "graph": {"placement": placement, "nodes": dict(nodes)},
        "monitors": {"out": {"topic": topic, "format": IMAGE}},
        "benchmark": {
            "duration": "3 s",
            "iterations": 4,
            "starts": 2,
            "rates": [f"{_RATE_HZ} Hz"],
            "start_timeout": "60 s",
            "gate": {"interference": "tolerate"},
        },
        "slos": {
            "all": {
                "at": f"{_RATE_HZ} Hz",
                "require": ["drop_rate <= 10 %", "latency.p50 < 450 ms"],
            }
        },
        "tune": {"values": dict(values or {}), "limits": {"threads": 4}},
    }
