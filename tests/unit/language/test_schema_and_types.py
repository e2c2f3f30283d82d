"""What follows from the declarations: rules, defaults, the schema for editors, and new keys."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import jsonschema
import msgspec
import pytest

from r2bspec.diagnostics import Path as TreePath
from r2bspec.language.declaration import Record, ValueRule, language, rule_at
from r2bspec.language.document import Source
from r2bspec.language.json_schema import published_schema, published_schema_text
from r2bspec.language.load_spec import load_spec
from r2bspec.language.located_tree import TreeNode, to_plain
from r2bspec.language.node_kinds import (
    NODE_KIND_KEYS,
    NODE_KINDS,
    NodeKindName,
    kinds_help,
    kinds_text,
)
from r2bspec.language.quantities import Duration
from r2bspec.language.read_spec import INVALID, read_value
from r2bspec.language.spec import Node
from r2bspec.language.yaml_document import compose
from r2bspec.plan import command_lines

# What follows from the declarations: rules, defaults, and the schema for editors.


ROOT = Path(__file__).parents[3]
GOLDEN = ROOT / "tests" / "golden" / "language"


def rules(rule: ValueRule, path: TreePath = ()) -> Iterator[tuple[TreePath, ValueRule]]:
    """Every rule of the language."""
    yield path, rule
    for key, below in (rule.keys or {}).items():
        yield from rules(below, (*path, key))
    for step, inner in (("*", rule.values), (0, rule.items)):
        if inner is not None:
            yield from rules(inner, (*path, step))


ALL = list(rules(language()))
RECORDS = [(path, rule) for path, rule in ALL if rule.record is not None]


def located(value: object) -> TreeNode:
    """A plain value as a tree."""
    tree = compose(Source("example", json.dumps(value))).tree
    assert tree is not None
    return tree


def test_every_field_is_a_key_or_made_of_keys() -> None:
    for path, rule in RECORDS:
        assert rule.keys is not None
        assert rule.record is not None
        written = {key.field for key in rule.keys.values() if not key.loader}
        assert written <= set(rule.record.__struct_fields__), path
        made = set(rule.record.__struct_fields__) - written
        assert made <= {"parameter_sources", "at_peak"}, path


def test_keys_that_are_no_fields_are_evaluated_while_loading() -> None:
    names = {path[-1] for path, rule in ALL if rule.loader}
    assert names == {"extends", "matrix", "repeat", "profile"}


def test_an_example_of_every_value_is_read() -> None:
    for path, rule in ALL:
        assert rule.about.examples or not path or path[-1] == "type", path
        for example in rule.about.examples:
            value, violations = read_value(located(example), rule)
            assert not violations, (path, example)
            assert value is not INVALID


def test_shown_defaults_are_those_of_the_fields() -> None:
    for path, rule in ALL:
        if rule.owner is None or rule.is_required or rule.loader:
            continue
        if rule.shown_default is None:
            assert not rule.default or rule.about.hidden_default or rule.about.unless_live, path
        else:
            value, _ = read_value(located(rule.shown_default), rule)
            made = rule.owner.from_keys({**_required(rule.owner), rule.field: value})
            assert getattr(made, rule.field, value) == rule.default, path


def _required(record: type[Record]) -> dict[str, Any]:
    fields = msgspec.structs.fields(record)
    return {field.name: None for field in fields if field.required}


def test_everything_is_described() -> None:
    for path, rule in ALL:
        assert len(rule.description) > 5, path
    for path, rule in _with_paths(published_schema()):
        for example in rule["examples"]:
            assert not list(jsonschema.Draft7Validator(rule).iter_errors(example)), path


def _with_paths(schema: Any, path: TreePath = ()) -> Iterator[tuple[TreePath, Any]]:
    yield path, schema
    for key, below in schema.get("properties", {}).items():
        yield from _with_paths(below, (*path, key))
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield from _with_paths(schema[key], (*path, key))


def test_substitution_in_keys_is_for_topics() -> None:
    maps = {path[-1] for path, rule in ALL if rule.about.topics}
    assert maps == {
        *("topics", "inputs", "translations"),
        *("remappings", "publishes", "subscribes", "qos"),
    }


def test_what_a_key_changes_is_said_for_every_section() -> None:
    assert {key for key, rule in (language().keys or {}).items() if not rule.about.changes} == set()


def test_a_section_says_it_for_its_keys() -> None:
    assert rule_at(("benchmark", "duration")) is not None
    with_examples = rule_at(("setup", "model", "timeout"))
    assert with_examples is not None
    assert with_examples.default == Duration(600 * 10**9)
    assert with_examples.shown_default == "10 min"


# ---- the schema for editors ------------------------------------------------------------------


def test_it_is_draft_07() -> None:
    jsonschema.Draft7Validator.check_schema(published_schema())


def test_nothing_private_is_published() -> None:
    text = published_schema_text()
    assert "r2b-" not in re.sub(r"r2b-(?=v1)", "", text)
    assert "oneOf" not in text


def test_references_are_accepted_wherever_a_scalar_stands() -> None:
    loaded = load_spec(GOLDEN / "ok_full.yaml", environ={})
    assert loaded.tree is not None
    validator = jsonschema.Draft7Validator(published_schema())
    document = to_plain(loaded.tree)
    for reference in ("$(var x)", "$(env X)"):
        changed = _with_scalars(document, reference) | {"r2bspec": 1}
        assert [error.path for error in validator.iter_errors(changed)] == []


def _with_scalars(value: Any, text: str) -> Any:
    """The value with a text in place of every scalar."""
    if isinstance(value, dict):
        return {key: _with_scalars(inner, text) for key, inner in value.items()}
    return [_with_scalars(inner, text) for inner in value] if isinstance(value, list) else text


BASE = ("extends",)
NODE = ("graph", "nodes", "detector")


@pytest.mark.parametrize(
    ("extending", "path", "accepted"),
    [
        (BASE, ("title",), True),
        (BASE, ("playback",), True),
        (BASE, ("playback", "mode"), True),
        (BASE, ("slos", "peak"), True),
        (BASE, (*NODE, "remappings"), True),
        (BASE, (*NODE, "remappings", "image"), True),
        (BASE, ("benchmark", "rates", 0), False),
        (BASE, ("r2bspec",), False),
        ((*NODE, "extends"), (*NODE, "remappings", "image"), True),
        ((*NODE, "extends"), (*NODE, "parameters"), True),
        ((*NODE, "extends"), ("title",), False),
        ((*NODE, "extends"), ("graph", "nodes", "other"), False),
        (None, ("title",), False),
        (None, ("playback", "mode"), False),
        (None, (*NODE, "remappings", "image"), False),
    ],
)
def test_editors_accept_null_where_it_removes_something(
    extending: TreePath | None, path: TreePath, accepted: bool
) -> None:
    document = to_plain(load_spec(GOLDEN / "ok_full.yaml", environ={}).tree)  # type: ignore[arg-type]
    if extending is not None:
        _put(document, extending, "base")
    validator = jsonschema.Draft7Validator(published_schema())
    assert not list(validator.iter_errors(document))
    _put(document, path, None)
    assert (not list(validator.iter_errors(document))) is accepted


def _put(document: Any, path: TreePath, value: object) -> None:
    place = document
    for part in path[:-1]:
        place = place.setdefault(part, {}) if isinstance(place, dict) else place[part]
    place[path[-1]] = value


def test_the_kind_that_is_meant_stands_before_null() -> None:
    """Editors insert by the first one."""
    for _, schema in _with_paths(published_schema()):
        kinds = schema.get("type")
        if isinstance(kinds, list):
            assert kinds[0] != "null"
            assert kinds.count("null") <= 1


# A key that only the executor reads costs its declaration; all else follows from that.


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


# The kinds of node are listed once.


def test_the_table_is_complete() -> None:
    assert [each.name for each in NODE_KINDS] == list(get_args(NodeKindName))
    assert set(NODE_KIND_KEYS) <= set(Node.__struct_fields__)
    assert set(command_lines._ARGV) == {each.name for each in NODE_KINDS if each.role is not None}


def test_the_kinds_in_words() -> None:
    assert kinds_text() == (
        "'python', 'package' with 'plugin', 'package' with 'executable', 'command', 'launch', or "
        "'external'"
    )
    assert kinds_help() == (
        "'python', 'package' with 'plugin' or 'executable', 'command', 'launch', or "
        "'external: true'"
    )
