"""Which processes a plan has, and the command line of each.

Harness processes and hosts of Python nodes all run ``$(python) -P -m r2bspec.harness.child`` (-P:
what lies in the spec's folder shadows no module); what they do is told to them over the control
channel. An executable is started as ``ros2 run`` would, with its node name, namespace, remappings
and parameters as ROS arguments. A `command` is started exactly as written, unless the spec gives it
a namespace, parameters, remappings, `publishes` or `subscribes`: then it is taken to be a ROS
process and gets ROS arguments, too, but no node name, because it may hold several nodes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator

from r2bspec.plan.model import NodePlan, ProcessPlan
from r2bspec.spec.model import ParameterValue, Spec
from r2bspec.wiring.model import NodeWiring, Phase, Wiring

HARNESS_ARGV = ("$(python)", "-P", "-m", "r2bspec.harness.child")

HARNESS_NAMES = ("loader", "player", "monitor")
"""Names of the harness's own processes."""

SHARED_NAME = "graph"
"""Name of the process that all Python nodes share under ``placement: shared``."""


def plan_processes(spec: Spec, wiring: Wiring) -> tuple[ProcessPlan, ...]:
    """All processes, each phase in the order writers, nodes, readers.

    A preprocessor's process is called ``preprocess.KEY``, which no node of the graph can be.
    """
    return (
        *_preprocess(wiring),
        _harness("player", "measure"),
        *_under_test(spec, wiring),
        _harness("monitor", "measure"),
    )


def reserved_names(spec: Spec) -> tuple[str, ...]:
    """The names among processes that no node of the graph can have.

    ``system`` is none, but stands for the whole machine in the names of metrics.
    """
    shared = (SHARED_NAME,) if spec.graph.placement == "shared" else ()
    return (*HARNESS_NAMES, *shared, "system")


def process_names(spec: Spec, wiring: Wiring) -> tuple[str, ...]:
    """The names of the processes that run while measuring."""
    return tuple(each.name for each in plan_processes(spec, wiring) if each.phase == "measure")


def _preprocess(wiring: Wiring) -> Iterator[ProcessPlan]:
    phase = wiring.preprocess
    if phase.nodes:
        yield _harness("loader", "preprocess")
    for node in phase.nodes:
        yield _process(node, f"preprocess.{node.key}", phase.phase)


def _under_test(spec: Spec, wiring: Wiring) -> Iterator[ProcessPlan]:
    phase = wiring.measure
    together: list[NodeWiring] = []
    for node in phase.nodes:
        if spec.graph.placement == "shared" and node.node.kind == "python":
            together.append(node)
        else:
            yield _process(node, node.key, phase.phase)
    if together:
        env: dict[str, str] = {}
        for node in together:
            env |= node.node.env
        yield ProcessPlan(
            name=SHARED_NAME,
            role="host",
            phase=phase.phase,
            argv=HARNESS_ARGV,
            env=env,
            nodes=tuple(_node(each) for each in together),
        )


def _harness(role: str, phase: Phase) -> ProcessPlan:
    assert role in {"loader", "player", "monitor"}  # noqa: S101 -- callers pass literals
    return ProcessPlan(
        name=role,
        role=role,  # type: ignore[arg-type]  # one of the three
        phase=phase,
        argv=HARNESS_ARGV,
        env={},
    )


def _process(node: NodeWiring, name: str, phase: Phase) -> ProcessPlan:
    return ProcessPlan(
        name=name,
        role="host" if node.node.kind == "python" else "command",
        phase=phase,
        argv=_argv(node),
        env=dict(node.node.env),
        nodes=(_node(node),),
    )


def _node(node: NodeWiring) -> NodePlan:
    return NodePlan(
        name=node.name,
        node=node.key,
        namespace=node.namespace,
        target=node.node.python,
        parameters=dict(node.node.parameters),
        remappings=dict(node.node.remappings),
    )


def _argv(wired: NodeWiring) -> tuple[str, ...]:
    node = wired.node
    if node.kind == "python":
        return HARNESS_ARGV
    if node.kind == "executable":
        called = (f"$(executable {node.package} {node.executable})", *node.arguments)
        return (*called, *_ros_arguments(wired, f"__node:={wired.key}"))
    called = (*node.command, *node.arguments)
    return (*called, *_ros_arguments(wired)) if wired.names_known else called


def _ros_arguments(wired: NodeWiring, *rules: str) -> tuple[str, ...]:
    remappings = (f"{left}:={right}" for left, right in wired.node.remappings.items())
    arguments = ["--ros-args"]
    for rule in (*rules, f"__ns:={wired.namespace}", *remappings):
        arguments += ["-r", rule]
    for name, value in wired.node.parameters.items():
        arguments += ["-p", f"{name}:={parameter_text(value)}"]
    return tuple(arguments)


def parameter_text(value: ParameterValue) -> str:
    """A parameter as rcl's command line reads it: YAML in flow style, with strings quoted.

    Quoting keeps ``"10"`` a string, which rcl would otherwise read as a number.
    """
    if isinstance(value, list):
        return f"[{', '.join(parameter_text(each) for each in value)}]"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    return json.dumps(value, ensure_ascii=False)
