"""The verbs ``report``, ``compare`` and ``import``, and the reports of ``run``, as a user asks."""

from __future__ import annotations

import csv
import io
import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import numpy as np
import pytest

from r2bspec import api
from r2bspec.cli.finished_runs import compare_command as compare
from r2bspec.cli.finished_runs import report_command as report
from r2bspec.cli.import_ import command as import_
from r2bspec.cli.run import command as run_verb
from r2bspec.compare.errors import IncomparableError, UnreadableResultError
from r2bspec.compare.report_input import ReportInput
from r2bspec.errors import R2bspecError
from r2bspec.report.errors import ReportUsageError
from report_runs import EMPTY, USUAL
from run_simulation import Played


def call(command: click.Command, *arguments: object) -> int:
    status: int = command.main([str(each) for each in arguments], standalone_mode=False)
    return status


@pytest.fixture(name="run")
def run_folder(reported: Callable[[str], ReportInput]) -> Path:
    run = reported("usual").run
    assert run is not None
    return run.folder


def test_the_formats_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(report, "--formats") == 0
    out = capsys.readouterr().out
    assert out.startswith("json ")
    assert "hdrhistogram " in out


def test_a_report_of_a_folder_and_of_a_result(run: Path, tmp_path: Path) -> None:
    assert call(report, run, "--report", f"json={tmp_path}/result.json") == 0
    assert call(report, tmp_path / "result.json", "--report", f"csv={tmp_path}/a.csv") == 0
    assert (tmp_path / "a.csv").read_bytes().startswith(b"run_id,")


def test_no_report_is_a_mistake(run: Path) -> None:
    with pytest.raises(ReportUsageError, match="no report"):
        call(report, run)


@pytest.mark.parametrize("content", [None, "", "{}", "[]"])
def test_what_is_no_result_is_said(tmp_path: Path, content: str | None) -> None:
    path = tmp_path / "result.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(UnreadableResultError):
        call(report, path, "--report", "json=-")


def test_compare_prints_and_does_not_gate(run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for form in ("text", "markdown", "json"):
        assert call(compare, run, run, run, "--format", form, "--margin", "3 %") == 0
    out = capfd.readouterr().out
    assert out.count("= same") > 10


def test_compare_has_other_formats(
    run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    slower = replace(USUAL, segments=[Played(30, np.linspace(0.2, 0.25, 300))] * 3)
    other = slower.write(tmp_path / "<slower>").folder
    found = {}
    for form in ("csv", "html", "github", "json"):
        assert call(compare, run, other, run, "--force", "--format", form) == 0
        found[form] = capfd.readouterr().out
    lines = [line for one in json.loads(found["json"]) for line in one["lines"]]
    rows = list(csv.DictReader(io.StringIO(found["csv"])))
    assert [row["outcome"] for row in rows] == [line["outcome"] for line in lines]
    assert [row["ratio"] for row in rows] == [
        "" if line["ratio"] is None else repr(line["ratio"]) for line in lines
    ]
    assert {"worse", "same"} <= {row["outcome"] for row in rows}
    html = found["html"]
    assert html.count("<tr class=") == len(lines)
    assert "<slower>" not in html
    assert "<script" not in html
    body = html.partition("<main>")[2].partition("</main>")[0]
    ET.fromstring(f"<m>{body}</m>")  # noqa: S314 - our own
    assert found["github"].count("::warning") >= 2
    assert "latency.p50 at 30 Hz: worse" in found["github"].replace("%3A", ":")


def test_compare_refuses_with_a_way_out(run: Path, tmp_path: Path) -> None:
    other = EMPTY.write(tmp_path / "other").folder
    with pytest.raises(IncomparableError) as caught:
        call(compare, run, other)
    assert caught.value.hint


def test_import_shows_and_keeps(
    run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path, kept = tmp_path / "reference.json", tmp_path / "kept.json"
    assert call(report, run, "--report", f"ros2_benchmark={path}") == 0
    assert call(import_, path) == 0
    assert "30 Hz" in capfd.readouterr().out
    assert call(import_, path, "-o", kept) == 0
    assert call(import_, kept, "--format", "json") == 0
    assert json.loads(capfd.readouterr().out) == json.loads(kept.read_text())
    assert call(compare, kept, run, "--force") == 0


def test_a_run_that_fails_still_has_its_reports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_prepared: Any, folder: Path, _progress: Any, **_ways: Any) -> None:
        EMPTY.write(folder)
        raise R2bspecError("a process died")

    prepared = SimpleNamespace(loaded=None, plan=EMPTY.plan())
    monkeypatch.setattr(api, "prepare", lambda *_, **__: prepared)
    monkeypatch.setattr(api, "run", fail)
    target = tmp_path / "junit.xml"
    with pytest.raises(R2bspecError, match="a process died"):
        call(run_verb, "a.r2b.yaml", "-o", tmp_path / "run", "--quiet", "--junit-xml", target)
    assert 'errors="1"' in target.read_text()
