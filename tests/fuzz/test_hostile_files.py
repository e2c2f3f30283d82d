"""Files next to a spec, made to be read without end, to fill memory, or to lead to secrets."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hostile_calls import ENDLESS, LIVE, LONGEST_S, answered, make_special, r2bspec

SECRET = "hunter2-do-not-show"

COMMAND = "command: [x]"
UNHASHABLE = """\
from rclpy.node import Node
class N(Node):
  def __init__(self):
    self.declare_parameter('a', {[]: 1})
"""

pytestmark = pytest.mark.timeout(LONGEST_S + 30)


def validate(folder: Path, node: str = COMMAND) -> str:
    """What validate prints of a spec with this node; it never shows the secret."""
    spec = folder / "hostile.r2b.yaml"
    if not os.path.lexists(spec):
        spec.write_text(LIVE.replace("PLACE", node), encoding="utf-8")
    _, said = r2bspec("validate", spec, cwd=folder)
    assert SECRET not in said
    return said


@pytest.mark.parametrize("kind", ENDLESS)
def test_a_file_without_an_end_is_refused(kind: str, tmp_path: Path) -> None:
    make_special(tmp_path / "endless", kind)
    (tmp_path / "interfaces").mkdir()
    (tmp_path / "interfaces/n.yaml").symlink_to("../endless")
    said = validate(tmp_path, f"{COMMAND}, parameters: [./endless, /dev/urandom]")
    assert "parameter file 'endless' cannot be read" in said or "./endless" in said
    assert "R2B223" in said


@pytest.mark.parametrize("kind", ENDLESS)
def test_a_spec_without_an_end_is_refused(kind: str, tmp_path: Path) -> None:
    make_special(tmp_path / "endless", kind)
    (tmp_path / "hostile.r2b.yaml").symlink_to("endless")
    assert "error[R2B001 file-unreadable]" in validate(tmp_path)


@pytest.mark.parametrize(
    "content",
    [
        f"https://user:{SECRET}@example.org\n",
        f"//registry.example.org/:_authToken={SECRET}\n",
        f"machine example.org\nlogin me\npassword {SECRET}\n",
        f'{{"{SECRET}": {{"auth": "{SECRET}"}}}}\n',
        f"[default]\naws_secret_access_key = {SECRET}\n",
        f"oauth_token: {SECRET}\n{SECRET}: 1\n",
    ],
)
def test_no_line_of_a_linked_file_is_shown(content: str, tmp_path: Path) -> None:
    folder = tmp_path / "repository"
    (folder / "interfaces").mkdir(parents=True)
    (tmp_path / "credentials").write_text(content, encoding="utf-8")
    (folder / "interfaces/n.yaml").symlink_to(tmp_path / "credentials")
    (folder / "parameters.yaml").symlink_to(tmp_path / "credentials")
    (folder / "linked.r2b.yaml").symlink_to(tmp_path / "credentials")
    said = validate(folder, f"{COMMAND}, parameters: [./parameters.yaml, ../credentials]")
    assert said.count("it is a link out of its folder") == 2
    why = "cannot read the file: it is a link out of its folder"
    said = answered("validate", "linked.r2b.yaml", cwd=folder, status=1, says=why)
    assert SECRET not in said
    assert "--allow-path" in said


def test_a_link_inside_of_the_folder_or_to_an_allowed_one_is_followed(tmp_path: Path) -> None:
    folder, shared = tmp_path / "specs", tmp_path / "shared"
    folder.mkdir()
    shared.mkdir()
    text = LIVE.replace("PLACE", COMMAND)
    (folder / "real.yaml").write_text(text, encoding="utf-8")
    (shared / "far.yaml").write_text(text, encoding="utf-8")
    (folder / "near.r2b.yaml").symlink_to("real.yaml")
    (folder / "far.r2b.yaml").symlink_to("../shared/far.yaml")
    for *arguments, refused in (
        ("near.r2b.yaml", False),
        ("far.r2b.yaml", True),
        ("far.r2b.yaml", "--allow-path", "../shared", False),
    ):
        _, said = r2bspec("validate", *map(str, arguments), cwd=folder)
        assert ("R2B001" in said) == refused


@pytest.mark.parametrize("text", [f"{SECRET}\n", f"a\n  {SECRET}\n", f"- {SECRET}\n"])
def test_a_document_that_is_no_spec_is_described_and_not_quoted(text: str, tmp_path: Path) -> None:
    (tmp_path / "hostile.r2b.yaml").write_text(text, encoding="utf-8")
    _, said = r2bspec("validate", "hostile.r2b.yaml", cwd=tmp_path)
    assert "the document must be a map, not a" in said
    if not text.startswith("-"):
        assert SECRET not in said


def _nested_merges() -> str:
    first = "m0: &m0 {" + ", ".join(f"k{i}: 1" for i in range(10)) + "}\n"
    rest = (f"m{i}: &m{i} {{<<: [{', '.join([f'*m{i - 1}'] * 10)}]}}\n" for i in range(1, 9))
    return first + "".join(rest)


@pytest.mark.parametrize(
    "text",
    [
        _nested_merges(),
        "- " * 40_000 + "a",
        "a: " + ":".join(["59"] * 300_000),
        "a: " + "9" * 900_000,
        "/**:\n  ros__parameters: {a: 2024-99-99}\n",
    ],
    ids=["merges", "deep", "sexagesimal", "digits", "date"],
)
def test_hostile_yaml_next_to_a_spec_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "interfaces").mkdir()
    (tmp_path / "interfaces/n.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "parameters.yaml").write_text(text, encoding="utf-8")
    said = validate(tmp_path, f"{COMMAND}, parameters: ./parameters.yaml")
    assert "interfaces/n.yaml' is ignored" in said
    assert "parameter file './parameters.yaml' " in said
    assert max(map(len, said.splitlines())) < 2000


@pytest.mark.parametrize(
    "target",
    ["./itself.py:N", '"./\\0x.py:X"', f"./{'x' * 300}.py:N", "./pipe.py:N", "./zeros.py:N"],
)
def test_a_hostile_name_of_a_python_file_is_answered(target: str, tmp_path: Path) -> None:
    for kind in ("itself", "zeros", "pipe"):
        make_special(tmp_path / f"{kind}.py", kind)
    assert "error" in validate(tmp_path, f"python: {target}")


@pytest.mark.parametrize(
    "source",
    [
        "import rclpy.node\nclass N(rclpy.node.Node):\n  def __init__(self):\n    if 0: pass\n"
        + "    elif 0: pass\n" * 2_000,
        "if 0: pass\n" + "elif 0: pass\n" * 2_000 + "class N: pass\n",
        UNHASHABLE,
        UNHASHABLE.replace("{[]: 1}", "{{}: {[]}}"),
        "x = " + "(" * 150 + ")" * 150 + "\n",
        "x = " + "-" * 50_000 + "1\n",
    ],
    ids=["elif in a class", "elif", "unhashable", "operator", "brackets", "minus"],
)
def test_a_hostile_python_file_is_answered(source: str, tmp_path: Path) -> None:
    (tmp_path / "n.py").write_text(source, encoding="utf-8")
    validate(tmp_path, "python: ./n.py:N")


def test_a_folder_that_contains_a_pipe_is_validated(tmp_path: Path) -> None:
    make_special(tmp_path / "pipe.r2b.yaml", "pipe")
    (tmp_path / "good.r2b.yaml").write_text(LIVE.replace("PLACE", COMMAND), encoding="utf-8")
    _, said = r2bspec("validate", tmp_path, cwd=tmp_path)
    assert "R2B001" in said
    assert "2 files" in said
