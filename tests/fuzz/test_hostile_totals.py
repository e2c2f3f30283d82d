"""What is small in each file, case or topic, and very much in all of them together.

As in `test_hostile_files`, every command runs in little address space.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from hostile_calls import LIVE, LONGEST_S, answered, change_database
from test_hostile_bags import MESSAGES, refused
from test_hostile_files import COMMAND

from data_bags import text, write_bag, write_mcap, write_ros1
from r2bspec.safe_io.limits import (
    MAX_BAG_ENTRIES,
    MAX_COMPANION_YAML_BYTES,
    MAX_EXTENDED_BYTES,
    MAX_SPEC_PYTHON_BYTES,
)

pytestmark = pytest.mark.timeout(4 * LONGEST_S)

TOO_MANY = MAX_BAG_ENTRIES + 1


def validate(folder: Path, spec: str) -> str:
    file = folder / "hostile.r2b.yaml"
    file.write_text(spec, encoding="utf-8")
    said = answered("validate", file, cwd=folder, status=(0, 1))
    assert len(said) < 1_000_000
    return said


def test_extended_files_have_a_limit_together(tmp_path: Path) -> None:
    size = MAX_EXTENDED_BYTES // 20
    for number in range(30):
        (tmp_path / f"b{number}.yaml").write_text(f"title: '{'x' * size}'\n", encoding="utf-8")
    names = ", ".join(f"./b{number}.yaml" for number in range(30))
    said = validate(tmp_path, LIVE.replace("PLACE", COMMAND) + f"extends: [{names}]\n")
    assert "the extended files have more than 1 MB together" in said
    names = ", ".join(f"./b{number}.yaml" for number in range(10))
    said = validate(tmp_path, LIVE.replace("PLACE", COMMAND) + f"extends: [{names}]\n")
    assert "together" not in said


def test_one_file_that_is_extended_often_counts_often(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text("# x\n" * 250_000, encoding="utf-8")
    names = ", ".join(["./base.yaml"] * 90)
    said = validate(tmp_path, LIVE.replace("PLACE", COMMAND) + f"extends: [{names}]\n")
    assert "the extended files have more than 1 MB together" in said


def nodes(entry: str, number: int) -> str:
    lines = (f"    n{i}: {{{entry.replace('@', str(i))}}}\n" for i in range(number))
    return LIVE.replace("graph: {nodes: {n: {PLACE}}}", "graph:\n  nodes:\n" + "".join(lines))


def test_parameter_files_have_a_limit_together(tmp_path: Path) -> None:
    content = "# x\n" * (MAX_COMPANION_YAML_BYTES // 40) + "/**: {ros__parameters: {a: 1}}\n"
    for number in range(20):
        (tmp_path / f"p{number}.yaml").write_text(content, encoding="utf-8")
    said = validate(tmp_path, nodes(f"{COMMAND}, parameters: ./p@.yaml", 20))
    assert "the files read before have more than 3,000,000 bytes together" in said
    said = validate(tmp_path, nodes(f"{COMMAND}, parameters: ./p@.yaml", 5))
    assert "together" not in said


def test_interfaces_have_a_limit_together(tmp_path: Path) -> None:
    (tmp_path / "interfaces").mkdir()
    content = "# x\n" * (MAX_COMPANION_YAML_BYTES // 40) + "publishes: {}\n"
    for number in range(20):
        (tmp_path / f"interfaces/n{number}.yaml").write_text(content, encoding="utf-8")
    assert "3,000,000 bytes together" in validate(tmp_path, nodes(COMMAND, 20))


def test_python_files_have_a_limit_together(tmp_path: Path) -> None:
    for number in range(15):
        content = "x = 1\n" * (MAX_SPEC_PYTHON_BYTES // 60)
        (tmp_path / f"n{number}.py").write_text(content, encoding="utf-8")
    validate(tmp_path, nodes("python: './n@.py:N'", 15))


def test_wildcards_of_many_files_have_a_limit_together(tmp_path: Path) -> None:
    content = "".join(f"/**/x{i}: {{ros__parameters: {{a: 1}}}}\n" for i in range(100))
    for number in range(20):
        (tmp_path / f"p{number}.yaml").write_text(content, encoding="utf-8")
    files = ", ".join(f"./p{number}.yaml" for number in range(20))
    said = validate(tmp_path, nodes(f"{COMMAND}, parameters: [{files}]", 1500))
    assert "for all nodes and cases together" in said


def matrix(values: int) -> str:
    numbers = ", ".join(map(str, range(values)))
    return f"variables: {{v: 0}}\nmatrix: {{axes: {{v: [{numbers}]}}}}\n"


def test_every_case_of_a_matrix_reads_a_file_once(tmp_path: Path) -> None:
    (tmp_path / "p.yaml").write_text(
        "# x\n" * 200_000 + "/**: {ros__parameters: {a: 1}}\n", encoding="utf-8"
    )
    said = validate(tmp_path, nodes(f"{COMMAND}, parameters: ./p.yaml", 1) + matrix(900))
    assert "900 cases" in said
    assert "together" not in said


def test_what_references_insert_has_one_limit_for_all_cases(tmp_path: Path) -> None:
    value = f"variables: {{v: 0, long: '{'x' * 100_000}'}}\ntitle: $(var long)\n"
    cases = matrix(900).partition("\n")[2]
    said = validate(tmp_path, nodes(COMMAND, 1) + value + cases)
    assert "with all its cases, is larger than 10 MB" in said


def test_every_case_of_a_matrix_indexes_a_bag_once(tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", MESSAGES, topics=[f"/t{number}" for number in range(500)])
    spec = nodes(COMMAND, 1).replace("playback: {mode: live}", "playback: {inputs: {i: {from: a}}}")
    spec += "data_loader: {bag: ./bag, topics: {/a: a}}\n" + matrix(300)
    assert "300 cases" in validate(tmp_path, spec)


@pytest.mark.parametrize("length", [5_000, 9_000_000])
@pytest.mark.parametrize("prefix", ["", "./", "/"])
def test_a_very_long_name_of_a_bag_is_clipped(prefix: str, length: int, tmp_path: Path) -> None:
    spec = nodes(COMMAND, 1) + f"data_loader: {{bag: {prefix}{'x' * length}, topics: {{/a: a}}}}\n"
    said = validate(tmp_path, spec.replace("playback: {mode: live}", "playback: {inputs: {}}"))
    assert len(said) < 20_000


MANY_TOPICS = """
WITH RECURSIVE n(i) AS (SELECT 10 UNION ALL SELECT i + 1 FROM n WHERE i < 10010)
INSERT INTO topics SELECT i, '/t' || i, type, serialization_format, offered_qos_profiles,
type_description_hash FROM n, topics WHERE id = 1
"""


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (MANY_TOPICS, "10,002 topics"),
        ("UPDATE topics SET name = '/' || hex(zeroblob(1000000))", "a name of 2,000,001 "),
        ("UPDATE topics SET type = hex(zeroblob(1000000))", "a name of 2,000,000 characters"),
        ("UPDATE topics SET name = zeroblob(9)", "a name or a type that is no text"),
        ("UPDATE topics SET type = zeroblob(9)", "a name or a type that is no text"),
        (
            "UPDATE topics SET offered_qos_profiles = hex(zeroblob(33000000))",
            "its table topics has texts of 66,000,000 bytes",
        ),
    ],
    ids=["topics", "name", "type", "blob", "number", "profiles"],
)
def test_topics_in_a_database_have_limits(change: str, reason: str, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", MESSAGES)
    file = bag / "bag.db3"
    change_database(file, change)
    (bag / "metadata.yaml").unlink()
    file.rename(tmp_path / "lone.db3")
    refused(tmp_path / "lone.db3", reason, code="R2B304")


def test_topics_in_other_storage_have_limits(tmp_path: Path) -> None:
    many = [(f"/t{number}", number, text("x")) for number in range(TOO_MANY)]
    refused(write_mcap(tmp_path / "many.mcap", many), "10,001 topics", code="R2B304")
    long = [("/" + "t" * 1_000_000, 0, text("x"))]
    refused(write_mcap(tmp_path / "long.mcap", long), "a name of 1,000,001", code="R2B304")
    refused(write_ros1(tmp_path / "long.bag", long), "a name of 1,000,001", code="R2B304")
