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
from r2bspec.cli.main import main
main(["validate", "--offline", "example.r2b.yaml"])
for arguments in (["plan", "example.r2b.yaml"], ["schema", "spec"], ["schema", "plan"]):
    main(arguments)
    print("-----")
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


def test_a_declaration_is_enough(package: Path) -> None:
    text = SPEC.replace("benchmark:\n", "benchmark:\n  cool_down: 2 s\n")
    (package / "example.r2b.yaml").write_text(text)
    paths = os.pathsep.join([str(package), str(ROOT / "tests" / "support")])
    said = subprocess.run(
        [sys.executable, "-c", ASK],
        cwd=package,
        env={**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    validated, plan = said.split("-----\n")[0].split("{", 1)
    assert "no problems" in validated
    assert json.loads("{" + plan)["cool_down"] == "2 s"
    for schema in said.split("-----\n")[1:3]:
        assert '"cool_down": {' in schema
    answers = said.split("-----\n")[3]
    assert answers.startswith("neither [] 2 s\n0 s\n")
    row = "| `cool_down` | duration, default `0 s` | How long is waited. Example: `2 s`. |"
    assert row in answers
