"""The way in: a file, with options, becomes a `Spec`, or diagnostics that say why not.

The order: parse, ``extends``, ``--set``, ``--var``, the case of the matrix, substitute, schema,
types. Each step reports all that it finds; what depends on a value that is not known is left
unsaid.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from r2bspec.diagnostics import Diagnostic, Path, Severity, Span, did_you_mean
from r2bspec.diagnostics.quote import quote
from r2bspec.language.convert import to_spec
from r2bspec.language.diagnostic_collector import MAX_PROBLEMS
from r2bspec.language.document import ParsedDocument, Variables, open_document
from r2bspec.language.gc_pause import gc_paused
from r2bspec.language.key_constraints.entry_keys import key_constraint_errors
from r2bspec.language.loaded_spec import LoadedSpec
from r2bspec.language.located_tree import MapNode, TreeNode, UnknownNode, child, to_plain, without
from r2bspec.language.matrix import KEY as MATRIX
from r2bspec.language.matrix import Matrix, MatrixCase, matrix_of, with_case_values
from r2bspec.language.schema_validator import is_valid, schema
from r2bspec.language.source_text import Source
from r2bspec.language.spec import Spec
from r2bspec.language.substitution import substitute
from r2bspec.language.value_origins import ValueOrigins

if TYPE_CHECKING:
    from r2bspec.language.untrusted_environment import UntrustedSpecs

_MISSING_VALUE_CODES = ("R2B102", "R2B113")
_MISSING_FILE_CODES = (
    *_MISSING_VALUE_CODES,
    "R2B114",
    "R2B118",
    "R2B119",
    "R2B120",
    "R2B121",
    "R2B136",
    "R2B137",
)

__all__ = ["LoadedSpec", "load_cases", "load_spec"]


def load_spec(
    source: FilePath | str | bytes,
    *,
    file: str = "<text>",
    sets: Sequence[str] = (),
    variables: Variables | None = None,
    environ: Mapping[str, str] | None = None,
    case: str = "",
    allow_paths: Iterable[FilePath] = (),
    untrusted: UntrustedSpecs | None = None,
) -> LoadedSpec:
    """Load one spec. Never raises for any content: whatever is wrong is in `diagnostics`.

    Of a document with a matrix, this is one case; if there are several, it is an error not to say
    which.

    Args:
        source: the path of a file (``Path("-")`` is standard input), or the text itself.
        file: the name for a text that is given as such; its folder is `base_dir`.
        sets: values to replace, each as ``path=value``.
        variables: values for declared variables. A string is read as an unquoted YAML scalar.
        environ: where ``$(env X)`` looks; the environment of this process by default.
        case: the case that is meant, as ``threads=2`` or as ``name[threads=2]``.
        allow_paths: folders beside that of the file, from which files may be extended.
        untrusted: given where the spec is a stranger's; it then reads fewer variables.
    """
    with gc_paused():
        document = open_document(source, file, sets, variables or {}, allow_paths)
        return _load_one(document, case, environ, untrusted)


def _load_one(
    document: ParsedDocument,
    case: str,
    environ: Mapping[str, str] | None,
    untrusted: UntrustedSpecs | None,
) -> LoadedSpec:
    matrix = matrix_of(document.tree) if document.tree is not None else None
    matrix_cases = _select_cases(document, matrix, case)
    if len(matrix_cases) > 1 and matrix is not None:
        known = ", ".join(each.name for each in matrix_cases[:12])
        message = f"the matrix has {len(matrix_cases)} cases"
        help_text = f"choose one with --case, of {known}"
        document.diagnostics.append(
            Diagnostic("R2B140", Severity.ERROR, message, matrix.span, help=help_text)
        )
        matrix_cases = ()
    return _load_case(document, matrix_cases[0] if matrix_cases else None, environ, untrusted)


def load_cases(
    source: FilePath | str | bytes,
    *,
    file: str = "<text>",
    sets: Sequence[str] = (),
    variables: Variables | None = None,
    environ: Mapping[str, str] | None = None,
    case: str = "",
    allow_paths: Iterable[FilePath] = (),
    untrusted: UntrustedSpecs | None = None,
) -> tuple[LoadedSpec, ...]:
    """Load every case of a spec, or the one that is named; without a matrix, the spec itself.

    The arguments are those of `load_spec`. There is always at least one result; where the matrix
    itself is wrong, it is the document without any case.
    """
    with gc_paused():
        document = open_document(source, file, sets, variables or {}, allow_paths)
        matrix = matrix_of(document.tree) if document.tree is not None else None
        matrix_cases = _select_cases(document, matrix, case)
        return tuple(
            _load_case(document, each, environ, untrusted) for each in matrix_cases or (None,)
        )


def _select_cases(
    document: ParsedDocument, matrix: Matrix | None, case: str
) -> tuple[MatrixCase, ...]:
    """The cases that are meant; what is wrong with the matrix is added to the findings."""
    if matrix is not None:
        document.diagnostics += matrix.problems.diagnostics
        if any(one.severity is Severity.ERROR for one in matrix.problems.diagnostics):
            return ()
    wanted = case.partition("[")[2].removesuffix("]") if case.endswith("]") else case
    matrix_cases = matrix.matrix_cases if matrix is not None else ()
    if not wanted or document.tree is None or (matrix is not None and not matrix_cases):
        return matrix_cases
    found = tuple(each for each in matrix_cases if each.name == wanted)
    if not found:
        names = [each.name for each in matrix_cases]
        close = did_you_mean(wanted, names)
        known = "there are " + ", ".join(names[:12]) if names else "it has no matrix"
        document.diagnostics.append(
            Diagnostic(
                "R2B140",
                Severity.ERROR,
                f"the document has no case {quote(wanted)}",
                matrix.span if matrix is not None else Span.of_file(document.file),
                help=f"did you mean '{close}'? {known}" if close else known,
            )
        )
    return found


def _load_case(
    document: ParsedDocument,
    matrix_case: MatrixCase | None,
    environ: Mapping[str, str] | None,
    untrusted: UntrustedSpecs | None,
) -> LoadedSpec:
    """One case of a document, from its values to its types."""
    found, tree = list(document.diagnostics), document.tree
    entries = dict(document.entries)
    used: frozenset[str] = frozenset()
    spec: Spec | None = None
    if tree is not None and matrix_case is not None:
        tree = with_case_values(tree, matrix_case)
    if isinstance(tree, MapNode):
        environment = os.environ if environ is None else environ
        refused = untrusted.refused_variables(document.file, tree) if untrusted is not None else {}
        found += refused.values()
        substituted = substitute(
            tree, schema(), document.sources, environment, refused=frozenset(refused)
        )
        found += substituted.diagnostics
        tree = substituted.tree
        used = substituted.used | _condition_variables(tree)
        entries |= substituted.origins
    if tree is not None and not isinstance(tree, UnknownNode):
        plain = to_plain(tree)
        violations = _violations(tree, plain, document.sources)
        found += [*violations, *key_constraint_errors(tree, violations)]
        if isinstance(tree, MapNode) and MATRIX in tree.entries:
            tree = without(tree, MATRIX)
        if all(one.severity is not Severity.ERROR for one in found):
            spec = to_spec(plain)
    if document.incomplete:
        found = [one for one in found if not _is_consequence(one, document.incomplete)]
    origins = ValueOrigins(document.files, entries)
    return LoadedSpec(
        document.file,
        document.base_dir,
        spec,
        tree,
        _sorted_unique(origins.with_origins(found)),
        document.sources,
        used,
        matrix_case=matrix_case,
        origins=origins,
    )


def _violations(tree: TreeNode, plain: Any, sources: Mapping[str, Source]) -> list[Diagnostic]:
    if is_valid(plain):
        return []
    from r2bspec.language.violations import explain_violations

    return explain_violations(tree, plain, sources)


def _is_consequence(one: Diagnostic, incomplete: set[Path]) -> bool:
    """Whether a finding may only say that what is missing was to come from elsewhere."""
    if () in incomplete:
        return one.code in _MISSING_FILE_CODES
    return one.code in _MISSING_VALUE_CODES and one.path in incomplete


def _condition_variables(root: TreeNode) -> frozenset[str]:
    """The variables on which an objective depends by its `when`."""
    slos = child(root, "slos")
    conditions = (
        child(entry.value, "when")
        for entry in (slos.entries.values() if isinstance(slos, MapNode) else ())
    )
    return frozenset(
        name for each in conditions if isinstance(each, MapNode) for name in each.entries
    )


def _sorted_unique(found: list[Diagnostic]) -> tuple[Diagnostic, ...]:
    """By place; the same finding at the same place, as aliases bring it, is told once."""
    unique = {(one.code, one.span, one.message): one for one in reversed(found)}
    ordered = sorted(unique.values(), key=lambda one: one.sort_key)
    if len(ordered) > MAX_PROBLEMS:
        place = ordered[MAX_PROBLEMS].span
        message = f"after {MAX_PROBLEMS:,} problems, further ones are not shown"
        ordered[MAX_PROBLEMS:] = [Diagnostic("R2B005", Severity.INFO, message, place)]
    return tuple(ordered)
