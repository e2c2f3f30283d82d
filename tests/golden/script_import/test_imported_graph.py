"""An imported spec plans to the graph that the script makes when Python executes it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import executed_script
from r2bspec.api import compile_plan
from r2bspec.plan.wiring.name_resolution import expand

HERE = Path(__file__).parent / "scripts"
SCRIPTS = (
    "live_camera",
    "mistaken_stereo",
    "recorded_timeline",
    "stereo_rectifier",
    "tracked_cups",
)
"""Those whose launch needs no file of another machine, and includes no other launch file."""
HARNESS = ("DataLoaderNode", "PlaybackNode", "MonitorNode")
ENVIRON = {"CELL_CAMERA": "/dev/video0"}


def executed(script: Path) -> list[dict[str, Any]]:
    """The nodes that the script makes, without those of the tool."""
    done = subprocess.run(
        [sys.executable, executed_script.__file__, script.name],
        cwd=script.parent,
        check=True,
        capture_output=True,
        text=True,
        env=ENVIRON,
    )
    made: list[dict[str, Any]] = json.loads(done.stdout)
    return [each for each in made if not each["kind"].endswith(HARNESS)]


def planned(spec: Path) -> dict[str, dict[str, Any]]:
    """The nodes of the plan by their full names, with the processes that they are in."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CELL_CAMERA", ENVIRON["CELL_CAMERA"])
        plan = compile_plan(spec)
    return {
        node.name: {
            "kind": node.plugin or process.argv[0],
            "argv": process.argv,
            "package": node.package,
            "container": process.name if process.role == "container" else "",
            "phase": process.phase,
            "parameters": dict(node.parameters),
            "remappings": node.remappings,
        }
        for process in plan.processes
        for node in process.nodes
    }


def resolved(remappings: Mapping[str, str], node: str) -> dict[str, str]:
    """Remappings between full names."""
    namespace, _, name = node.rpartition("/")
    full = {
        expand(old, name, namespace): expand(new, name, namespace)
        for old, new in remappings.items()
    }
    return {old: new for old, new in full.items() if old != new}


@pytest.mark.parametrize("name", SCRIPTS)
def test_the_plan_has_the_nodes_of_the_script(name: str) -> None:
    made, plan = executed(HERE / f"{name}.py"), planned(HERE / f"{name}.r2b.yaml")
    assert made
    taken: set[str] = set()
    for node in made:
        if "command" in node:
            taken |= {each for each in plan if starts_with(plan[each]["argv"], node["command"])}
            continue
        same = node["name"] in plan and node["name"] not in taken
        # A second node of one name, which ROS allows and a spec does not, gets another one.
        found = node["name"] if same else second(node, plan, taken)
        taken.add(found)
        mine = plan[found]
        assert node["kind"] in mine["kind"]
        assert node["package"] in (mine["package"] or mine["kind"])
        assert mine["parameters"] == node["parameters"]
        assert resolved(mine["remappings"], found) == resolved(node["remappings"], found)
        if mine["phase"] == "measure":
            assert mine["container"] == node["container"]
    assert taken == plan.keys()


def second(node: dict[str, Any], plan: dict[str, dict[str, Any]], taken: set[str]) -> str:
    (found,) = (
        name for name, each in plan.items() if name not in taken and each["kind"] == node["kind"]
    )
    return found


def starts_with(argv: tuple[str, ...], command: list[str]) -> bool:
    return list(argv[: len(command)]) == command
