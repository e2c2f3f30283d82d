"""Which percentiles reports show is written once: another one is a change of one file."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from r2bspec.measure import distribution_parts
from r2bspec.measure.distribution_parts import (
    HISTORY_PARTS,
    MAIN_PERCENTILES,
    PARTS,
    PERCENTILES,
    SHORT_PERCENTILES,
    TAIL_PERCENTILE,
)

ROOT = Path(__file__).parents[3]
PACKAGE = ROOT / "r2bspec"
SOURCE = Path(distribution_parts.__file__)
MODULES = sorted(each for each in PACKAGE.rglob("*.py") if each != SOURCE)

OWN_PERCENTILES = {PACKAGE / "report/terminal/cost_tables.py"}
"""The overhead of the harness is summed up by the harness itself, by two percentiles."""

_NAME = re.compile(r"(?:\w+[.-])?p\d{1,2}(?:_\d+)?")


def listed_percentiles(source: str) -> Iterator[int]:
    """The lines on which several percentiles are listed."""
    for node in ast.walk(ast.parse(source)):
        names: list[object] = []
        match node:
            case ast.Tuple() | ast.List() | ast.Set():
                names = [getattr(each, "value", None) for each in node.elts]
            case ast.Dict():
                names = [getattr(each, "value", None) for each in node.keys]
            case ast.Call():
                names = [each.arg for each in node.keywords]
        if isinstance(node, ast.expr) and sum(map(_is_name, names)) > 1:
            yield node.lineno


def _is_name(text: object) -> bool:
    return isinstance(text, str) and _NAME.fullmatch(text) is not None


@pytest.mark.parametrize("module", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_other_module_lists_percentiles(module: Path) -> None:
    assert bool(list(listed_percentiles(module.read_text()))) == (module in OWN_PERCENTILES)


@pytest.mark.parametrize("template", sorted(PACKAGE.rglob("*.j2")), ids=lambda path: path.name)
def test_no_template_names_a_percentile(template: Path) -> None:
    assert re.findall(r"\bp\d\d\b", template.read_text()) == []


@pytest.mark.parametrize(
    "source",
    [
        'SHOWN = ("p50", "p99")',
        'SHOWN = ["mean", "latency.p50", "latency.p99_9"]',
        'SLUGS = {"latency-p50": 1, "latency-p90": 2}',
        "Distribution(p50=percentile(times, 0.5), p90=percentile(times, 0.9))",
    ],
)
def test_a_list_would_be_found(source: str) -> None:
    assert list(listed_percentiles(source))


def test_the_lists_fit_together() -> None:
    assert PARTS == ("min", "mean", "p50", "p90", "p95", "p99", "p99_9", "max")
    assert PERCENTILES == {"p50": 0.5, "p90": 0.9, "p95": 0.95, "p99": 0.99, "p99_9": 0.999}
    assert set(SHORT_PERCENTILES) < set(MAIN_PERCENTILES) < set(PERCENTILES)
    assert TAIL_PERCENTILE in SHORT_PERCENTILES
    assert set(HISTORY_PARTS) < set(PARTS)


REPORTS = ("text", "markdown", "html", "csv", "openmetrics", "bencher", "benchmark_smaller")

EDITED = """
import importlib.util, sys
from pathlib import Path

source = Path(sys.argv[1]).read_text()
for old, new in (
    ("    p90: float | None\\n", "    p90: float | None\\n    p75: float | None = None\\n"),
    ('MAIN_PERCENTILES: Final = ("p50", ', 'MAIN_PERCENTILES: Final = ("p50", "p75", '),
):
    assert source.count(old) == 1, old
    source = source.replace(old, new)
edited = Path(sys.argv[2], "distribution_parts.py")
edited.write_text(source)
import r2bspec.measure
name = "r2bspec.measure.distribution_parts"
spec = importlib.util.spec_from_file_location(name, edited)
sys.modules[name] = module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)

from r2bspec.compare.report_input import Reported
from r2bspec.judge.judge_run import result_of
from r2bspec.report.format_registry import renderer
from report_runs import USUAL

run = USUAL.write(Path(sys.argv[2], "run"))
reported = Reported(result=result_of(run), run=run)
for name in sys.argv[3:]:
    Path(sys.argv[2], name).write_bytes(renderer(name)(reported))
"""


def test_an_edit_of_one_file_shows_another_percentile_everywhere(tmp_path: Path) -> None:
    code = [sys.executable, "-c", EDITED, str(SOURCE), str(tmp_path), *REPORTS]
    support = str(ROOT / "tests" / "support")
    subprocess.run(code, check=True, env={"PYTHONPATH": support, "PATH": "/usr/bin:/bin"})
    shown = {name: (tmp_path / name).read_text() for name in REPORTS}
    assert {name for name, text in shown.items() if "p75" in text} == set(REPORTS) - {"openmetrics"}
    assert 'quantile="0.75"' in shown["openmetrics"]
    # In ascending order, wherever it was written.
    assert re.search(r"p50\s+p75\s+p90", shown["text"])
