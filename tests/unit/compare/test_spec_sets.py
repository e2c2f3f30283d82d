"""Sets of specs: which belong together, and which are gone."""

from __future__ import annotations

import pytest

from compared_gates import DOCUMENT, with_value
from r2bspec.compare.gate_strength import check_allowed, weakening_diagnostics
from r2bspec.compare.spec_sets import SpecName, missing_specs, spec_name
from r2bspec.language.load_spec import load_cases
from r2bspec.language.yaml_document import to_yaml

MATRIX = SpecName("relay", ("x=1", "x=2"))


@pytest.mark.parametrize(
    ("base", "head", "missing"),
    [
        ({"a": "a", "gone": "gone"}, {"a": "other", "new": "new"}, ["spec gone"]),
        ({"bench/moved": "moved"}, {"new/moved": "moved"}, []),
        # A spec that stays at its path is the base of no copy, and one is the base of one.
        ({"a": "same", "b": "same"}, {"a": "same", "c": "same"}, []),
        ({"a": "same", "b": "same", "c": "same"}, {"a": "same", "d": "same"}, ["spec c"]),
        # Specs without a name do not belong together.
        ({"a": ""}, {"b": ""}, ["spec a"]),
    ],
)
def test_specs_belong_together_by_path_and_else_by_name(
    base: dict[str, str], head: dict[str, str], missing: list[str]
) -> None:
    before, after = ({path: SpecName(name) for path, name in each.items()} for each in (base, head))
    assert [change.name for change in missing_specs(before, after)] == missing


def test_a_case_that_is_gone_is_weaker() -> None:
    assert [*missing_specs({"a": MATRIX}, {"a": MATRIX})] == []
    head = {"moved": SpecName("relay", ("x=2", "x=3"))}
    (gone,) = missing_specs({"a": MATRIX}, head)
    assert gone.name == "case relay[x=1]"
    (finding,) = weakening_diagnostics([gone], None, "main")
    assert (finding.span.file, finding.span.line) == ("moved", 1)
    assert finding.help.endswith("--allow 'case relay[x=1]'")
    check_allowed([gone.name], ())


def test_the_name_and_the_cases_are_those_of_the_document() -> None:
    matrix = with_value(DOCUMENT, ("matrix",), {"axes": {"threads": [1, 2]}})
    assert spec_name(load_cases(to_yaml(matrix))) == SpecName("relay", ("threads=1", "threads=2"))
    assert spec_name(load_cases(to_yaml(DOCUMENT))) == SpecName("relay")
    assert spec_name(load_cases("name: [")) == SpecName("")
