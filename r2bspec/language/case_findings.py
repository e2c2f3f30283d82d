"""What is said of several cases of one document, each finding once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from r2bspec.diagnostics import Diagnostic, Related, Span
from r2bspec.language.loaded_spec import Loaded

_MOST_NAMED = 5


def findings_of_cases(
    cases: Sequence[Loaded], findings: Sequence[Iterable[Diagnostic]]
) -> list[Diagnostic]:
    """The findings of all cases, sorted by place.

    A finding that several cases share is told once; one that not all share names those that it
    concerns, beside the place where their values were chosen.

    Args:
        cases: the cases of one document, as `load_cases` gave them.
        findings: what was found in each, in the same order.
    """
    concerned: dict[tuple[str, Span, str], list[tuple[str, Diagnostic]]] = {}
    for case, found in zip(cases, findings, strict=True):
        for one in dict.fromkeys(case.routes.told(found)):
            key = (one.code, one.span, one.message)
            concerned.setdefault(key, []).append((case.case, one))
    told = [_told(group, cases) for group in concerned.values()]
    return sorted(told, key=lambda one: one.sort_key)


def _told(group: list[tuple[str, Diagnostic]], cases: Sequence[Loaded]) -> Diagnostic:
    names = list(dict.fromkeys(name for name, _ in group))
    first = group[0][1]
    if len(names) == len(cases):
        return first
    choice = next(case.choice for case in cases if case.case == names[0])
    if choice is None:
        return first
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    listed = ", ".join(names[:_MOST_NAMED]) + more
    noun = "case" if len(names) == 1 else "cases"
    related = Related(f"in the {noun} {listed}", choice.span)
    return replace(first, related=(*first.related, related))
