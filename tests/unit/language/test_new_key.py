"""A key that only the executor reads costs its declaration; all else follows from that."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
DECLARATION = "r2bspec/language/spec_benchmark.py"
FIELD = '    cool_down: Annotated[Duration, key("2 s", changes="neither")] = Duration(0)\n'
SENTENCE = "        cool_down: How long is waited.\n"
SPEC = (ROOT / "specs" / "relay.r2b.yaml").read_text(encoding="utf-8")
ASK = """
import msgspec
from key_tables import key_table
from r2bspec.language.declaration import rule_at
from r2bspec.language.quantities import Duration
from r2bspec.plan.comparability import change_of, graph_differences
from r2bspec.plan.smoke_plan import smoke_plan
from run_simulation import Simulation
plan = Simulation().plan()
other = msgspec.structs.replace(plan, cool_down=Duration(2 * 10**9))
print(change_of("cool_down"), graph_differences(plan, other), smoke_plan(other).cool_down)
print(rule_at(("benchmark", "cool_down")).shown_default)
print(key_table("benchmark"))
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder with a copy of the package, in which one file has one more key."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "r2bspec", tmp_path / "r2bspec", ignore=ignored)
    file = tmp_path / DECLARATION
    text = file.read_text(encoding="utf-8")
    for before, added in (
        ("    drain_timeout: Annotated[", FIELD),
        ("        drain_timeout: How long", SENTENCE),
    ):
        assert text.count(before) == 1
        text = text.replace(before, f"{added}{before}")
    file.write_text(text, encoding="utf-8")
    return tmp_path


def run(package: Path, *arguments: str) -> str:
    """What Python prints in the folder of the copy, which it imports."""
    paths = os.pathsep.join([str(package), str(ROOT / "tests" / "support")])
    environment = {**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=package,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    ).stdout


def test_a_declaration_is_enough(package: Path) -> None:
    spec = package / "example.r2b.yaml"
    spec.write_text(SPEC.replace("benchmark:\n", "benchmark:\n  cool_down: 2 s\n"))
    program = ("-m", "r2bspec")
    assert "no problems" in run(package, *program, "validate", "--offline", spec.name)
    assert json.loads(run(package, *program, "plan", spec.name))["cool_down"] == "2 s"
    for kind in ("spec", "plan"):
        assert '"cool_down": {' in run(package, *program, "schema", kind)
    said = run(package, "-c", ASK)
    assert said.startswith("neither [] 2 s\n0 s\n")
    assert "| `cool_down` | duration, default `0 s` | How long is waited. Example: `2 s`. |" in said
