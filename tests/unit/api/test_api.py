"""The importable interface, as far as it needs no ROS."""

from __future__ import annotations

from pathlib import Path

import pytest

import r2bspec

SPECS = Path(__file__).parents[3] / "specs"


def test_a_spec_is_loaded_with_its_variables() -> None:
    spec = r2bspec.load(SPECS / "relay.r2b.yaml", variables={"service_time_ms": 3.0})
    assert spec.name == "relay"
    assert spec.graph.nodes["relay"].parameters["service_time_ms"] == 3.0


def test_a_plan_needs_no_dataset_to_be_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    plan = r2bspec.compile_plan(SPECS / "apriltag_node.r2b.yaml")
    assert [process.role for process in plan.processes][:2] == ["loader", "host"]
    assert not any(tmp_path.iterdir())


def test_an_invalid_spec_is_refused_with_all_its_errors(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.r2b.yaml"
    text = (SPECS / "relay.r2b.yaml").read_text()
    wrong.write_text(text.replace("from: recorded/camera_info", "from: recorded/camera_inf"))
    with pytest.raises(r2bspec.InvalidSpecError, match="is not valid") as caught:
        r2bspec.prepare(wrong)
    assert caught.value.exit_code == 2
    found = [
        diagnostic for diagnostic in caught.value.diagnostics if diagnostic.severity == "error"
    ]
    assert [each.span.line for each in found] == [
        1 + text.splitlines().index(next(line for line in text.splitlines() if "from:" in line))
    ]


def test_validate_never_raises_for_content(tmp_path: Path) -> None:
    broken = tmp_path / "broken.r2b.yaml"
    broken.write_bytes(b"\x00\xff[")
    assert any(each.severity == "error" for each in r2bspec.validate(broken))


def test_a_name_that_is_not_there() -> None:
    with pytest.raises(AttributeError, match="no attribute 'lod'"):
        r2bspec.lod  # noqa: B018
