"""The verbs ``report``, ``compare`` and ``import``, and the reports of ``run``, as a user asks."""

from __future__ import annotations

import csv
import io
import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from command_line import Call
from r2bspec import api
from r2bspec.errors import R2bspecError
from r2bspec.record.run_folder import Run
from report_runs import EMPTY, USUAL
from run_simulation import Played


@pytest.fixture(name="run")
def run_folder(usual_run: Run) -> Path:
    return usual_run.folder


def test_the_formats_are_listed(call: Call) -> None:
    out = call("report", "--formats", status=0).out
    assert out.startswith("json ")
    assert "hdrhistogram " in out


def test_a_report_of_a_folder_and_of_a_result(run: Path, tmp_path: Path, call: Call) -> None:
    kept = tmp_path / "result.json"
    call("report", run, "--report", f"json={kept}", status=0)
    assert call("report", kept, "--report", "csv=-", status=0).out.startswith("run_id,")


def test_no_report_is_a_mistake(run: Path, call: Call) -> None:
    assert "no report" in call("report", run, status=2).err


@pytest.mark.parametrize("content", [None, "", "{}", "[]"])
def test_what_is_no_result_is_said(tmp_path: Path, content: str | None, call: Call) -> None:
    path = tmp_path / "result.json"
    if content is not None:
        path.write_text(content)
    assert "result.json" in call("report", path, "--report", "json=-", status=2).err


def test_compare_prints_and_does_not_gate(run: Path, call: Call) -> None:
    for form in ("text", "markdown", "json"):
        out = call("compare", run, run, run, "--format", form, "--margin", "3 %", status=0).out
        assert out.count("same") > 10


def test_compare_has_other_formats(run: Path, tmp_path: Path, call: Call) -> None:
    slower = replace(USUAL, segments=[Played(30, np.linspace(0.2, 0.25, 300))] * 3)
    other = slower.write(tmp_path / "<slower>").folder
    found = {
        form: call("compare", run, other, run, "--force", "--format", form, status=0).out
        for form in ("csv", "html", "github", "json")
    }
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


def test_compare_refuses_with_a_way_out(run: Path, tmp_path: Path, call: Call) -> None:
    said = call("compare", run, EMPTY.write(tmp_path / "other").folder, status=2).err
    assert "  help: " in said


def test_import_shows_and_keeps(run: Path, tmp_path: Path, call: Call) -> None:
    path, kept = tmp_path / "reference.json", tmp_path / "kept.json"
    call("report", run, "--report", f"ros2_benchmark={path}", status=0)
    assert "30 Hz" in call("import", path, status=0).out
    call("import", path, "-o", kept, status=0)
    shown = call("import", kept, "--format", "json", status=0).out
    assert json.loads(shown) == json.loads(kept.read_text())
    call("compare", kept, run, "--force", status=0)


def test_a_run_that_fails_still_has_its_reports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    def fail(_prepared: Any, folder: Path, _progress: Any, **_ways: Any) -> None:
        EMPTY.write(folder)
        raise R2bspecError("a process died")

    prepared = SimpleNamespace(loaded=None, plan=EMPTY.plan())
    monkeypatch.setattr(api, "prepare", lambda *_, **__: prepared)
    monkeypatch.setattr(api, "run", fail)
    target = tmp_path / "junit.xml"
    options = ("-o", tmp_path / "run", "--quiet", "--junit-xml", target)
    assert "a process died" in call("run", "a.r2b.yaml", *options, status=4).err
    assert 'errors="1"' in target.read_text()
