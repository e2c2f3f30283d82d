"""Two sets of specs, such as those of two work trees: what the second one lacks.

A spec of the head belongs to the spec of the base at the same path, or else to one that is gone
from its path and has the same ``name:``. A spec that is gone from the head can gate nothing any
more, and neither can a case that is gone from its matrix: both are a weaker gate.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from r2bspec.compare.gate_change import GateChange
from r2bspec.diagnostics.diagnostic import Span

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec


@dataclass(frozen=True)
class SpecName:
    """The ``name:`` of a spec, and the cases of its matrix; none without a matrix."""

    name: str
    cases: tuple[str, ...] = ()


def spec_name(cases: Sequence[LoadedSpec]) -> SpecName:
    """The name of a document from all its cases (`r2bspec.language.load_spec.load_cases`)."""
    specs = [case.spec for case in cases if case.spec is not None]
    name = specs[0].name if specs else ""
    return SpecName(name, tuple(case.case for case in cases if case.case))


def missing_specs(
    base: Mapping[str, SpecName], head: Mapping[str, SpecName]
) -> Iterator[GateChange]:
    """The specs that the head lacks, named ``spec PATH``, and the cases, ``case NAME[CASE]``.

    Args:
        base: the name of each spec by its path below the top of its tree.
        head: the same of the head.
    """
    bases = {path: path for path in head if path in base} | _renamed(base, head)
    for path in sorted(base.keys() - set(bases.values())):
        span = Span.of_file(path)
        yield GateChange(f"spec {path}", (), f"benchmark {base[path].name}", "", span=span)
    for path, spec in head.items():
        was = base[bases[path]] if path in bases else SpecName("")
        for case in was.cases:
            if case not in spec.cases:
                name, span = f"case {was.name}[{case}]", Span.of_file(path)
                yield GateChange(name, ("matrix",), f"a case of {path}", "", span=span)


def _renamed(base: Mapping[str, SpecName], head: Mapping[str, SpecName]) -> dict[str, str]:
    """The path in the base of each spec that is at a new path in the head."""
    left = [path for path in sorted(base) if path not in head]
    renamed = {}
    for path in sorted(head.keys() - base.keys()):
        name = head[path].name
        same = [other for other in left if name and base[other].name == name]
        if same:
            renamed[path] = same[0]
            left.remove(same[0])
    return renamed
