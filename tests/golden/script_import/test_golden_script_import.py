"""Scripts in the style of ros2_benchmark, and the specs made from them.

Each script has two outputs: ``NAME.r2b.yaml`` is the spec, ``NAME.out`` what was not imported, or
in another way. With ``R2BSPEC_REWRITE=1`` in the environment they are written instead of compared.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from golden import compare
from r2bspec.check import check
from r2bspec.interop.script_spec import import_script
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.report.findings_text import render_text

HERE = Path(__file__).parent / "scripts"


@pytest.mark.parametrize("script", sorted(HERE.glob("*.py")), ids=lambda each: each.stem)
def test_a_script(script: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(HERE)
    made = import_script(Path(script.name), Path())
    said = render_text(made.findings, made.sources)
    compare(said.replace(f"{HERE}/", "") + "\n", script.with_suffix(".out"))
    compare(made.text, script.with_suffix(".r2b.yaml"))
    loaded = load_spec(script.with_suffix(".r2b.yaml"))
    assert [each.message for each in check(loaded) if each.severity == "error"] == []
    assert loaded.spec is not None
    compile_plan(loaded.spec, None)
