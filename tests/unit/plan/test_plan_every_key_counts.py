"""No key is accepted and ignored: each reaches the plan, and something that runs reads it there."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import msgspec
import pytest

from r2bspec.language import spec, spec_benchmark, spec_graph
from r2bspec.plan import plan

PACKAGE = Path(__file__).parents[3] / "r2bspec"
COMPILER = ("language", "plan")
"""What only hands a field on. To be read here is not to be used."""

LANGUAGE = (spec, spec_benchmark, spec_graph)

NOT_IN_PLAN = {
    "Spec.r2bspec": "the version of the language: read before there is a plan",
    "DataLoader.bag": "read through DataLoader.sources",
    "DataLoader.bags": "read through DataLoader.sources",
    **{
        f"GateBase.{name}": "how the base is built: read by the merge gate, of the base's spec"
        for name in spec_benchmark.GateBase.__struct_fields__
    },
    "Gate.base": "read by the merge gate",
}
EVALUATED_WHILE_LOADING = ("Matrix", "VariableDeclaration", "RateRange")
"""Records that a `Spec` does not have: they become cases, values and rates."""

NOT_READ_BY_FIELD = {
    "Plan.r2bspec_plan": "the version of the format: checked before a plan is decoded",
    "Plan.generator": "names the version that compiled a plan file, for its reader",
}


def structs(module: ModuleType) -> list[type[msgspec.Struct]]:
    return [
        each
        for _, each in inspect.getmembers(module, inspect.isclass)
        if issubclass(each, msgspec.Struct) and each.__module__ == module.__name__
    ]


def fields(*of: ModuleType) -> list[tuple[str, str]]:
    return [
        (each.__name__, name)
        for module in of
        for each in structs(module)
        for name in each.__struct_fields__
    ]


@cache
def attributes_read(package: str) -> frozenset[str]:
    """The names of all attributes that the modules of a package read."""
    return frozenset(
        node.attr
        for file in modules(package)
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load)
    )


def modules(package: str) -> Iterator[Path]:
    path = PACKAGE / package
    return path.rglob("*.py") if path.is_dir() else iter([path.with_suffix(".py")])


def packages() -> list[str]:
    found = {each.stem for each in PACKAGE.iterdir() if each.suffix == ".py" or each.is_dir()}
    return sorted(found - {"__pycache__", "py"})


@pytest.mark.parametrize(("struct", "field"), fields(plan))
def test_something_outside_the_compiler_reads_every_field_of_a_plan(
    struct: str, field: str
) -> None:
    readers = [
        each
        for each in packages()
        if each not in COMPILER and {field, f"{field}_ns"} & attributes_read(each)
    ]
    if f"{struct}.{field}" in NOT_READ_BY_FIELD:
        assert not readers, "take it from the exceptions"
    else:
        assert readers, f"nothing that runs reads {struct}.{field}: the key does nothing"


@pytest.mark.parametrize(("struct", "field"), fields(*LANGUAGE))
def test_the_compiler_reads_every_key_of_the_language(struct: str, field: str) -> None:
    read = attributes_read("plan") | attributes_read("wiring")
    if f"{struct}.{field}" in NOT_IN_PLAN or struct in EVALUATED_WHILE_LOADING:
        return
    assert field in read or field in whole_structs(), f"{struct}.{field} reaches no plan"


@cache
def whole_structs() -> frozenset[str]:
    """The keys of structs of the language that a plan holds as they are, or is itself."""
    held = {
        record
        for module in LANGUAGE
        for record in structs(module)
        if issubclass(plan.Plan, record)
        or any(record.__name__ in hint for struct in structs(plan) for hint in field_types(struct))
    }
    return frozenset(name for record in held for name in record.__struct_fields__)


def field_types(struct: type[msgspec.Struct]) -> list[str]:
    return [str(each) for each in inspect.get_annotations(struct).values()]


def test_a_field_that_nothing_reads_is_found() -> None:
    assert "drain_timeout_ns" in attributes_read("execute")
    assert "no_such_field_ns" not in attributes_read("execute")
