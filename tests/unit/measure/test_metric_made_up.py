"""A metric that is declared appears in every list, table, format and completion by that alone."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from r2bspec.record.run_folder import Run

PROGRAM = '''
"""Declares two metrics, and does what the command line is asked for."""

import sys

from r2bspec.judge.measure.distribution import PARTS
from r2bspec.judge.measure.metric import Scope, metric
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.host_usage import ResourceUse
import r2bspec.judge.measure.metric_declarations


@metric(
    "spacing",
    Scope.MONITOR,
    "time",
    "half the time between consecutive outputs",
    parts=PARTS,
    noun="halves",
    live=True,
    title="spacing",
    columns=("p50",),
    section="latency",
    compared=("p50",),
    range_of=("p50",),
)
def spacing(seen: MonitorSamples):
    """Half the time between two consecutive outputs.

    (t[i+1] - t[i]) / 2
    """
    return seen.interval / 2


@metric(
    "appetite.<process>",
    Scope.PROCESS,
    "share",
    "half the processor time",
    parts=("mean",),
    title="appetite",
    columns=("mean",),
)
def appetite(used: ResourceUse):
    """Half the processor time of a process.

    cpu / 2
    """
    return {"mean": used.cpu_mean / 2}


if sys.argv[1] == "completions":
    from r2bspec.cli.completion import complete_topic

    print(*(each.value for each in complete_topic(None, None, sys.argv[2])), sep="\\n")
else:
    from r2bspec.cli.main import main

    sys.exit(main(sys.argv[1:]))
'''

Asked = Callable[..., str]


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Asked:
    """What the program with the metric prints."""
    program = tmp_path_factory.mktemp("made_up") / "program.py"
    program.write_text(PROGRAM)

    def ask(*arguments: str | Path) -> str:
        command = [sys.executable, str(program), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    return ask


@pytest.fixture(scope="module")
def reports(asked: Asked, usual_run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reports of a run in every form, made by the program with the metric."""
    folder = tmp_path_factory.mktemp("reports")
    names = ("html=html", "csv=csv", "markdown=md", "json=json", "text=txt")
    options = [f"--report={name.replace('=', f'={folder}/report.')}" for name in names]
    asked("report", usual_run.folder, *options)
    return folder


def test_the_result_has_its_values(reports: Path) -> None:
    result = json.loads((reports / "report.json").read_text())
    pooled = result["metrics"]["rates"][0]["pooled"]
    values = pooled["monitors"]["detections"]["values"]
    assert values["spacing"]["n"] == values["interval"]["n"] > 0
    assert values["spacing"]["p50"] == values["interval"]["p50"] / 2
    of_run = pooled["values"]
    assert of_run["appetite.apriltag.mean"] == of_run["cpu.apriltag.mean"] / 2 > 0


def test_csv_has_a_row_for_each_part(reports: Path) -> None:
    rows = csv.DictReader((reports / "report.csv").read_text().splitlines())
    found = {row["metric"]: row["unit"] for row in rows}
    assert {"spacing.mean": "s", "spacing.p50": "s", "spacing.max": "s"}.items() <= found.items()
    assert found["appetite.apriltag.mean"] == "share"


@pytest.mark.parametrize("report", ["txt", "md", "html"])
@pytest.mark.parametrize("column", ["spacing p50", "appetite"])
def test_tables_have_its_column(reports: Path, report: str, column: str) -> None:
    assert column in (reports / f"report.{report}").read_text()


def test_it_is_completed_and_explained(asked: Asked) -> None:
    assert "spacing.p50" in asked("completions", "spac").splitlines()
    assert "Half the processor time of a process." in asked("docs", "appetite.apriltag.mean")
    explained = asked("docs", "spacing.p99")
    assert "Half the time between two consecutive outputs." in explained
    assert "(t[i+1] - t[i]) / 2" in explained
