"""The label of a monitor is what reports call it; its name stays the key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.report.format_registry import renderer
from report_runs import USUAL

LABEL = "Tag detections"


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> ReportInput:
    run = USUAL.write(Path(tmp_path_factory.mktemp("labels")) / "run")
    result = result_of(run)
    (name,) = result.metrics.rates[0].pooled.monitors
    return ReportInput(msgspec.structs.replace(result, monitor_labels={name: LABEL}), run)


@pytest.mark.parametrize("format_name", ["text", "markdown", "html"])
def test_what_people_read_shows_label_and_name(source: ReportInput, format_name: str) -> None:
    (name,) = source.result.metrics.rates[0].pooled.monitors
    assert f"{LABEL} ({name})" in renderer(format_name)(source).decode()


@pytest.mark.parametrize("format_name", ["csv", "openmetrics", "bencher"])
def test_what_programs_read_keeps_the_name(source: ReportInput, format_name: str) -> None:
    (name,) = source.result.metrics.rates[0].pooled.monitors
    content = renderer(format_name)(source).decode()
    assert name in content
    assert LABEL not in content


def test_a_monitor_without_a_label_is_called_by_its_name(source: ReportInput) -> None:
    assert source.result.monitor_title("other") == "other"


def test_the_label_of_the_plan_is_in_the_result(tmp_path: Path) -> None:
    run = USUAL.write(tmp_path / "run")
    (monitor,) = run.plan.monitors
    labelled = msgspec.structs.replace(
        run.plan, monitors=(msgspec.structs.replace(monitor, label=LABEL),)
    )
    assert result_of(run).monitor_labels == {}
    assert result_of(replace(run, plan=labelled)).monitor_labels == {monitor.name: LABEL}
