"""A repository in colcon's layout with a benchmark, and pull requests that change it.

The node takes a fixed time for each message by sleeping, so that how much slower a change makes it
is known, whatever else the machine does. Each goes through the gate as a pipeline does it: by the
steps of the GitHub action, or by the shell script.
"""

from __future__ import annotations

import html
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import yaml

from git_repositories import clone, commit, git, write_files
from nightly import size
from pipelines import Workplace
from recipe_hosts import GATE, MERGED, publish_merge
from ros_runs import IMAGE, quick_input, write_bag

Recipe = Literal["action", "shell"]
"""How a pull request comes to the gate."""

PACKAGE = "src/blur/blur"
SPEC = "bench/blur.r2b.yaml"
PARAMETERS = "src/blur/config/blur.yaml"
_OUTCOMES = {0: "pass", 1: "fail", 2: "error", 3: "inconclusive", 4: "invalid"}

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
            "iterations": size(1, 3),
            "rates": ["20 Hz"],
            "warm_up": "100 ms",
            "start_timeout": "60 s",
            # A second failure is played for the pairs of others (tests/ros/test_ros_pairs.py).
            "gate": {"confirm": False},
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
        recipe: by which the pull request is gated.
    """

    top: Path
    site: Path
    recipe: Recipe = "shell"
    runs: int = field(default=0)

    @classmethod
    def create(cls, folder: Path, recipe: Recipe = "shell") -> Workspace:
        """A repository with one commit, on the branch ``change``; ``main`` stays at it."""
        top = folder / "workspace"
        workspace = cls(top, folder / "site", recipe)
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

    def set_cost(self, cost_ms: float) -> None:
        """Let each message take so long."""
        source = _COST.replace("FACTOR = 1.0", f"FACTOR = {cost_ms / 20.0!r}")
        self.change({f"{PACKAGE}/cost.py": source})

    @property
    def head(self) -> Path:
        """The work tree that is gated."""
        return self.top if self.recipe == "shell" else self._runner / "checkout"

    @property
    def _runner(self) -> Path:
        return self.top.parent / "runner"

    def shallow_clone(self) -> Workspace:
        """Return a clone without any base; what the action checks out is one always."""
        if self.recipe == "action":
            return self
        folder = clone(self.top, self.top.parent / "clone", "change", "--depth=1")
        return Workspace(folder, self.site)

    def environment(self) -> dict[str, str]:
        """The environment of a pipeline: the package of the work tree and its dependency."""
        return {**os.environ, "PYTHONPATH": f"{self.head / 'src/blur'}{os.pathsep}{self.site}"}

    def gate(self, *arguments: str, spec: str = SPEC, base: str = "main", allow: str = "") -> Gated:
        """Send what is checked out through the gate, with further arguments of ``r2bspec gate``."""
        self.runs += 1
        output = self.top.parent / f"gated-{self.runs}"
        gate = self._by_shell if self.recipe == "shell" else self._by_action
        return gate(("--no-lock", *arguments), spec, base, allow, output)

    def _by_shell(
        self, arguments: Sequence[str], spec: str, base: str, allow: str, output: Path
    ) -> Gated:
        variables = {
            "R2BSPEC_PYTHON": sys.executable,
            "R2BSPEC_OUTPUT": str(output),
            "R2BSPEC_ALLOW": allow,
            "R2BSPEC_ARGUMENTS": "\n".join(arguments),
        }
        done = subprocess.run(
            ["sh", str(GATE), spec, base],  # noqa: S607
            cwd=self.top,
            env=self.environment() | variables,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=250,
            check=False,
        )
        summary = output / "reports" / "summary.md"
        assert summary.is_file(), done.stdout
        return Gated(done.returncode, done.stdout, _shown(summary.read_text()), output / "run")

    def _by_action(
        self, arguments: Sequence[str], spec: str, base: str, allow: str, output: Path
    ) -> Gated:
        """Run the action on the merge that the service makes, with what is not committed."""
        # The base is an ancestor, so the merge has the files of the head.
        head, main = (git(self.top, "rev-parse", name) for name in ("HEAD", "main"))
        words = ("commit-tree", "-p", main, "-p", head, "-m", "merge", "HEAD^{tree}")
        publish_merge(self.top, git(self.top, *words))
        shutil.rmtree(self._runner, ignore_errors=True)
        self._runner.mkdir()
        clone(self.top, self.head, MERGED, "--depth=1")
        if changes := git(self.top, "diff", "HEAD"):
            git(self.head, "apply", stdin=f"{changes}\n")
        done = Workplace(self.head, self._runner).action(
            sys.executable,
            spec,
            main,
            given_base="" if base == "main" else base,
            allow=allow,
            arguments="\n".join(arguments),
            PYTHONPATH=self.environment()["PYTHONPATH"],
        )
        status = int(done.outputs["status"])
        assert done.outputs["outcome"] == _OUTCOMES[status], done.printed
        assert (done.code != 0) is (status != 0), done.printed
        shutil.move(done.outputs["folder"], output)
        summary = output / "reports" / "summary.md"
        assert summary.is_file(), done.printed
        assert done.summary == summary.read_text()
        return Gated(status, done.printed, _shown(done.summary), output / "run")


@dataclass(frozen=True)
class Gated:
    """What a gate said.

    Attributes:
        status: the exit status of ``r2bspec gate``.
        said: everything that it printed.
        summary: what the pull request shows.
        folder: of the run.
    """

    status: int
    said: str
    summary: str
    folder: Path

    def assert_status(self, *statuses: int) -> None:
        """See that it ended with one of these; what it said otherwise."""
        assert self.status in statuses, self.said


def _shown(markdown: str) -> str:
    """Markdown without its escapes, as a reader sees it."""
    return html.unescape(re.sub(r"\\([\\`*_\[\]|~#$])", r"\1", markdown))


def without_sections(*names: str, changes: Sequence[tuple[str, str]] = ()) -> str:
    """The spec without some sections, and with some texts replaced."""
    sections = yaml.safe_load(spec())
    text = yaml.safe_dump({key: sections[key] for key in sections if key not in names})
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    return text
