"""Promise: every file and command of the tutorial works as it stands there."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy")

from git_repositories import clone, commit, git
from nightly import NIGHTLY, only_nightly
from page_blocks import page_blocks, page_file
from pipelines import Workplace
from recipe_hosts import MERGED, publish_merge

INCONCLUSIVE, INVALID = 3, 4
"""Verdicts of a machine that is busy at the moment."""

AT_LENGTH = ("--output slow", "--output runs/slower", "--output runs/neutral")
"""Commands that play again what the first run and the merge gate's tests show: nightly."""


@pytest.fixture(scope="module", name="place")
def followed_tutorial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which somebody has done all that the page says, from top to bottom."""
    place = tmp_path_factory.mktemp("tutorial")
    shell = Shell(place)
    for block in page_blocks("tutorial.md"):
        if block.kind == "run":
            for command in block.commands:
                if NIGHTLY or not command.endswith(AT_LENGTH):
                    shell.execute(command, block.argument)
        else:
            file = place / block.argument
            file.parent.mkdir(parents=True, exist_ok=True)
            with file.open("a" if block.kind == "append" else "x") as stream:
                stream.write(block.text)
    return place


class Shell:
    """A shell that stays in the folder to which a command has changed."""

    def __init__(self, folder: Path) -> None:
        self._folder = self._home = folder
        who = {"GIT_AUTHOR_NAME": "a", "GIT_AUTHOR_EMAIL": "a@example.org"}
        who |= {"GIT_COMMITTER_NAME": "a", "GIT_COMMITTER_EMAIL": "a@example.org"}
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        self._environment = os.environ | {"PATH": path} | who

    def execute(self, command: str, expectation: str) -> None:
        """Execute one line; its exit status has to be what the page says."""
        kept = self._home / "folder of the shell"
        done = subprocess.run(
            ["/bin/bash", "-c", f"{command}\nstatus=$?; pwd > '{kept}'; exit $status"],
            cwd=self._folder,
            env=self._environment,
            capture_output=True,
            text=True,
        )
        self._folder = Path(kept.read_text().strip())
        said = f"{command}\n{done.stdout}\n{done.stderr}"
        assert "Traceback" not in said, said
        judges = command.startswith(("r2bspec run", "r2bspec judge", "r2bspec gate"))
        if judges and expectation == "fails":
            assert done.returncode in {1, INCONCLUSIVE, INVALID}, said
        elif judges and expectation == "refused":
            assert done.returncode == 2, said
            assert "R2B692" in said
            assert "--allow 'objective no_slower'" in said
        elif judges:
            assert done.returncode in {0, INCONCLUSIVE, INVALID}, said
        else:
            assert done.returncode == 0, said


@pytest.mark.timeout(900)
def test_every_block_of_the_tutorial_works(place: Path) -> None:
    for name in ("drive", "first/result.json", "first.html", "robot"):
        assert (place / name).exists()
    if NIGHTLY:
        assert (place / "slow" / "result.json").exists()
        for name in ("slower", "neutral"):
            assert (place / "robot" / "runs" / name / "suite.json").exists()


@only_nightly()
@pytest.mark.timeout(600)
def test_the_workflow_of_the_tutorial_gates_a_pull_request(place: Path, tmp_path: Path) -> None:
    """The step of the action, with the spec of the workflow, on real ROS 2."""
    robot, upstream = place / "robot", place / "robot.git"
    node = robot / "src/stereo/stereo/stereo_brightness.py"
    line = "        stamp = nanoseconds(right)\n"
    slower = node.read_text().replace(line, f'        __import__("time").sleep(0.04)\n{line}')
    head = commit(robot, {str(node.relative_to(robot)): slower})
    git(robot, "push", "--quiet", "origin", f"{head}:refs/heads/slower")
    publish_merge(upstream, head)
    workflow = page_file("tutorial.md", "robot/.github/workflows/benchmark.yml")
    *_, step = yaml.safe_load(workflow)["jobs"]["stereo"]["steps"]
    job_place = Workplace(clone(upstream, tmp_path / "checkout", MERGED, "--depth=1"), tmp_path)
    job = job_place.action(sys.executable, step["with"]["spec"], git(upstream, "rev-parse", "main"))
    assert job.code in {1, INCONCLUSIVE, INVALID}, job.printed
    assert "no_slower" in job.printed
    assert "stereo_brightness.py changed" in job.printed
