"""``--require-slos``: a spec that nothing can fail is refused, with a way out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from command_line import Call
from example_spec import example
from r2bspec import api
from r2bspec.plan.canonical_json import canonical_json

HINT = "fast: {at: 30 Hz, level: warn, require: [latency.p90 < 50 ms]}"
SLOS = {
    "none": "",
    "hint": HINT,
    "fast": HINT.replace("level: warn, ", ""),
    "case": HINT.replace("level: warn", "when: {threads: 1}"),
    "many/a": "",
    "many/b": HINT,
}
REFUSED = "1:1: error[R2B693 missing-objectives]: "
PLAIN_NODE = """
from rclpy.node import Node
from sensor_msgs.msg import Image


class Plain(Node):
    def __init__(self) -> None:
        super().__init__("plain")
        publisher = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", publisher.publish, 10)
"""


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Specs by what their objectives are, and the plan of one without any."""
    monkeypatch.chdir(tmp_path)
    Path("many").mkdir()
    for name, slos in SLOS.items():
        cases = "variables: {threads: 1}\nmatrix: {axes: {threads: [1, 2]}}\n" * (name == "case")
        sections = {"slos": slos} if slos else {}
        Path(f"{name}.r2b.yaml").write_text(example(Path(name).name, **sections) + cases)
    text = Path("none.r2b.yaml").read_text()
    waived = text.replace("r2bspec: 1", "r2bspec: 1  # r2bspec: ignore[R2B693] reason")
    Path("waived.r2b.yaml").write_text(waived)
    plain = text.replace("r2bspec.nodes.RelayNode", "./plain.py:Plain")
    Path("plain.r2b.yaml").write_text(plain.replace("graph:", "graph:\n  placement: shared"))
    Path("plain.py").write_text(PLAIN_NODE)
    plan = api.compile_plan(Path("none.r2b.yaml"))
    Path("plan.json").write_bytes(canonical_json(plan))


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        ("run none.r2b.yaml", 2, f"none.r2b.yaml:{REFUSED}no active objective"),
        ("run hint.r2b.yaml", 2, f"hint.r2b.yaml:{REFUSED}no active objective"),
        ("run plan.json", 2, f"plan.json:{REFUSED}"),
        ("run none.r2b.yaml --against fast.r2b.yaml", 2, f"none.r2b.yaml:{REFUSED}"),
        ("run many --no-lock", 2, f"many/b.r2b.yaml:{REFUSED}"),
        # A smoke run judges nothing.
        ("run fast.r2b.yaml --smoke", 2, "--smoke"),
        ("validate --offline none.r2b.yaml", 1, f"none.r2b.yaml:{REFUSED}"),
        ("validate --offline hint.r2b.yaml", 1, f"hint.r2b.yaml:{REFUSED}"),
        ("validate --offline fast.r2b.yaml", 0, "1 file, no problems"),
        (
            "validate --offline case.r2b.yaml",
            1,
            f"{REFUSED}no active objective of level error in threads=2: nothing",
        ),
        # No comment waives it.
        ("validate --offline waived.r2b.yaml", 1, f"waived.r2b.yaml:{REFUSED}"),
    ],
)
def test_a_spec_that_nothing_can_fail_is_refused(
    arguments: str, status: int, words: str, call: Call
) -> None:
    said = call(*arguments.split(), "--require-slos", status=status)
    assert words in said.out + said.err
    assert not [*Path("runs").rglob("record.json")]


def test_it_is_said_once_with_a_way_out_and_only_where_it_is_asked_for(call: Call) -> None:
    said = call("run", "none.r2b.yaml", "--require-slos", "--quiet", status=2).err
    assert said.count("R2B693") == 1
    assert "add a requirement under 'slos'" in said
    call("validate", "none.r2b.yaml", "hint.r2b.yaml", "--offline", status=0)


def test_the_refusal_is_json_where_json_is_asked_for(call: Call) -> None:
    arguments = ("run", "none.r2b.yaml", "--require-slos", "--format", "json")
    content = json.loads(call(*arguments, status=2).out)
    assert (content["code"], content["exit_status"]) == ("R2B693", 2)


def test_each_spec_of_a_suite_is_refused_on_its_own(call: Call) -> None:
    said = call("run", "many", "--require-slos", "--no-lock", "--output", "out", status=2).err
    assert all(f"{name}.r2b.yaml:{REFUSED}" in said for name in "ab")
    runs = json.loads(Path("out/suite.json").read_text())["runs"]
    assert [run["exit_status"] for run in runs] == [2, 2]
    assert all("no active objective" in run["reason"] for run in runs)
