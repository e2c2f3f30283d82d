"""`matrix`: cases of a benchmark that differ in the values of variables.

    matrix:
      axes: {threads: [1, 2, 4], rate: [30 Hz, 60 Hz]}   # all combinations
      exclude: [{threads: 1, rate: 60 Hz}]               # except those with these values
      cases: {night: {bag: r2b_lounge}}                  # and further cases, by name

The name of a case is its values, ``threads=1,rate=30 Hz``, or its key, ``night``.

What is found in several cases is reported once (`merge_case_findings`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import msgspec
from msgspec.structs import replace

from r2bspec.diagnostics import Diagnostic, Related, Severity, Span
from r2bspec.diagnostics.quote import clip, first_words, quote, unknown_name_help
from r2bspec.language import located_tree as tree
from r2bspec.language.declaration import language
from r2bspec.language.document import DiagnosticCollector, Source
from r2bspec.language.structure import INVALID, explain, read_value
from r2bspec.safe_io.limits import MAX_CASE_NAME_CHARACTERS, MAX_CASES

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec

KEY = "matrix"


Values = Mapping[str, tree.ScalarNode]


class MatrixCase(msgspec.Struct, frozen=True):
    """A case: its name, its values, and its place in the document."""

    name: str
    values: Values
    span: Span


class MatrixCases(msgspec.Struct):
    """The cases of a document, and the problems of its matrix.

    Attributes:
        span: the place of the matrix.
        matrix_cases: the cases in their order; empty if the matrix is invalid.
    """

    span: Span
    matrix_cases: tuple[MatrixCase, ...] = ()
    problems: DiagnosticCollector = msgspec.field(default_factory=DiagnosticCollector)


def matrix_of(root: tree.TreeNode | None, sources: Mapping[str, Source]) -> MatrixCases | None:
    """Return the matrix of a document, or None if it has none.

    Args:
        root: the document.
        sources: the texts that its places point into.
    """
    node = tree.child(root, KEY)
    if not isinstance(root, tree.MapNode) or node is None:
        return None
    matrix = MatrixCases(root.entries[KEY].key_span)
    value, violations = read_value(node, (language().keys or {})[KEY], sources, (KEY,))
    if value is INVALID:
        matrix.problems.diagnostics += explain(violations)
        return matrix
    axes = {
        name: [item for item in tree.items_of(entry.value) if isinstance(item, tree.ScalarNode)]
        for name, entry in tree.entries_of(tree.child(node, "axes")).items()
    }
    if _check_names(matrix.problems, root, node) and _check_values(matrix, axes, node):
        matrix.matrix_cases = _expand_cases(matrix, axes, node)
    return matrix


def _values(node: tree.TreeNode) -> Values:
    return {
        name: entry.value
        for name, entry in tree.entries_of(node).items()
        if isinstance(entry.value, tree.ScalarNode)
    }


_Axes = Mapping[str, Sequence[tree.ScalarNode]]


def _check_names(problems: DiagnosticCollector, root: tree.TreeNode, node: tree.TreeNode) -> bool:
    """Report variables that the document does not declare; return whether there are none."""
    known = tree.entries_of(tree.child(root, "variables"))
    named = dict(tree.entries_of(tree.child(node, "axes")))
    for case in tree.entries_of(tree.child(node, "cases")).values():
        named |= tree.entries_of(case.value)
    unknown = [name for name in named if name not in known]
    for name in unknown:
        declare = "declare it under 'variables' with a default value"
        help_text = unknown_name_help(name, known, "declared variables", declare)
        message = f"unknown variable {quote(name)}"
        problems.error("R2B137", message, named[name].key_span, help_text)
    return not unknown


def _check_values(matrix: MatrixCases, axes: _Axes, node: tree.TreeNode) -> bool:
    """Report values that occur twice, and too many cases; return whether there are neither."""
    problems = matrix.problems
    for name, values in axes.items():
        seen: dict[str, tree.ScalarNode] = {}
        for value in values:
            first = seen.setdefault(value.text, value)
            if first is not value:
                problems.error(
                    "R2B141",
                    f"duplicate value {quote(value.text)} in axis {quote(name)}",
                    value.span,
                    "remove one of them: two cases would have the same name",
                    related=(Related("first used here", first.span),),
                )
    number = len(tree.entries_of(tree.child(node, "cases")))
    number += math.prod(map(len, axes.values())) if axes else 0
    excluded = len(tree.items_of(tree.child(node, "exclude")))
    for count, what in ((number, "cases"), (excluded, "exclusions")):
        if count > MAX_CASES:
            message = f"the matrix has {count:,} {what}; the limit is {MAX_CASES:,}"
            problems.error("R2B139", message, matrix.span, "remove values, or split the spec")
    return not problems.diagnostics


def _expand_cases(matrix: MatrixCases, axes: _Axes, node: tree.TreeNode) -> tuple[MatrixCase, ...]:
    excluded = tree.items_of(tree.child(node, "exclude"))
    rules = [_chosen(_values(rule)) for rule in excluded]
    made: list[MatrixCase] = []
    used: set[int] = set()
    for combination in itertools.product(*axes.values()) if axes else ():
        values: Values = dict(zip(axes, combination, strict=True))
        chosen = _chosen(values)
        matching = [index for index, rule in enumerate(rules) if rule <= chosen]
        used.update(matching)
        if not matching:
            name = ",".join(f"{key}={value.text}" for key, value in values.items())
            made.append(MatrixCase(name, values, combination[-1].span))
    for index, rule in enumerate(excluded):
        if index not in used:
            matrix.problems.diagnostics.append(
                Diagnostic(
                    "R2B138",
                    Severity.WARNING,
                    "this exclusion matches no combination of the axes",
                    rule.span,
                    path=(KEY, "exclude", index),
                    help='remove it, or correct its values; 2 and "2" are different',
                )
            )
    for name, entry in tree.entries_of(tree.child(node, "cases")).items():
        made.append(MatrixCase(name, _values(entry.value), entry.key_span))
    if not made:
        message = "the matrix has no cases" + (": all combinations are excluded" if axes else "")
        matrix.problems.error(
            "R2B139", message, matrix.span, "for example: axes: {threads: [1, 2]}"
        )
    return tuple(made)


def _chosen(values: Values) -> frozenset[tuple[str, bool, object]]:
    """Names with their values, to be compared; unlike in Python, true is not 1."""
    return frozenset(
        (name, isinstance(node.value, bool), node.value) for name, node in values.items()
    )


_MAX_NAMED_CASES = 5


def merge_case_findings(
    cases: Sequence[LoadedSpec], findings: Sequence[Iterable[Diagnostic]]
) -> list[Diagnostic]:
    """Return the findings of all cases, sorted by place.

    A finding that several cases share is reported once. If only some cases have it, it names them,
    with the place where their values are chosen.

    Args:
        cases: the cases of one document, as `load_cases` gave them.
        findings: what was found in each, in the same order.
    """
    groups: dict[tuple[str, Span, str], list[tuple[str, Diagnostic]]] = {}
    for case, found in zip(cases, findings, strict=True):
        for finding in dict.fromkeys(case.origins.with_origins(found)):
            key = (finding.code, finding.span, finding.message)
            groups.setdefault(key, []).append((case.case, finding))
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
    clipped = [clip(name, MAX_CASE_NAME_CHARACTERS) for name in names]
    listed = first_words(clipped, _MAX_NAMED_CASES)
    noun = "case" if len(names) == 1 else "cases"
    related = Related(f"in the {noun} {listed}", matrix_case.span)
    return replace(first, related=(*first.related, related))
