"""``--report FORMAT=PATH``: what is asked for is checked first, and appears whole."""

from __future__ import annotations

import importlib.util
import json
import os
import threading
from pathlib import Path
from typing import Any

import pytest

from command_line import Call
from r2bspec.cli.finished_runs import judge_command as judge
from r2bspec.cli.main import main
from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.record.run_folder import Run
from r2bspec.report.format_registry import ReportError, ReportUsageError
from r2bspec.report.write_reports import (
    ReportRequest,
    parse_report_requests,
    takes_stdout,
    write_reports,
)
from report_runs import EMPTY, TWO


@pytest.fixture(name="run")
def run_folder(usual_run: Run) -> Path:
    return usual_run.folder


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["html"], "takes FORMAT=PATH"),
        (["html="], "takes FORMAT=PATH"),
        (["htlm=x"], "unknown report format 'htlm'"),
        (["json=-", "csv=-"], "standard output"),
        (["json=a", "csv=a"], "'a'"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_runs(options: list[str], said: str) -> None:
    with pytest.raises(ReportUsageError, match=said):
        parse_report_requests(options)


def test_a_misspelt_format_gets_a_proposal() -> None:
    with pytest.raises(ReportUsageError) as caught:
        parse_report_requests(["htlm=x"])
    assert "'html'" in caught.value.hint


def test_a_missing_library_is_named_before_anything_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec

    def find(name: str, package: str | None = None) -> Any:
        return None if name == "matplotlib" else found(name, package)

    monkeypatch.setattr(importlib.util, "find_spec", find)
    with pytest.raises(ReportError, match="needs matplotlib") as caught:
        parse_report_requests(["html=x"])
    assert "r2bspec[report]" in caught.value.hint


def test_folders_are_made_and_reports_are_whole(run: Path, tmp_path: Path) -> None:
    target = tmp_path / "deep" / "er" / "result.json"
    junit = tmp_path / "j.xml"
    arguments = ["judge", str(run), "--report", f"json={target}", "--junit-xml", str(junit)]
    assert main(arguments) == json.loads((target).read_text())["verdict"]["exit_code"]
    assert junit.read_text().startswith("<?xml")
    assert not [*tmp_path.rglob("*.tmp")]


def test_a_report_on_standard_output_stands_alone(
    run: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    main(["judge", str(run), "--report", "json=-"])
    assert json.loads(capfdbinary.readouterr().out)["name"] == "simulated"


def test_one_file_for_each_distribution(tmp_path: Path) -> None:
    run = TWO.write(tmp_path / "run")
    reported = ReportInput(result=result_of(run), run=run)
    write_reports(
        [ReportRequest("hdrhistogram", f"{tmp_path}/{{monitor}}@{{rate}}.hgrm")], reported
    )
    assert sorted(path.name for path in tmp_path.glob("*.hgrm")) == [
        "detections@30Hz.hgrm",
        "extra@30Hz.hgrm",
    ]


def test_a_pipe_is_written_to_and_not_replaced(run: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    main(["judge", str(run), "--report", f"csv={pipe}"])
    reader.join(30)
    assert read[0].startswith(b"run_id,")
    assert pipe.is_fifo()


def test_a_folder_is_no_place_for_a_report(run: Path, tmp_path: Path, call: Call) -> None:
    assert "is a folder" in call("judge", run, "--report", f"csv={tmp_path}", status=2).err


def test_an_incomplete_run_has_its_reports_too(tmp_path: Path) -> None:
    run = EMPTY.write(tmp_path / "run").folder
    target = tmp_path / "report.md"
    assert main(["judge", str(run), "--report", f"markdown={target}"]) == 4
    assert "INCOMPLETE" in target.read_text()


def test_nothing_else_goes_where_a_report_goes() -> None:
    assert takes_stdout([ReportRequest("json", "-")])
    assert not takes_stdout([ReportRequest("json", "a")])
    assert {"--report", "--junit-xml"} <= {name for param in judge.params for name in param.opts}
