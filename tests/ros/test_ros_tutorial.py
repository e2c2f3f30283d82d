"""Promise: every file and command of the tutorial works as it stands there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy")

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "tutorial.md").read_text()
BLOCK = re.compile(r"<!-- (file|run)(?:: ([^\n>]+))? -->\n```\w*\n(.*?)```", re.DOTALL)
INCONCLUSIVE, INVALID = 3, 4
"""Verdicts of a machine that is busy at the moment."""


@pytest.mark.timeout(900)
def test_every_block_of_the_tutorial_works(tmp_path: Path) -> None:
    blocks = BLOCK.findall(PAGE)
    assert len(blocks) == PAGE.count("<!-- file:") + PAGE.count("<!-- run")
    assert len(blocks) > 8
    for kind, argument, text in blocks:
        if kind == "file":
            place = tmp_path / argument
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text)
            continue
        for line in text.splitlines():
            assert line.startswith("$ "), line
            execute(line.removeprefix("$ "), tmp_path, fails=argument == "fails")
    names = {each.name for each in tmp_path.iterdir()}
    assert {"drive", "first", "slow", "gated", "first.html", "benchmark.xml"} <= names


def execute(command: str, folder: Path, *, fails: bool) -> None:
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(
        ["/bin/bash", "-c", command], cwd=folder, env=environment, capture_output=True, text=True
    )
    said = f"{command}\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in said, said
    if fails and command.startswith("r2bspec run"):
        assert done.returncode in {1, INCONCLUSIVE, INVALID}, said
    elif command.startswith(("r2bspec run", "r2bspec judge")):
        assert done.returncode in {0, INCONCLUSIVE, INVALID}, said
    else:
        assert done.returncode == 0, said


def test_the_workflow_names_inputs_that_the_action_has() -> None:
    workflow = next(text for _, name, text in BLOCK.findall(PAGE) if name.endswith(".yml"))
    (job,) = yaml.safe_load(workflow)["jobs"].values()
    action = yaml.safe_load((ROOT / "action.yml").read_text())
    assert set(job["steps"][-1]["with"]) <= set(action["inputs"])
