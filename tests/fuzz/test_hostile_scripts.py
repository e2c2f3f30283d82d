"""Damaged scripts and launch files: a finding or a spec, never a traceback."""

from __future__ import annotations

import ast
import random
import shutil
from pathlib import Path

import pytest

from r2bspec.authoring.sources import InitSources, spec_from_sources
from r2bspec.cli.main import main
from r2bspec.errors import UsageError

SCRIPTS = Path(__file__).parents[1] / "golden" / "script_import" / "scripts"
REPLACEMENTS = (
    *("None", "[]", "{}", "''", "-1", "1e400", "undefined", "lambda: 0", "(1, 2)", "{'a': [1]}"),
    *("self", "*x", "f'{1}'", "True", "'\\x00'", "'/'", "'a b'", "10**9", "1j", "b''", "..."),
)
MARKUP = """<launch>
  <arg name="a" default="b"/>
  <node_container pkg="rclcpp_components" exec="component_container" name="c" namespace="">
    <composable_node pkg="p" plugin="p::P" name="n"><remap from="x" to="$(var a)"/>
    </composable_node>
  </node_container>
  <group><push-ros-namespace namespace="s"/><node pkg="p" exec="e" args="$(env HOME)"/></group>
</launch>
"""
PIECES = ('"', "<", ">", "{", "]", ":", "\n", "- ", "$(", ")", "\x00", "é", "'", "&a;", "<!", "*a")


def damaged_script(text: str, rng: random.Random) -> str:
    parts = [
        each
        for each in ast.walk(ast.parse(text))
        if isinstance(each, ast.Constant | ast.Name | ast.List | ast.Call | ast.Attribute)
        and each.lineno == each.end_lineno
    ]
    lines = text.split("\n")
    for each in rng.sample(parts, 2):
        line = lines[each.lineno - 1]
        new = line[: each.col_offset] + rng.choice(REPLACEMENTS) + line[each.end_col_offset :]
        lines[each.lineno - 1] = new
    return "\n".join(lines)


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda each: each.stem)
def test_damaged_scripts(script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(SCRIPTS / "stereo_cell", "stereo_cell")
    rng = random.Random(script.stem)  # noqa: S311 - repeatable damage
    for number in range(8):
        file = Path(f"damaged_{number}.py")
        file.write_text(damaged_script(script.read_text(), rng))
        for words in (["import", "--check", str(file)], ["import", str(file), "-o", f"{number}"]):
            assert main(words) in {0, 1}


def test_damaged_launch_files(tmp_path: Path) -> None:
    rng = random.Random(3)  # noqa: S311 - repeatable damage
    file = tmp_path / "a.launch.xml"
    for _ in range(150):
        text = MARKUP
        for _ in range(rng.randint(1, 3)):
            start = rng.randrange(len(text))
            text = text[:start] + rng.choice(PIECES) + text[start + rng.randint(0, 9) :]
        file.write_text(text)
        assert code_of(file) in {"", "R2B701", "R2B702", "R2B703"}


def code_of(file: Path) -> str:
    """The code of the error; empty for a file that a spec is made of."""
    try:
        spec_from_sources("made", file.parent, InitSources(launch=str(file)))
    except UsageError as error:
        return error.code
    return ""
