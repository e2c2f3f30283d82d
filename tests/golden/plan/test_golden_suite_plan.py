"""The plans of specs/suite, byte for byte: their drawings, and the whole plan of the largest one.

With ``R2BSPEC_REWRITE=1`` in the environment the outputs are written instead of compared.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec
import pytest

from r2bspec.bags.recording import BagIndex
from r2bspec.check import check
from r2bspec.datasets.catalogue import describe
from r2bspec.language.load_spec import load_spec
from r2bspec.language.spec import Spec
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.drawing import to_mermaid
from r2bspec.plan.plan import Plan

HERE = Path(__file__).parent / "suite"
SPECS = sorted((Path(__file__).parents[3] / "specs" / "suite").glob("*.r2b.yaml"))
NAMES = [each.name.removesuffix(".r2b.yaml") for each in SPECS]


def plan_of(file: Path) -> Plan:
    loaded = load_spec(file)
    assert loaded.spec is not None
    assert not [each for each in check(loaded) if each.severity in {"error", "warning"}]
    full = compile_plan(loaded.spec, _index(loaded.spec))
    # The version of r2bspec is part of a plan, but not of what is tested here.
    return msgspec.structs.replace(full, generator="r2bspec")


def _index(spec: Spec) -> BagIndex | None:
    dataset = spec.data_loader.bag.dataset
    return describe(dataset) if dataset else None


def compare(path: Path, written: bytes) -> None:
    if os.environ.get("R2BSPEC_REWRITE"):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(written)
    assert written == path.read_bytes()


def test_the_suite_has_its_six_benchmarks() -> None:
    assert NAMES == [
        "apriltag_graph",
        "apriltag_node",
        "disparity_graph",
        "disparity_node",
        "live_graph",
        "rectify_node",
    ]


@pytest.mark.parametrize("file", SPECS, ids=NAMES)
def test_the_drawing_of_a_plan(file: Path) -> None:
    name = file.name.removesuffix(".r2b.yaml")
    compare(HERE / f"{name}.mmd", to_mermaid(plan_of(file)).encode())


def test_the_whole_plan_of_the_largest_one() -> None:
    file = next(each for each in SPECS if each.name.startswith("disparity_graph"))
    compare(HERE / "disparity_graph.json", canonical_json(plan_of(file)))


@pytest.mark.parametrize("file", SPECS, ids=NAMES)
def test_what_is_compared_with_the_truth_is_compared_after_the_measurement(file: Path) -> None:
    plan = plan_of(file)
    truths = [each.truth for each in plan.monitors if each.truth is not None]
    expected = {"disparity": "disparity", "apriltag": "tag"}.get(file.name.split("_")[0])
    assert [each.kind for each in truths] == ([expected] if expected else [])
    assert ("truth" in plan.phases) == bool(truths)
    if truths:
        assert plan.phases.index("play") < plan.phases.index("truth")
