"""Inputs that once ended in a traceback of r2bspec are answered with a finding or an error."""

from __future__ import annotations

import functools
import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from example_spec import example
from r2bspec.api import prepare
from r2bspec.cli.main import main
from r2bspec.errors import ExitStatus
from r2bspec.plan.canonical_json import PlanError, canonical_json, parse_plan
from r2bspec.record.files import RecordError
from r2bspec.record.run_folder import Run, open_run

SPEC = Path(__file__).parents[3] / "specs" / "relay.r2b.yaml"


@pytest.mark.parametrize("output_format", ["text", "json", "github", "sarif", "junit"])
def test_a_file_name_that_is_not_utf_8(
    output_format: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = os.fsencode(tmp_path) + b"/\xff\xfe.r2b.yaml"
    Path(os.fsdecode(name)).write_text("r2bspec: 3\n")
    status = main(["validate", "--format", output_format, os.fsdecode(name)])
    shown = capsys.readouterr()
    assert status == ExitStatus.FINDINGS_OR_FAILED, shown.err
    if output_format == "sarif":
        place = json.loads(shown.out)["runs"][0]["results"][0]["locations"][0]["physicalLocation"]
        assert place["artifactLocation"]["uri"].endswith("/%FF%FE.r2b.yaml")


@pytest.mark.parametrize("text", [example(), "r2bspec: 3\n"], ids=["valid", "wrong"])
def test_a_file_name_that_is_not_utf_8_hides_no_finding_of_other_files(
    text: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path(os.fsdecode(os.fsencode(tmp_path) + b"/20\xff.r2b.yaml")).write_text(text)
    others = [tmp_path / f"{number}.r2b.yaml" for number in range(10, 50)]
    for file in others:
        file.write_text("1: 2\n")
    status = main(["validate", "--format", "json", str(tmp_path)])
    shown = capsys.readouterr()
    assert (status, shown.err) == (ExitStatus.FINDINGS_OR_FAILED, "")
    named = {finding["file"] for finding in json.loads(shown.out)["findings"]}
    assert named >= {str(file) for file in others}
    assert len(named) == len(others) + (text != example())


def _put(document: Any, place: tuple[str | int, ...], value: object) -> Any:
    inside: Any = document
    for key in place[:-1]:
        inside = inside[key]
    assert place[-1] in inside
    inside[place[-1]] = value
    return document


EXTREME = [10**40, 10**400, -1e308]

PLAN_PLACES: dict[tuple[str | int, ...], list[object]] = {
    ("gate", "confidence"): [-1, 0, 1, 2**63, *EXTREME],
    ("search", "confidence"): [-1, 0, 1, *EXTREME],
    ("play", 0, "iterations"): [-1, 2**63, *EXTREME],
    ("play", 0, "max_iterations"): [-1, *EXTREME],
    ("play", 0, "duration_ns"): [-1, *EXTREME],
    ("play", 0, "rate_hz"): [-1, *EXTREME],
    ("start_timeout",): list(EXTREME),
    ("starts",): [0, -1, 1001, *EXTREME],
}


@pytest.mark.parametrize(
    ("place", "value"),
    [(place, value) for place, values in PLAN_PLACES.items() for value in values],
    ids=lambda each: "-".join(map(str, each)) if isinstance(each, tuple) else str(each)[:20],
)
def test_a_number_that_no_plan_has_is_refused(place: tuple[str | int, ...], value: object) -> None:
    plan = _put(json.loads(_searching_plan()), place, value)
    with pytest.raises(PlanError) as caught:
        parse_plan(json.dumps(plan).encode(), "p.json")
    assert caught.value.code in {"R2B611", "R2B612"}
    assert str(place[-1]) in str(caught.value)


@functools.cache
def _searching_plan() -> bytes:
    spec = SPEC.with_name("apriltag_node.r2b.yaml")
    return canonical_json(prepare(spec).plan)


@pytest.mark.parametrize("value", EXTREME, ids=lambda each: str(each)[:20])
@pytest.mark.parametrize(
    "place",
    [
        ("segments", 0, "began_ns"),
        ("segments", 0, "monitor_held_ns"),
        ("search", "confidence"),
        ("machine", "cores"),
    ],
)
def test_a_number_that_no_record_has_is_refused(
    place: tuple[str | int, ...], value: object, usual_run: Run, tmp_path: Path
) -> None:
    for name in ("plan.json", "spec.yaml"):
        shutil.copy(usual_run.folder / name, tmp_path)
    record = json.loads((usual_run.folder / "record.json").read_text())
    (tmp_path / "record.json").write_text(json.dumps(_put(record, place, value)))
    with pytest.raises(RecordError, match="is damaged"):
        open_run(tmp_path)
