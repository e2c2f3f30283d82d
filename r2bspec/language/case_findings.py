"""The findings of several cases of one document, merged: each is reported once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from msgspec.structs import replace

from r2bspec.diagnostics import Diagnostic, Related, Span
from r2bspec.diagnostics.quote import clip
from r2bspec.language.load_spec import LoadedSpec

_MAX_NAMED_CASES = 5
_MAX_NAME_LENGTH = 200


def merge_case_findings(
    cases: Sequence[LoadedSpec], findings: Sequence[Iterable[Diagnostic]]
) -> list[Diagnostic]:
    """The findings of all cases, sorted by place.

    A finding that several cases share is reported once. One that only some cases have names them,
    with the place where their values are chosen.

    Args:
        cases: the cases of one document, as `load_cases` gave them.
        findings: what was found in each, in the same order.
    """
    groups: dict[tuple[str, Span, str], list[tuple[str, Diagnostic]]] = {}
    for case, found in zip(cases, findings, strict=True):
        for one in dict.fromkeys(case.origins.with_origins(found)):
            key = (one.code, one.span, one.message)
            groups.setdefault(key, []).append((case.case, one))
    merged_findings = [_merge_group(group, cases) for group in groups.values()]
    return sorted(merged_findings, key=lambda one: one.sort_key)


def _merge_group(group: list[tuple[str, Diagnostic]], cases: Sequence[LoadedSpec]) -> Diagnostic:
    names = list(dict.fromkeys(name for name, _ in group))
    first = group[0][1]
    if len(names) == len(cases):
        return first
    matrix_case = next(case.matrix_case for case in cases if case.case == names[0])
    if matrix_case is None:
        return first
    more = f" and {len(names) - _MAX_NAMED_CASES} more" if len(names) > _MAX_NAMED_CASES else ""
    listed = ", ".join(clip(each, _MAX_NAME_LENGTH) for each in names[:_MAX_NAMED_CASES]) + more
    noun = "case" if len(names) == 1 else "cases"
    related = Related(f"in the {noun} {listed}", matrix_case.span)
    return replace(first, related=(*first.related, related))
