"""Two sets of specs, such as those of two work trees: which of them belong together.

A spec of the head belongs to the spec of the base at the same path, or else to one that is gone
from its path and has the same ``name:``. A spec that is gone from the head can gate nothing any
more, and neither can a case that is gone from its matrix: both are a weaker gate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from r2bspec.compare.gate_strength import Weakening
from r2bspec.diagnostics.diagnostic import Span

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec


@dataclass(frozen=True)
class SpecName:
    """The ``name:`` of a spec, and the cases of its matrix; none without a matrix."""

    name: str
    cases: tuple[str, ...] = ()


@dataclass(frozen=True)
class SpecSetComparison:
    """Which specs of two sets belong together.

    Attributes:
        bases: the path in the base of each spec of the head that the base has, by path in the
            head.
        renamed: those of `bases` that have another path.
        deleted: paths in the base without a spec in the head.
        new: paths in the head without a spec in the base.
        new_cases: by path in the head, the cases that its base does not have.
        weaker: what is gone: names are ``spec PATH`` and ``case NAME[CASE]``.
    """

    bases: Mapping[str, str]
    renamed: Mapping[str, str]
    deleted: tuple[str, ...]
    new: tuple[str, ...]
    new_cases: Mapping[str, tuple[str, ...]]
    weaker: tuple[Weakening, ...]


def spec_name(cases: Sequence[LoadedSpec]) -> SpecName:
    """The name of a document from all its cases (`r2bspec.language.load_spec.load_cases`)."""
    specs = [each.spec for each in cases if each.spec is not None]
    name = specs[0].name if specs else ""
    return SpecName(name, tuple(each.case for each in cases if each.case))


def compare_spec_sets(
    base: Mapping[str, SpecName | str], head: Mapping[str, SpecName | str]
) -> SpecSetComparison:
    """Compare two sets of specs.

    Args:
        base: the name of each spec by its path below the top of its tree; with its cases, or
            alone.
        head: the same of the head.
    """
    before = {path: _named(each) for path, each in base.items()}
    after = {path: _named(each) for path, each in head.items()}
    renamed = _renamed(before, after)
    bases = {path: renamed.get(path, path) for path in after if path in before or path in renamed}
    deleted = tuple(sorted(before.keys() - set(bases.values())))
    weaker = [_deleted_spec(path, before[path]) for path in deleted]
    new_cases: dict[str, tuple[str, ...]] = {}
    for path, base_path in bases.items():
        was, now = before[base_path], after[path]
        weaker += [
            _deleted_case(path, was.name, case) for case in was.cases if case not in now.cases
        ]
        added = tuple(case for case in now.cases if case not in was.cases)
        if added:
            new_cases[path] = added
    return SpecSetComparison(
        bases=bases,
        renamed=renamed,
        deleted=deleted,
        new=tuple(sorted(after.keys() - bases.keys())),
        new_cases=new_cases,
        weaker=tuple(weaker),
    )


def _named(entry: SpecName | str) -> SpecName:
    return SpecName(entry) if isinstance(entry, str) else entry


def _renamed(before: Mapping[str, SpecName], after: Mapping[str, SpecName]) -> dict[str, str]:
    """The path in the base of each spec that is at a new path in the head."""
    left = [path for path in sorted(before) if path not in after]
    renamed = {}
    for path in sorted(after):
        if path in before:
            continue
        same = [each for each in left if after[path].name and before[each].name == after[path].name]
        if same:
            renamed[path] = same[0]
            left.remove(same[0])
    return renamed


def _deleted_spec(path: str, spec: SpecName) -> Weakening:
    return Weakening(f"spec {path}", (), f"benchmark {spec.name}", "", Span.of_file(path))


def _deleted_case(path: str, name: str, case: str) -> Weakening:
    return Weakening(
        f"case {name}[{case}]", ("matrix",), f"a case of {path}", "", Span.of_file(path)
    )
