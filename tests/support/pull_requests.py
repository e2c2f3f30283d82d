"""A repository in colcon's layout with a benchmark, and pull requests that change it.

The node takes a fixed time for each message by sleeping, so that how much slower a change makes it
is known, whatever else the machine does.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from git_repositories import commit, git, write_files
from ros_runs import IMAGE, quick_input, write_bag

PACKAGE = "src/blur/blur"
SPEC = "bench/blur.r2b.yaml"
PARAMETERS = "src/blur/config/blur.yaml"
_RECIPE = Path(__file__).parents[2] / "ci" / "shell" / "gate.sh"

_NODE = """\
import rclpy
from kernels import smooth
from rclpy.node import Node
from sensor_msgs.msg import Image

from blur.cost import seconds


class Blur(Node):
    def __init__(self):
        super().__init__("blur")
        self.cost_s = seconds(self.declare_parameter("cost_ms", 20.0).value)
        self.publisher = self.create_publisher(Image, "blurred", 100)
        self.create_subscription(Image, "image", self.on_image, 100)

    def on_image(self, image):
        smooth(self.cost_s)
        self.publisher.publish(image)


def main():
    rclpy.init()
    rclpy.spin(Blur())


if __name__ == "__main__":
    main()
"""
_COST = '''\
"""How long a message takes."""

FACTOR = 1.0


def seconds(cost_ms):
    return FACTOR * cost_ms / 1e3
'''
_KERNELS = """\
import time


def smooth(cost_s):
    time.sleep(cost_s)
"""


def spec(**changes: object) -> str:
    """The spec of the benchmark; `changes` replace whole sections."""
    sections: dict[str, object] = {
        "r2bspec": 1,
        "name": "blur",
        "data_loader": {"bag": "./drive", "topics": {"/camera": "loaded"}},
        "playback": {"buffer": 5, "inputs": {"image": quick_input("loaded")}},
        "graph": {
            "nodes": {
                "blur": {
                    "python": "../src/blur/blur/node.py:Blur",
                    "parameters": "../src/blur/config/blur.yaml",
                }
            }
        },
        "monitors": {"blurred": {"topic": "blurred", "format": IMAGE}},
        "benchmark": {
            "duration": "1 s",
            "iterations": 3,
            "rates": ["20 Hz"],
            "warm_up": "100 ms",
            "start_timeout": "60 s",
        },
        "slos": {
            "arrives": {"at": "20 Hz", "require": ["received > 0"]},
            "fast": {"at": "20 Hz", "require": ["latency.p50 <= 107 % of baseline"]},
        },
    }
    return yaml.safe_dump(sections | changes, sort_keys=False)


@dataclass
class Workspace:
    """A repository whose branch ``main`` is the base, and what is checked out the pull request.

    Attributes:
        top: of the work tree.
        site: where the packages are installed that the node depends on.
    """

    top: Path
    site: Path
    runs: int = field(default=0)

    @classmethod
    def create(cls, folder: Path) -> Workspace:
        """A repository with one commit, on the branch ``change``; ``main`` stays at it."""
        top = folder / "workspace"
        workspace = cls(top, folder / "site")
        workspace.install_dependency("1.0")
        bag = top / "bench/drive"
        bag.parent.mkdir(parents=True)
        write_bag(bag, {"/camera": [50 * number for number in range(20)]})
        files = {
            f"{PACKAGE}/__init__.py": "",
            f"{PACKAGE}/node.py": _NODE,
            f"{PACKAGE}/cost.py": _COST,
            "src/blur/package.xml": "<package><name>blur</name><version>1.0.0</version></package>",
            PARAMETERS: "/**:\n  ros__parameters:\n    cost_ms: 20.0\n",
            SPEC: spec(),
            ".gitignore": "runs/\n",
        }
        commit(top, files)
        git(top, "checkout", "--quiet", "-b", "change")
        return workspace

    def install_dependency(self, version: str, factor: float = 1.0) -> None:
        """Install a version of the package that the node imports."""
        shutil.rmtree(self.site, ignore_errors=True)
        write_files(
            self.site,
            {
                "kernels.py": _KERNELS.replace("cost_s)\n", f"{factor} * cost_s)\n")
                if factor != 1.0
                else _KERNELS,
                f"kernels-{version}.dist-info/METADATA": f"Name: kernels\nVersion: {version}\n",
                f"kernels-{version}.dist-info/RECORD": "kernels.py,,\n",
                f"kernels-{version}.dist-info/top_level.txt": "kernels\n",
            },
        )

    def change(self, files: Mapping[str, str] | None = None, *, on_main: bool = False) -> None:
        """Commit files on the pull request, or on its base, too."""
        commit(self.top, files)
        if on_main:
            git(self.top, "branch", "--force", "main", "HEAD")

    def set_cost(self, cost_ms: float, *, on_main: bool = False) -> None:
        """Let each message take so long."""
        source = _COST.replace("FACTOR = 1.0", f"FACTOR = {cost_ms / 20.0!r}")
        self.change({f"{PACKAGE}/cost.py": source}, on_main=on_main)

    def environment(self) -> dict[str, str]:
        """The environment of a pipeline: the package of the work tree and its dependency."""
        path = (str(self.top / "src/blur"), str(self.site))
        return {**os.environ, "PYTHONPATH": os.pathsep.join(path)}

    def gate(self, *arguments: str, against: str = "main") -> Gated:
        """Run the gate as a pipeline does: by the shell recipe, with further arguments of `run`."""
        self.runs += 1
        output = self.top.parent / f"gated-{self.runs}"
        specs = [argument for argument in arguments if _is_spec(argument)]
        options = [argument for argument in arguments if not _is_spec(argument)]
        variables = {
            "R2BSPEC_PYTHON": sys.executable,
            "R2BSPEC_OUTPUT": str(output),
            "R2BSPEC_ARGUMENTS": "\n".join(["--no-lock", *options]),
        }
        done = subprocess.run(
            ["sh", str(_RECIPE), *(specs or [SPEC]), against or "none"],  # noqa: S607
            cwd=self.top,
            env=self.environment() | variables,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=250,
            check=False,
        )
        return Gated(done.returncode, done.stdout, done.stderr, output / "run")


@dataclass(frozen=True)
class Gated:
    """What a gate said."""

    status: int
    stdout: str
    stderr: str
    folder: Path

    @property
    def said(self) -> str:
        """Everything that it printed."""
        return f"{self.stdout}\n{self.stderr}"

    def assert_status(self, *statuses: int) -> None:
        """See that it ended with one of these; what it said otherwise."""
        assert self.status in statuses, self.said


def _is_spec(argument: str) -> bool:
    return argument.startswith("bench") or argument.endswith(".yaml")


def without_sections(*names: str, changes: Sequence[tuple[str, str]] = ()) -> str:
    """The spec without some sections, and with some texts replaced."""
    sections = yaml.safe_load(spec())
    text = yaml.safe_dump({key: sections[key] for key in sections if key not in names})
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    return text
