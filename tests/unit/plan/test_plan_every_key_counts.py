"""No key is accepted and ignored: each reaches the plan, and something that runs reads it there."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from types import ModuleType

import msgspec

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

PROSE = re.compile(r'"""[\s\S]*?"""|#.*')
ATTRIBUTE_READ = re.compile(r"(?<=[\w)\]])\.(\w+)(?!\w| = )")

NOT_READ_BY_FIELD = {
    "Plan.r2bspec_plan": "the version of the format: checked before a plan is decoded",
    "Plan.generator": "names the version that compiled a plan file, for its reader",
}


def structs(*modules: ModuleType) -> list[type[msgspec.Struct]]:
    return [
        member
        for module in modules
        for _, member in inspect.getmembers(module, inspect.isclass)
        if issubclass(member, msgspec.Struct) and member.__module__ == module.__name__
    ]


def attributes_read(*, inside: tuple[str, ...] = (), outside: tuple[str, ...] = ()) -> set[str]:
    """The names of all attributes that the packages inside read, or all but those outside."""
    names: set[str] = set()
    for file in PACKAGE.rglob("*.py"):
        package = file.relative_to(PACKAGE).parts[0]
        if package in inside or (outside and package not in outside):
            code = PROSE.sub("", file.read_text(encoding="utf-8"))
            names.update(ATTRIBUTE_READ.findall(code))
    return names


def test_something_outside_the_compiler_reads_every_field_of_a_plan() -> None:
    read = attributes_read(outside=COMPILER)
    unread = {
        f"{struct.__name__}.{name}"
        for struct in structs(plan)
        for name in struct.__struct_fields__
        if not {name, f"{name}_ns"} & read
    }
    assert unread == NOT_READ_BY_FIELD.keys(), "a key that does nothing, or an exception too many"
    assert "drain_timeout_ns" in read
    assert "no_such_field_ns" not in read


def test_the_compiler_reads_every_key_of_the_language() -> None:
    read = attributes_read(inside=("plan",)) | fields_of_whole_structs()
    unread = {
        f"{struct.__name__}.{name}"
        for struct in structs(*LANGUAGE)
        for name in struct.__struct_fields__
        if struct.__name__ not in EVALUATED_WHILE_LOADING and name not in read
    }
    assert unread <= NOT_IN_PLAN.keys()


def fields_of_whole_structs() -> set[str]:
    """The keys of structs of the language that a plan holds as they are, is itself, or inherits."""
    own = [hint for struct in structs(plan) for hint in inspect.get_annotations(struct).values()]
    inherited = [
        hint
        for record in structs(*LANGUAGE)
        if any(issubclass(struct, record) for struct in structs(plan) if struct is not plan.Plan)
        for hint in inspect.get_annotations(record).values()
    ]
    hints = [str(hint) for hint in (*own, *inherited)]
    return {
        name
        for record in structs(*LANGUAGE)
        if issubclass(plan.Plan, record) or any(record.__name__ in hint for hint in hints)
        for name in record.__struct_fields__
    }
