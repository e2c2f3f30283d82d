"""The confidence of decisions is written once."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[3] / "r2bspec"
MODULES = sorted(each for each in PACKAGE.rglob("*.py") if each.name != "confidence.py")


def literal_confidences(source: str) -> Iterator[int]:
    """The lines on which something that is called a confidence has a number for its value."""
    for node in ast.walk(ast.parse(source)):
        given: list[tuple[str, ast.expr | None]] = []
        match node:
            case ast.Assign(targets=[ast.Name(id=name) | ast.Attribute(attr=name)]):
                given = [(name, node.value)]
            case ast.AnnAssign(target=ast.Name(id=name) | ast.Attribute(attr=name)):
                given = [(name, node.value)]
            case ast.keyword(arg=str(name)):
                given = [(name, node.value)]
            case ast.arguments():
                given = _defaults(node)
        for name, value in given:
            if "confidence" in name.lower() and value is not None and _has_fraction(value):
                yield value.lineno


def _defaults(node: ast.arguments) -> list[tuple[str, ast.expr | None]]:
    positional = [*node.posonlyargs, *node.args]
    # Defaults belong to the last of the positional arguments.
    paired = zip(reversed(positional), reversed(node.defaults), strict=False)
    return [(each.arg, value) for each, value in paired] + [
        (each.arg, value) for each, value in zip(node.kwonlyargs, node.kw_defaults, strict=True)
    ]


def _has_fraction(value: ast.expr) -> bool:
    """Whether there is a number in it; 0 stands for a confidence that is not known."""
    return any(
        isinstance(each, ast.Constant) and isinstance(each.value, float) and each.value > 0
        for each in ast.walk(value)
    )


def test_no_module_writes_a_confidence_as_a_number() -> None:
    lines = {
        str(module.relative_to(PACKAGE)): list(literal_confidences(module.read_text()))
        for module in MODULES
    }
    assert {name: found for name, found in lines.items() if found} == {}


@pytest.mark.parametrize(
    "source",
    [
        "CONFIDENCE: Final = 0.95",
        "DEFAULT_CONFIDENCE = 0.95",
        "class A(Struct):\n    confidence: Share = Share(0.95)",
        "def test(n, confidence: float = 0.95): pass",
        "def test(n, *, confidence: float = 0.95): pass",
        "judge(found, confidence=0.95)",
    ],
)
def test_a_number_would_be_found(source: str) -> None:
    assert len(list(literal_confidences(source))) == 1
