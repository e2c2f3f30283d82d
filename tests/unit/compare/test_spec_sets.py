"""Sets of specs: which belong together, which are gone, which are new."""

from __future__ import annotations

from compared_gates import DOCUMENT, with_value
from r2bspec.compare.gate_strength import check_allowed, weakening_diagnostics
from r2bspec.compare.spec_sets import SpecName, compare_spec_sets, spec_name
from r2bspec.language.load_spec import load_cases
from r2bspec.language.yaml_document import to_yaml


def test_specs_belong_together_by_path_and_else_by_name() -> None:
    base = {"bench/a": "a", "bench/b": "b", "bench/gone": "gone", "bench/moved": "moved"}
    head = {"bench/a": "other", "bench/b": "b", "new/moved": "moved", "bench/new": "new"}
    found = compare_spec_sets(base, head)
    assert found.bases == {
        "bench/a": "bench/a",
        "bench/b": "bench/b",
        "new/moved": "bench/moved",
    }
    assert found.renamed == {"new/moved": "bench/moved"}
    assert (found.deleted, found.new) == (("bench/gone",), ("bench/new",))
    assert [each.name for each in found.weaker] == ["spec bench/gone"]


def test_a_spec_that_stays_at_its_path_is_no_base_of_a_copy() -> None:
    found = compare_spec_sets({"a": "same"}, {"a": "same", "b": "same"})
    assert (found.bases, found.new, found.weaker) == ({"a": "a"}, ("b",), ())


def test_one_spec_is_the_base_of_one_spec() -> None:
    found = compare_spec_sets({"a": "same"}, {"b": "same", "c": "same"})
    assert (found.renamed, found.new) == ({"b": "a"}, ("c",))


def test_specs_without_a_name_do_not_belong_together() -> None:
    found = compare_spec_sets({"a": ""}, {"b": ""})
    assert (found.bases, found.deleted, found.new) == ({}, ("a",), ("b",))


def test_the_same_sets_differ_in_nothing() -> None:
    specs = {"a": SpecName("a", ("x=1", "x=2")), "b": SpecName("b")}
    found = compare_spec_sets(specs, specs)
    assert (found.weaker, found.deleted, found.new, found.new_cases) == ((), (), (), {})


def test_a_case_that_is_gone_is_weaker_and_a_new_one_is_new() -> None:
    base = {"a": SpecName("relay", ("x=1", "x=2"))}
    head = {"a": SpecName("relay", ("x=2", "x=3"))}
    found = compare_spec_sets(base, head)
    assert [each.name for each in found.weaker] == ["case relay[x=1]"]
    assert found.new_cases == {"a": ("x=3",)}
    (finding,) = weakening_diagnostics(found.weaker, None, "main")
    assert (finding.span.file, finding.span.line) == ("a", 1)
    assert finding.help.endswith("--allow 'case relay[x=1]'")
    check_allowed([each.name for each in found.weaker], ())


def test_the_name_and_the_cases_are_those_of_the_document() -> None:
    matrix = with_value(DOCUMENT, ("matrix",), {"axes": {"threads": [1, 2]}})
    assert spec_name(load_cases(to_yaml(matrix))) == SpecName("relay", ("threads=1", "threads=2"))
    assert spec_name(load_cases(to_yaml(DOCUMENT))) == SpecName("relay")
    assert spec_name(load_cases("name: [")) == SpecName("")
