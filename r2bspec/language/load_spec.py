"""Loading a spec: a file, with options, becomes a `LoadedSpec`: a typed `Spec`, or diagnostics.

The forms: text; the located tree, with the files that it extends and the values of options; the
resolved tree of one case of its matrix (`r2bspec.language.resolve`); the typed `Spec`. Each step
reports everything that it finds. Problems that may only be consequences of an unknown value or an
unreadable file are not reported.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Unpack

from r2bspec.diagnostics import Diagnostic, Path, Severity, Span
from r2bspec.diagnostics.quote import quote, unknown_name_help
from r2bspec.language import located_tree
from r2bspec.language.document import (
    MAX_PROBLEMS,
    Document,
    Source,
    ValueOrigins,
    decode,
    has_errors,
    inner_span,
    read_file,
    read_text,
)
from r2bspec.language.extends import extend_files
from r2bspec.language.key_constraints import key_constraint_errors
from r2bspec.language.matrix import MatrixCase, MatrixCases, matrix_of
from r2bspec.language.resolve import Resolver
from r2bspec.language.spec import Spec
from r2bspec.language.structure import explain, read_value
from r2bspec.language.variables import apply_overrides
from r2bspec.language.yaml_document import compose, to_yaml

if TYPE_CHECKING:
    from r2bspec.language.selected_spec import LoadOptions


@contextmanager
def gc_paused() -> Iterator[None]:
    """Pause the garbage collector for the block.

    Reading creates many values and no cycles: the collector would traverse them all repeatedly and
    free nothing. Their number is limited (`r2bspec.language.yaml_document`).
    """
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@dataclass(frozen=True, slots=True)
class LoadedSpec:
    """A document, or a case of its matrix: its values as far as they are known, and its errors.

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
    tree: located_tree.TreeNode | None
    diagnostics: tuple[Diagnostic, ...]
    sources: Mapping[str, Source] = field(repr=False)
    used_variables: frozenset[str] = frozenset()
    matrix_case: MatrixCase | None = field(default=None, repr=False)
    origins: ValueOrigins = field(default=ValueOrigins(), repr=False)

    @property
    def case(self) -> str:
        """The name of the case of the matrix, such as ``threads=2``; empty without a matrix."""
        return self.matrix_case.name if self.matrix_case is not None else ""

    @property
    def id(self) -> str:
        """The key of this case in results and baselines: ``name``, or ``name[threads=2]``."""
        name = self.spec.name if self.spec is not None else FilePath(self.file).name
        return f"{name}[{self.case}]" if self.case else name

    def span(self, path: Path, key: bool = False) -> Span:
        """Return the place of the value at a path, or of its key.

        For a value that is not written (a default, a missing key), it is the key of the nearest
        ancestor that is.
        """
        if self.tree is None:
            return Span.of_file(self.file)
        return located_tree.span_at(self.tree, path, key=key)

    def span_inside(self, path: Path, offset: int, length: int = 1) -> Span:
        """Return the place of a piece of the text at a path, such as a metric in a requirement."""
        node = located_tree.lookup(self.tree, path)
        if not isinstance(node, located_tree.ScalarNode):
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
        """Return the case as YAML, with files, options, variables and merges applied."""
        return to_yaml(located_tree.to_plain(self.tree)) if self.tree is not None else ""


def load_spec(source: FilePath | str | bytes, **options: Unpack[LoadOptions]) -> LoadedSpec:
    """Load a spec. Never raises because of the content: all problems are in `diagnostics`.

    For a document with a matrix, one case is loaded. If it has several, `case` must select one.

    Args:
        source: the path of a file (``Path("-")`` is standard input), or the text itself.
        options: what decides besides the text what is in it.
    """
    with gc_paused():
        document = open_document(source, options)
        matrix, matrix_cases = _select_cases(document, options.get("case", ""))
        if len(matrix_cases) > 1 and matrix is not None:
            known = ", ".join(case.name for case in matrix_cases[:12])
            message = f"the matrix has {len(matrix_cases)} cases; none is selected"
            help_text = f"select one with --case: {known}"
            document.problems.error("R2B140", message, matrix.span, help_text)
            matrix_cases = ()
        return _load_case(document, matrix_cases[0] if matrix_cases else None, options)


def load_cases(
    source: FilePath | str | bytes, **options: Unpack[LoadOptions]
) -> tuple[LoadedSpec, ...]:
    """Load every case of a spec, or the named `case`; without a matrix, the spec itself.

    The arguments are those of `load_spec`. There is always at least one result: if the matrix
    itself is invalid, the document without a case.
    """
    with gc_paused():
        document = open_document(source, options)
        _, matrix_cases = _select_cases(document, options.get("case", ""))
        first = _load_case(document, matrix_cases[0] if matrix_cases else None, options)
        return (first, *(_load_case(document, case, options) for case in matrix_cases[1:]))


def open_document(source: FilePath | str | bytes, options: LoadOptions) -> Document:
    """Read a document, up to its matrix: files and options merged, no variables."""
    folders = tuple(options.get("allow_paths", ()))
    file = options.get("file", "<text>")
    if isinstance(source, FilePath):
        read = read_file(source, folders)
    else:
        read = read_text(source, file) if isinstance(source, str) else decode(source, file)
    composed = compose(read)
    if isinstance(composed.tree, located_tree.ScalarNode):
        # It is no spec, and perhaps a file of secrets: findings show no line of it.
        read = Source(read.file, "\n" * (len(read.lines) - 1))
    document = Document(read.file, composed.tree, sources={read.file: read})
    document.problems.diagnostics += composed.diagnostics
    if document.tree is not None:
        extend_files(document, folders)
        apply_overrides(document, options.get("sets", ()), options.get("variables") or {})
    return document


def _select_cases(
    document: Document, case: str
) -> tuple[MatrixCases | None, tuple[MatrixCase, ...]]:
    """Return the matrix and the selected cases; its problems are added to those of the document."""
    has_matrix = document.tree is not None and not document.is_incomplete
    matrix = matrix_of(document.tree, document.sources) if has_matrix else None
    if matrix is not None:
        document.problems.diagnostics += matrix.problems.diagnostics
        if has_errors(matrix.problems.diagnostics):
            return matrix, ()
    selected = case.partition("[")[2].removesuffix("]") if case.endswith("]") else case
    matrix_cases = matrix.matrix_cases if matrix is not None else ()
    if not selected or document.tree is None or (matrix is not None and not matrix_cases):
        return matrix, matrix_cases
    matching = tuple(matrix_case for matrix_case in matrix_cases if matrix_case.name == selected)
    if not matching:
        names = [matrix_case.name for matrix_case in matrix_cases]
        document.problems.error(
            "R2B140",
            f"unknown case {quote(selected)}",
            matrix.span if matrix is not None else Span.of_file(document.file),
            unknown_name_help(selected, names, "known cases", "it has no matrix"),
        )
    return matrix, matching


def _load_case(
    document: Document, matrix_case: MatrixCase | None, options: LoadOptions
) -> LoadedSpec:
    """Substitute, validate and convert one case of a document."""
    problems, tree = list(document.problems.diagnostics), document.tree
    used: frozenset[str] = frozenset()
    spec: Spec | None = None
    if isinstance(tree, located_tree.MapNode):
        environ = options.get("environ")
        resolver = Resolver(
            tree,
            document.sources,
            os.environ if environ is None else environ,
            matrix_case.values if matrix_case is not None else {},
        )
        problems += resolver.problems.diagnostics
        tree = resolver.tree
        used = _condition_variables(tree) | resolver.used
    if tree is not None and not isinstance(tree, located_tree.UnknownNode):
        value, violations = read_value(tree, sources=document.sources)
        explained = explain(violations)
        problems += [*explained, *key_constraint_errors(tree, explained)]
        spec = value if isinstance(value, Spec) and not has_errors(problems) else None
    if document.is_incomplete:
        # The others may be consequences of what the file would have brought.
        problems = list(document.problems.diagnostics)
    return LoadedSpec(
        document.file,
        document.base_dir,
        spec,
        tree,
        _sorted_unique(document.origins.with_origins(problems)),
        document.sources,
        used,
        matrix_case=matrix_case,
        origins=document.origins,
    )


def _condition_variables(root: located_tree.TreeNode) -> frozenset[str]:
    """Return the variables in the `when` of objectives."""
    objectives = located_tree.entries_of(located_tree.child(root, "slos")).values()
    return frozenset(
        name
        for objective in objectives
        for name in located_tree.entries_of(located_tree.child(objective.value, "when"))
    )


def _sorted_unique(problems: list[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Sorted by place; the same finding at the same place, as with aliases, is kept once."""
    unique = {
        (problem.code, problem.span, problem.message): problem for problem in reversed(problems)
    }
    ordered = sorted(unique.values(), key=lambda problem: problem.sort_key)
    if len(ordered) > MAX_PROBLEMS:
        place = ordered[MAX_PROBLEMS].span
        message = f"more than {MAX_PROBLEMS:,} problems; the rest is not shown"
        ordered[MAX_PROBLEMS:] = [Diagnostic("R2B005", Severity.INFO, message, place)]
    return tuple(ordered)
