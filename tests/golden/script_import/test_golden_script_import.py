"""Scripts in the style of ros2_benchmark, the specs made from them, and their plans.

Each script has three outputs: ``NAME.r2b.yaml`` is the spec, ``NAME.out`` what was not imported, or
in another way, and the mistakes of the script, and ``NAME.mmd`` the plan as a diagram. With
``R2BSPEC_REWRITE=1`` in the environment they are written instead of compared.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from golden import compare
from r2bspec.check import check
from r2bspec.datasets.catalogue import SEQUENCES, describe
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.interop.script_import.benchmark_script import read_benchmark_script
from r2bspec.interop.script_import.script_mistakes import find_mistakes
from r2bspec.interop.script_import.spec_builder import build_spec
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.drawing import to_mermaid
from r2bspec.report.findings_text import render_text

HERE = Path(__file__).parent / "scripts"
SCRIPTS = sorted(HERE.glob("*.py"))
ENVIRON = {"CELL_CAMERA": "/dev/video0"}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda each: each.stem)
def test_a_script(script: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(HERE)
    read = read_benchmark_script(Path(script.name))
    made = build_spec(read, Path())
    said = render_text(made.findings, made.sources) + "\n\nMistakes\n\n"
    said += render_text(find_mistakes(read), made.sources)
    compare(said.replace(f"{HERE}/", "") + "\n", script.with_suffix(".out"))
    compare(made.text, script.with_suffix(".r2b.yaml"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda each: each.stem)
def test_its_spec_and_plan(script: Path) -> None:
    loaded = load_spec(script.with_suffix(".r2b.yaml"), environ=ENVIRON)
    assert loaded.spec is not None
    errors = [each for each in check(loaded) if each.severity == "error"]
    assert [(each.code, each.message) for each in errors] == []
    dataset = loaded.spec.data_loader.bag.dataset
    index = describe(dataset) if dataset in SEQUENCES else None
    compare(to_mermaid(compile_plan(loaded.spec, index)), script.with_suffix(".mmd"))


def test_the_corpus_has_every_mistake() -> None:
    found = {one.code for each in SCRIPTS for one in find_mistakes(read_benchmark_script(each))}
    assert found == {code for code in all_pages() if "R2B720" <= code < "R2B800"}
