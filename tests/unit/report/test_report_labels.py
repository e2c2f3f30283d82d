"""The label of a monitor is what reports call it; its name stays the key."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import msgspec
import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.report.format_registry import renderer

LABEL = "Tag detections"


@pytest.fixture
def source(reported: Callable[[str], ReportInput]) -> ReportInput:
    """The usual run, whose monitor ``detections`` has a label."""
    usual = reported("usual")
    labels = {"detections": LABEL}
    return replace(usual, result=msgspec.structs.replace(usual.result, monitor_labels=labels))


@pytest.mark.parametrize("format_name", ["text", "markdown", "html"])
def test_what_people_read_shows_label_and_name(source: ReportInput, format_name: str) -> None:
    assert f"{LABEL} (detections)" in renderer(format_name)(replace(source, run=None)).decode()


@pytest.mark.parametrize("format_name", ["csv", "openmetrics", "bencher"])
def test_what_programs_read_keeps_the_name(source: ReportInput, format_name: str) -> None:
    content = renderer(format_name)(source).decode()
    assert "detections" in content
    assert LABEL not in content


def test_the_label_of_the_plan_is_in_the_result(source: ReportInput) -> None:
    assert source.result.monitor_title("other") == "other"
    run = source.run
    assert run is not None
    (monitor,) = run.plan.monitors
    labelled = msgspec.structs.replace(
        run.plan, monitors=(msgspec.structs.replace(monitor, label=LABEL),)
    )
    assert result_of(run).monitor_labels == {}
    assert result_of(replace(run, plan=labelled)).monitor_labels == {monitor.name: LABEL}
