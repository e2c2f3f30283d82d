"""A run that ends before anything is measured says why in the reports that pipelines show."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from example_spec import example
from r2bspec.cli.main import main
from r2bspec.errors import UsageError
from r2bspec.report.write_reports import ReportRequest, write_failure_reports

FORMATS = ("markdown", "github", "junit", "html", "json")


def test_findings_are_in_the_reports_of_a_spec_that_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("spec.r2b.yaml").write_text(example() + "nonsense: 1\n")
    reports = [f"--report={name}=out/{name}" for name in FORMATS]
    assert main(["run", "spec.r2b.yaml", "--output", "run", *reports]) == 2
    assert {path.name for path in Path("out").iterdir()} == set(FORMATS)
    markdown = Path("out/markdown").read_text()
    assert markdown.startswith("### ✘ error R2B602: nothing was measured\n\n    spec.r2b.yaml:")
    assert "unknown-key" in markdown
    assert "::error file=spec.r2b.yaml,line=" in Path("out/github").read_text()
    assert "R2B101" in Path("out/junit").read_text()
    assert "R2B602" in Path("out/html").read_text()
    assert json.loads(Path("out/json").read_text())["code"] == "R2B602"
    assert not Path("run").exists()


def test_an_error_without_findings_is_one_at_the_spec(tmp_path: Path) -> None:
    requests = [ReportRequest(name, str(tmp_path / name)) for name in FORMATS]
    error = UsageError("no\n```\n<b>base</b>\n::error::x", hint="Fetch it.")
    write_failure_reports(requests, error, Path("bench/a.r2b.yaml"))
    lines = (tmp_path / "markdown").read_text().splitlines()[2:]
    # Nothing in the text ends the block.
    assert all(line.startswith("    ") for line in lines)
    (command,) = (tmp_path / "github").read_text().splitlines()
    assert command.startswith("::error file=bench/a.r2b.yaml,line=1")
    assert "Fetch it." in command
