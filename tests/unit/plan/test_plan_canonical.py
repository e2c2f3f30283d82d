"""One way to write a plan that obeys its schema, reading it again, and two of them compared."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from plan_specs import PREPROCESSED, STRAIGHT, plan

from r2bspec.language.quantities import Duration
from r2bspec.plan.canonical_json import (
    PlanError,
    canonical_json,
    parse_plan,
    plan_hash,
    plan_schema,
    read_plan,
)
from r2bspec.plan.comparability import PlanDifference, diff_plans
from r2bspec.plan.plan import Plan

# One way to write a plan, the same bytes everywhere, and reading it again.


ROOT = Path(__file__).parents[3]

SCALARS = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(),
)


FULL = plan(STRAIGHT)


@pytest.mark.parametrize("document", [PREPROCESSED, STRAIGHT], ids=["preprocessed", "straight"])
def test_a_plan_obeys_its_schema_and_reads_back_as_it_was(
    document: dict[str, object], tmp_path: Path
) -> None:
    path = tmp_path / "plan.json"
    path.write_bytes(canonical_json(plan(document)))
    assert read_plan(path) == plan(document)
    assert canonical_json(read_plan(path)) == canonical_json(plan(document))
    Draft202012Validator.check_schema(plan_schema())
    Draft202012Validator(plan_schema()).validate(json.loads(path.read_bytes()))


@given(st.dictionaries(st.text(min_size=1, max_size=5), SCALARS, max_size=4))
def test_parameters_of_any_value_read_back_with_their_type(parameters: dict[str, object]) -> None:
    host = FULL.processes[1]
    node = msgspec.structs.replace(host.nodes[0], parameters=parameters)
    host = msgspec.structs.replace(host, nodes=(node,))
    full = msgspec.structs.replace(FULL, processes=(host,))
    read = parse_plan(canonical_json(full), "plan").processes[0].nodes[0].parameters
    assert read == parameters
    assert {key: type(value) for key, value in read.items()} == {
        key: type(value) for key, value in parameters.items()
    }


def test_the_form_is_sorted_indented_and_ends_with_a_newline() -> None:
    text = canonical_json(plan()).decode()
    assert text == json.dumps(json.loads(text), indent=2, sort_keys=True, ensure_ascii=False) + "\n"
    assert '"at": "30 Hz"' in text
    assert '"output.latency.p90 < 50 ms"' in text


def test_the_hash_is_of_the_bytes_and_changes_with_them() -> None:
    first = plan_hash(plan())
    assert first.startswith("sha256:")
    assert len(first) == len("sha256:") + 64
    assert plan_hash(plan()) == first
    assert plan_hash(msgspec.structs.replace(plan(), warm_up=Duration(1))) != first


def test_the_order_of_keys_in_the_spec_makes_no_difference_to_parameters() -> None:
    parameters = {"width": 640, "height": 480}
    resize = PREPROCESSED["preprocessors"]["resize"]
    hashes = {
        plan_hash(plan(preprocessors={"resize": {**resize, "parameters": dict(items)}}))
        for items in (parameters.items(), reversed(parameters.items()))
    }
    assert len(hashes) == 1


SCRIPT = """
from r2bspec.language.load_spec import load_spec
from r2bspec.datasets.catalogue import describe
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.compile_plan import compile_plan
import pathlib, sys
loaded = load_spec(pathlib.Path(sys.argv[1]))
sys.stdout.buffer.write(canonical_json(compile_plan(loaded.spec, describe("r2b_storage"))))
"""


def test_the_plan_has_the_same_bytes_in_every_place_and_environment(tmp_path: Path) -> None:
    spec = tmp_path / "deep" / "a.r2b.yaml"
    spec.parent.mkdir()
    spec.write_bytes((ROOT / "specs" / "relay.r2b.yaml").read_bytes())
    seen = set()
    for number, (cwd, name) in enumerate([(ROOT, str(spec)), (spec.parent, "a.r2b.yaml")]):
        environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "HOME": str(tmp_path / f"home{number}"),
            "PYTHONHASHSEED": str(number),
            "TZ": ("UTC", "Asia/Tokyo")[number],
        }
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, name],
            cwd=cwd,
            env=environment,
            capture_output=True,
            check=True,
        )
        seen.add(done.stdout)
    assert len(seen) == 1
    assert str(tmp_path).encode() not in seen.pop()


@pytest.mark.parametrize(
    ("content", "code", "says"),
    [
        (b"", "R2B611", "is not JSON"),
        (b"r2bspec: 1\n", "R2B611", "is not JSON"),
        (b"\xff\xfe", "R2B611", "is not JSON"),
        (b"[]", "R2B611", "is not a plan of r2bspec"),
        (b'{"name": "x"}', "R2B611", "is not a plan of r2bspec"),
        (b'{"r2bspec_plan": "1"}', "R2B611", "is not a plan of r2bspec"),
        (b'{"r2bspec_plan": 2, "generator": "r2bspec 9"}', "R2B611", "version 2"),
        (b'{"r2bspec_plan": 1}', "R2B612", "missing required field"),
    ],
)
def test_a_file_that_is_no_plan(content: bytes, code: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_bytes(content)
    with pytest.raises(PlanError) as caught:
        read_plan(path)
    assert caught.value.code == code
    assert caught.value.exit_code == 2
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert caught.value.hint


@pytest.mark.parametrize(
    ("before", "after", "says"),
    [
        ('"warm_up": "1 s"', '"warm_up": 1000000000', "$.warm_up"),
        ('"buffer": 10', '"bufer": 10', "bufer"),
        ("output.latency.p90 <", "output <<", "$.objectives"),
        ('"at": "30 Hz"', '"at": "30"', "no unit"),
        ('"at": "30 Hz"', '"at": 30', "$.objectives"),
        ('"role": "loader"', '"role": "driver"', "$.processes"),
    ],
)
def test_a_plan_with_a_fault_is_refused_with_its_place(before: str, after: str, says: str) -> None:
    broken = canonical_json(plan()).decode().replace(before, after)
    with pytest.raises(PlanError, match=re.escape(says)) as caught:
        parse_plan(broken.encode(), "plan.json")
    assert caught.value.code == "R2B612"


# Two plans, compared.


def test_a_value_that_differs_has_its_path() -> None:
    resize = PREPROCESSED["preprocessors"]["resize"]
    wider = {"resize": {**resize, "parameters": {"width": 1280, "height": 480}}}
    (found,) = diff_plans(plan(), plan(preprocessors=wider))
    place = ("processes", "preprocess.resize", "nodes", "/r2b/resize", "parameters", "width")
    assert found == PlanDifference(place, 640, 1280)
    assert str(found) == (
        "processes['preprocess.resize'].nodes['/r2b/resize'].parameters.width: 640 -> 1280"
    )


@given(st.lists(st.sampled_from("abc"), max_size=4), st.lists(st.sampled_from("abc"), max_size=4))
def test_there_is_a_difference_if_and_only_if_plans_are_unequal(
    before: list[str], after: list[str]
) -> None:
    def with_monitors(names: list[str]) -> Plan:
        monitor = FULL.monitors[0]
        monitors = tuple(msgspec.structs.replace(monitor, name=name) for name in names)
        return msgspec.structs.replace(FULL, monitors=monitors)

    assert bool(diff_plans(with_monitors(before), with_monitors(after))) == (before != after)
