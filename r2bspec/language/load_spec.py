"""Loading a spec: a file, with options, becomes a `LoadedSpec`: a typed `Spec`, or diagnostics.

The order: parse, ``extends``, ``--set``, ``--var``, matrix case, substitution, schema, types.
Each step reports everything that it finds. Problems that may only be consequences of an unknown
value or an unreadable file are not reported.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from r2bspec.diagnostics import Diagnostic, Path, Severity, Span, did_you_mean
from r2bspec.diagnostics.quote import quote
from r2bspec.language.declaration import language
from r2bspec.language.diagnostic_collector import MAX_PROBLEMS
from r2bspec.language.document import ParsedDocument, ValueOrigins, Variables, open_document
from r2bspec.language.key_constraints import key_constraint_errors
from r2bspec.language.located_tree import (
    MapNode,
    ScalarNode,
    TreeNode,
    UnknownNode,
    child,
    lookup,
    scalars_of,
    span_at,
    to_plain,
    without,
)
from r2bspec.language.matrix import KEY as MATRIX
from r2bspec.language.matrix import Matrix, MatrixCase, matrix_of, with_case_values
from r2bspec.language.read_spec import read_spec
from r2bspec.language.source_text import Source, inner_span
from r2bspec.language.spec import Spec
from r2bspec.language.substitution import substitute
from r2bspec.language.variables import OPENING

if TYPE_CHECKING:
    from r2bspec.language.untrusted_environment import UntrustedSpecs


@contextmanager
def gc_paused() -> Iterator[None]:
    """Pause the collector.

    Reading creates many values and no cycles: the collector would traverse them all repeatedly and
    free nothing. Their number is limited (`r2bspec.language.yaml_composer`).
    """
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


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


@dataclass(frozen=True, slots=True)
class LoadedSpec:
    """A document, or one case of its matrix: its values as far as they are known, and its errors.

    Attributes:
        file: the name of the file as the user gave it; spans in it use that name.
        base_dir: the folder to which paths in the document are relative.
        spec: the typed document; None if and only if there are errors.
        tree: the located document after substitution; None where the text is not YAML.
        diagnostics: everything that was found, sorted by place.
        sources: the texts that spans point into, by file name: the file, the files that it
            extends, and options.
        used_variables: names of the variables that were substituted.
        matrix_case: which case of the matrix this is; None without a matrix.
        origins: the places that led to values written elsewhere.
    """

    file: str
    base_dir: FilePath
    spec: Spec | None
    tree: TreeNode | None
    diagnostics: tuple[Diagnostic, ...]
    sources: Mapping[str, Source] = field(repr=False)
    used_variables: frozenset[str] = frozenset()
    matrix_case: MatrixCase | None = field(default=None, repr=False)
    origins: ValueOrigins = field(default=ValueOrigins(), repr=False)

    @property
    def case(self) -> str:
        """Which case of the matrix this is, such as ``threads=2``; empty without a matrix."""
        return self.matrix_case.name if self.matrix_case is not None else ""

    @property
    def id(self) -> str:
        """The key of this case in results and baselines: ``name``, or ``name[threads=2]``."""
        name = self.spec.name if self.spec is not None else FilePath(self.file).name
        return f"{name}[{self.case}]" if self.case else name

    def span(self, path: Path, key: bool = False) -> Span:
        """The place of the value at a path, or of its key.

        For a value that is not written (a default, a missing key), it is the key of the nearest
        ancestor that is.
        """
        if self.tree is None:
            return Span.of_file(self.file)
        return span_at(self.tree, path, key=key)

    def span_inside(self, path: Path, offset: int, length: int = 1) -> Span:
        """The place of a piece of the text at a path, such as a metric in a requirement."""
        node = lookup(self.tree, path) if self.tree is not None else None
        if not isinstance(node, ScalarNode):
            return self.span(path)
        if node.origin is not None:
            return node.span
        source = self.sources.get(node.span.file)
        return inner_span(source, node.span, node.text, offset, length)

    @property
    def texts(self) -> dict[str, str]:
        """The texts of `sources` by file name, as renderers of diagnostics expect them."""
        return {name: source.text for name, source in self.sources.items()}

    def resolved_yaml(self) -> str:
        """The document as YAML: one case, with files, options, variables and merges applied."""
        from r2bspec.language.yaml_scalars import to_yaml

        return to_yaml(to_plain(self.tree)) if self.tree is not None else ""


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
    """Load one spec. Never raises because of the content: all problems are in `diagnostics`.

    Of a document with a matrix, one case is loaded. If it has several, `case` must select one.

    Args:
        source: the path of a file (``Path("-")`` is standard input), or the text itself.
        file: the name of a text that is given as `source`; its folder is `base_dir`.
        sets: values to replace, each as ``path=value``.
        variables: values for declared variables. A string is read as an unquoted YAML scalar.
        environ: the environment for ``$(env X)``; that of this process by default.
        case: the case to load, as ``threads=2`` or as ``name[threads=2]``.
        allow_paths: further folders, besides that of the file, with files that may be extended.
        untrusted: for a spec of a stranger's change: the variables that it may read.
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
        message = f"the matrix has {len(matrix_cases)} cases; none is selected"
        help_text = f"select one with --case: {known}"
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
    """Load every case of a spec, or the one that `case` names; without a matrix, the spec itself.

    The arguments are those of `load_spec`. There is always at least one result: if the matrix
    itself is invalid, the document without a case.
    """
    with gc_paused():
        document = open_document(source, file, sets, variables or {}, allow_paths)
        matrix = matrix_of(document.tree) if document.tree is not None else None
        matrix_cases = _select_cases(document, matrix, case)
        if not matrix_cases:
            return (_load_case(document, None, environ, untrusted),)
        first = _load_case(document, matrix_cases[0], environ, untrusted)
        _drop_checked_matrix(document, first)
        return (
            first,
            *(_load_case(document, each, environ, untrusted) for each in matrix_cases[1:]),
        )


def _drop_checked_matrix(document: ParsedDocument, first: LoadedSpec) -> None:
    """Remove the matrix once one case was loaded: it is the same, and as long, in every case.

    Its problems are those of the document. A matrix with references, which is rare, stays: what
    they refer to may differ.
    """
    tree = document.tree
    if not isinstance(tree, MapNode) or MATRIX not in tree.entries:
        return
    if any(OPENING in each.text for each in scalars_of(tree.entries[MATRIX].value)):
        return
    document.diagnostics += [one for one in first.diagnostics if one.path[:1] == (MATRIX,)]
    document.tree = without(tree, MATRIX)


def _select_cases(
    document: ParsedDocument, matrix: Matrix | None, case: str
) -> tuple[MatrixCase, ...]:
    """The selected cases; problems of the matrix are added to the diagnostics."""
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
        known = "known cases: " + ", ".join(names[:12]) if names else "it has no matrix"
        document.diagnostics.append(
            Diagnostic(
                "R2B140",
                Severity.ERROR,
                f"unknown case {quote(wanted)}",
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
    """Substitute, validate and convert one case of a document."""
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
            tree, language(), document.sources, environment, refused=frozenset(refused)
        )
        found += substituted.diagnostics
        tree = substituted.tree
        used = substituted.used | _condition_variables(tree)
        entries |= substituted.origins
    if tree is not None and not isinstance(tree, UnknownNode):
        spec, explained = _read(tree, document.sources)
        found += [*explained, *key_constraint_errors(tree, explained)]
        if isinstance(tree, MapNode) and MATRIX in tree.entries:
            tree = without(tree, MATRIX)
        if any(one.severity is Severity.ERROR for one in found):
            spec = None
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


def _read(tree: TreeNode, sources: Mapping[str, Source]) -> tuple[Spec | None, list[Diagnostic]]:
    spec, violations = read_spec(tree, sources)
    if not violations:
        return spec, []
    from r2bspec.language.explain_violations import explain_violations

    return spec, explain_violations(violations)


def _is_consequence(one: Diagnostic, incomplete: set[Path]) -> bool:
    """Whether a problem may only be due to something that could not be read."""
    if () in incomplete:
        return one.code in _MISSING_FILE_CODES
    return one.code in _MISSING_VALUE_CODES and one.path in incomplete


def _condition_variables(root: TreeNode) -> frozenset[str]:
    """The variables in the `when` of objectives."""
    slos = child(root, "slos")
    conditions = (
        child(entry.value, "when")
        for entry in (slos.entries.values() if isinstance(slos, MapNode) else ())
    )
    return frozenset(
        name for each in conditions if isinstance(each, MapNode) for name in each.entries
    )


def _sorted_unique(found: list[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Sorted by place; the same finding at the same place, as with aliases, is kept once."""
    unique = {(one.code, one.span, one.message): one for one in reversed(found)}
    ordered = sorted(unique.values(), key=lambda one: one.sort_key)
    if len(ordered) > MAX_PROBLEMS:
        place = ordered[MAX_PROBLEMS].span
        message = f"more than {MAX_PROBLEMS:,} problems; the rest is not shown"
        ordered[MAX_PROBLEMS:] = [Diagnostic("R2B005", Severity.INFO, message, place)]
    return tuple(ordered)
