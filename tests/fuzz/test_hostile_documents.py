"""Documents made to break a parser: each is answered by a finding, in bounded memory."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hostile_calls import LIVE, LONGEST_S, answered

pytestmark = pytest.mark.timeout(LONGEST_S + 30)

MINIMAL = """\
r2bspec: 1
name: minimal
data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: image_raw}}
playback: {inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}}
graph: {nodes: {relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}}}
monitors: {output: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {rates: [30 Hz]}
"""


def _bomb(levels: int) -> str:
    first = "x-0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"
    rest = (f"x-{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, levels))
    return MINIMAL + first + "".join(rest)


TEXTS: dict[str, tuple[str | bytes, str]] = {
    "alias bomb": (_bomb(30), "R2B027"),
    "alias bomb in a known key": (_bomb(8).replace("x-7:", "labels:"), "R2B027"),
    "lists 10,000 deep": (MINIMAL + "labels: " + "[" * 10_000, "R2B025"),
    "dashes 10,000 deep": (MINIMAL + "labels:\n  " + "- " * 10_000, "R2B025"),
    "indented 2,000 deep": ("\n".join(" " * n + "a:" for n in range(2000)), "R2B025"),
    "extends itself": (MINIMAL + "extends: ./hostile.r2b.yaml\n", "R2B135"),
    "extends a device": (MINIMAL + "extends: /dev/zero\n", "R2B13"),
    "a matrix without end": (
        MINIMAL
        + "variables: {a: 1, b: 1, c: 1, d: 1, e: 1, f: 1}\nmatrix:\n  axes:\n"
        + "".join(f"    {name}: [{', '.join(map(str, range(100)))}]\n" for name in "abcdef"),
        "R2B1",
    ),
    "only NUL": ("\0" * 100_000, "R2B003"),
    "a lone surrogate in bytes": (MINIMAL.encode() + b"title: \xed\xa0\x80\n", "R2B003"),
    "a huge number": (MINIMAL + f"labels: {{a: {'9' * 1_000_000}}}\n", "R2B029"),
    "a huge quantity": (MINIMAL.replace("30 Hz", "1e999999999 Hz"), "R2B110"),
    "a scalar": ("x" * 1_000_000, "R2B103"),
    "an endless line": (MINIMAL + "title: [" + "x " * 1_000_000, "R2B012"),
    "too many keys": ("".join(f"k{i}: 1\n" for i in range(300_000)), "R2B002"),
    "a large file": (MINIMAL + "# x\n" * 3_000_000, "R2B002"),
}
"""Small mistakes are in tests/golden/language, with the words that are said about them."""


@pytest.mark.parametrize("name", TEXTS)
def test_a_hostile_text_is_answered(name: str, tmp_path: Path) -> None:
    text, code = TEXTS[name]
    file = tmp_path / "hostile.r2b.yaml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    said = answered("validate", file, cwd=tmp_path, status=1)
    assert re.search(rf"^\S*hostile.r2b.yaml:\d+:\d+: \w+\[{code}", said, re.MULTILINE), said[:2000]
    assert max(map(len, said.splitlines())) < 2000


@pytest.mark.parametrize("form", ["json", "github", "sarif", "junit"])
def test_every_form_holds_hostile_names_and_texts(form: str, tmp_path: Path) -> None:
    file = tmp_path / "a,b:c%\x1b[31m é.r2b.yaml"
    file.write_text(MINIMAL + "labels: {\"\\x07\\u202e\": [1], ']]>': {a: 1}}\n", encoding="utf-8")
    answered("validate", file, "--format", form, cwd=tmp_path, status=1, says="R2B103")


def _nested_merges() -> str:
    first = "m0: &m0 {" + ", ".join(f"k{i}: 1" for i in range(10)) + "}\n"
    rest = (f"m{i}: &m{i} {{<<: [{', '.join([f'*m{i - 1}'] * 10)}]}}\n" for i in range(1, 9))
    return first + "".join(rest)


@pytest.mark.parametrize(
    "text",
    [_nested_merges(), "- " * 40_000 + "a", "a: " + "9" * 900_000, "a: 2024-99-99\n"],
    ids=["merges", "deep", "digits", "date"],
)
def test_hostile_yaml_next_to_a_spec_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "interfaces").mkdir()
    for name in ("interfaces/n.yaml", "parameters.yaml"):
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "hostile.r2b.yaml").write_text(
        LIVE.replace("PLACE", "command: [x], parameters: ./parameters.yaml")
    )
    said = answered("validate", "hostile.r2b.yaml", cwd=tmp_path, status=1)
    assert "interfaces/n.yaml' is ignored" in said
    assert "parameter file './parameters.yaml' " in said
