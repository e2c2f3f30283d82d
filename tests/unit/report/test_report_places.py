"""Annotations point at the lines that state what failed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.report.pipelines import render_github as render
from report_runs import USUAL
from run_simulation import objective

SPEC = """\
r2bspec: 1
name: simulated
variables: {rate: 30 Hz}
slos:
  camera:
    at: $(var rate)
    require:
      - latency.p99 < 60 ms
      - drop_rate <= 1 %
"""


Annotated = Callable[[Path | None], list[str]]


@pytest.fixture
def annotated(reported: Callable[[str], ReportInput]) -> Annotated:
    """The annotations of the usual run, whose spec is a file, or unknown."""
    return lambda spec: render(replace(reported("usual"), spec_file=spec)).decode().splitlines()


@pytest.mark.parametrize("content", [None, "", "a: [", "r2bspec: 1\nslos: {camera: {at: 3}}"])
def test_without_a_line_there_is_still_an_annotation(
    tmp_path: Path, annotated: Annotated, content: str | None
) -> None:
    spec = tmp_path / "a.r2b.yaml"
    if content is not None:
        spec.write_text(content)
    found = annotated(spec if content is not None else None)
    assert any("drop_rate <= 1 %25" in each and each.startswith("::error ") for each in found)


def test_ten_annotations_at_most(tmp_path: Path) -> None:
    many = replace(USUAL, objectives={"a": objective(*["latency.p50 < 1 ms"] * 30)})
    run = many.write(tmp_path / "run")
    found = render(ReportInput(result=result_of(run), run=run)).decode().splitlines()
    assert sum(each.startswith("::") for each in found) == 10
    assert found[-1].startswith("21 more requirements")


def test_a_file_below_this_folder_is_named_from_here(
    tmp_path: Path, annotated: Annotated, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = tmp_path / "specs" / "a.r2b.yaml"
    spec.parent.mkdir()
    spec.write_text(SPEC)
    assert all("file=specs/a.r2b.yaml," in each for each in annotated(spec) if each[:2] == "::")
