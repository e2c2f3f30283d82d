"""Specs with mistakes in them, and what is said about them, word for word.

``CODE.out`` is what a user sees of the failing example on the page of that code. ``NAME.yaml`` is a
case with several mistakes, or with one that many rules could trip over, beside its ``NAME.out``.
``companions/NAME.r2b.yaml`` names other files of that folder.
With ``R2BSPEC_REWRITE=1`` in the environment the outputs are written instead of compared; look at
the difference before you commit it.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from golden import compare
from r2bspec.check import check
from r2bspec.check.engine import all_rules
from r2bspec.diagnostics.code_pages import Page
from r2bspec.language.load_spec import load_spec
from r2bspec.report.findings_text import render_text

HERE = Path(__file__).parent
WITH_EXAMPLES = [rule.page for rule in all_rules() if rule.page.failing]
CASES = sorted(HERE.glob("*.yaml"))
WITH_FILES = sorted(HERE.glob("*/*.r2b.yaml"))


@pytest.fixture(autouse=True)
def somewhere_without_ros(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """An empty folder, two CPUs, no ROS packages, no datasets, and shell as the only program."""
    shell = tmp_path / "bin" / "sh"
    shell.parent.mkdir()
    shell.touch(mode=0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(shell.parent))
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.delenv("R2B_DATASETS", raising=False)


def said_about(document: str, name: str) -> str:
    loaded = load_spec(document, file=name, environ={})
    return render_text(check(loaded), loaded.texts)


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=lambda page: page.code)
def test_the_failing_example_of_a_rule(page: Page) -> None:
    compare(said_about(page.failing, f"{page.code}.yaml"), HERE / f"{page.code}.out")
    codes = {each.code for each in check(load_spec(page.failing, environ={}))}
    assert codes == {page.code}, "an example shows one thing"


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=lambda page: page.code)
def test_nothing_is_said_about_the_passing_example_of_a_rule(page: Page) -> None:
    assert said_about(page.passing, "passing.yaml") == ""


@pytest.mark.parametrize("file", CASES, ids=lambda file: file.stem)
def test_a_case(file: Path) -> None:
    said = said_about(file.read_text(encoding="utf-8"), file.name)
    compare(said, file.with_suffix(".out"))


@pytest.mark.parametrize("file", WITH_FILES, ids=lambda file: file.name.partition(".")[0])
def test_a_case_with_other_files(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(file.parent)
    loaded = load_spec(Path(file.name), environ={})
    compare(render_text(check(loaded), loaded.texts), file.with_suffix("").with_suffix(".out"))
