"""SARIF: valid by the standard, and what code scanning needs is in it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

import sarif_log
from r2bspec.check import check
from r2bspec.diagnostics import Certainty, Diagnostic, Edit, Related, Severity, Span
from r2bspec.language.load_spec import load_spec
from r2bspec.report.finding_formats import render

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


def log_of(*found: Diagnostic, names: tuple[str, ...] = ()) -> dict[str, Any]:
    """The log; it is as the standard demands."""
    text = render("sarif", found, {}, names)
    sarif_log.decode(text)
    log: dict[str, Any] = json.loads(text)
    return log


@pytest.mark.parametrize("file", BROKEN, ids=lambda file: f"{file.parent.name}/{file.stem}")
def test_valid_by_the_standard(file: Path) -> None:
    loaded = load_spec(file.read_bytes(), file=file.name, environ={})
    found = check(loaded, offline=True)
    assert len(log_of(*found, names=(file.name,))["runs"][0]["results"]) == len(found)


@pytest.mark.parametrize(
    ("pointer", "value"),
    [
        ("version", "2.0.0"),
        ("runs/0/columnKind", "bytes"),
        ("runs/0/tool/driver/semanticVersion", 1),
        ("runs/0/tool/driver/rules/0/id", "R2B100"),
        ("runs/0/results/0/level", "info"),
        ("runs/0/results/0/message", "text"),
        ("runs/0/results/0/severity", "error"),
        ("runs/0/results/0/locations/0/physicalLocation/region/startLine", 0),
        ("runs/0/results/0/locations/0/physicalLocation/artifactLocation/uri", "a b.yaml"),
        ("runs/0/results/0/fixes/0/artifactChanges", []),
        ("runs/0/artifacts", [{"location": {"uri": "a"}}] * 2),
    ],
)
def test_what_the_standard_forbids_is_seen(pointer: str, value: object) -> None:
    log = log_of(FOUND)
    *path, key = pointer.split("/")
    target: Any = log
    for step in path:
        target = target[int(step) if isinstance(target, list) else step]
    target[key] = value
    with pytest.raises(msgspec.ValidationError):
        sarif_log.decode(json.dumps(log))


def test_nothing_found_is_a_run_without_results() -> None:
    log = log_of(names=("a.yaml",))
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
