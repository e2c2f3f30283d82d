"""Which percentiles reports show is written once."""

from __future__ import annotations

import ast
import re
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

OWN_PERCENTILES = {"report/terminal/cost_tables.py"}
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


def test_no_other_module_lists_percentiles() -> None:
    lines = {
        str(module.relative_to(PACKAGE)): list(listed_percentiles(module.read_text()))
        for module in MODULES
    }
    assert {name for name, found in lines.items() if found} == OWN_PERCENTILES, lines


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
