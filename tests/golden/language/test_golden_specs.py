"""Broken specs and what is said about them, word for word.

Each ``NAME.yaml`` stands beside ``NAME.out``, the text that a user sees. With
``R2BSPEC_REWRITE=1`` in the environment the outputs are written instead of compared; look at
the difference before you commit it.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from golden import compare
from r2bspec.language.load_spec import load_cases, load_spec
from r2bspec.language.matrix import merge_case_findings
from r2bspec.report.findings_text import render_text

HERE = Path(__file__).parent
OK = ("ok_minimal", "ok_full", "ok_everything", "ok_live", "yaml_bom")
ENVIRON = {"HOME": "/home/someone", "R2B_TEST_DATA": "/data", "R2B_TEST_COUNT": "7"}


@pytest.mark.parametrize("file", sorted(HERE.glob("*.yaml")), ids=lambda file: file.stem)
def test_what_is_said(file: Path) -> None:
    loaded = load_spec(file.read_bytes(), file=file.name, environ=ENVIRON)
    said = render_text(loaded.diagnostics, loaded.texts)
    compare(said, file.with_suffix(".out"))
    has_errors = any(found.severity == "error" for found in loaded.diagnostics)
    assert (loaded.spec is None) == has_errors
    assert has_errors or file.stem in OK


@pytest.mark.parametrize(
    "file", sorted((HERE / "extending").glob("*.r2b.yaml")), ids=lambda file: file.stem
)
def test_what_is_said_of_files_that_build_on_files(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(file.parent)
    cases = load_cases(Path(file.name), environ=ENVIRON)
    found = merge_case_findings(cases, [case.diagnostics for case in cases])
    said = render_text(found, cases[0].texts)
    compare(said, file.with_suffix("").with_suffix(".out"))
    assert (said == "") == file.name.startswith("ok_")
