"""The way in: a file, with options, becomes a `Spec`, or diagnostics that say why not.

The order: parse, ``extends``, ``--set``, ``--var``, the case of the matrix, substitute, schema,
types. Each step reports all that it finds; what depends on a value that is not known is left
unsaid.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

from r2bspec.diagnostics import Diagnostic, Path, Severity, Span, did_you_mean
from r2bspec.diagnostics.quote import quote
from r2bspec.language.convert import to_spec
from r2bspec.language.diagnostic_collector import MOST
from r2bspec.language.document import Opened, Variables, open_document
from r2bspec.language.gc_pause import collector_paused
from r2bspec.language.key_constraints.entry_keys import exclusive_errors
from r2bspec.language.loaded_spec import Loaded
from r2bspec.language.located_tree import MapNode, TreeNode, UnknownNode, child, to_plain, without
from r2bspec.language.matrix import KEY as MATRIX
from r2bspec.language.matrix import Choice, Matrix, chosen, matrix_of
from r2bspec.language.schema_validator import obeys, schema
from r2bspec.language.source_text import Source
from r2bspec.language.spec import Spec
from r2bspec.language.substitution import substitute
from r2bspec.language.value_origins import Routes

_MISSING = ("R2B102", "R2B113")
_MISSING_FILE = (*_MISSING, "R2B114", "R2B118", "R2B119", "R2B120", "R2B121", "R2B136", "R2B137")

__all__ = ["Loaded", "load_cases", "load_spec"]


def load_spec(
    source: FilePath | str | bytes,
    *,
    file: str = "<text>",
    sets: Sequence[str] = (),
    variables: Variables | None = None,
    environ: Mapping[str, str] | None = None,
    case: str = "",
    allow_paths: Iterable[FilePath] = (),
) -> Loaded:
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
    """
    with collector_paused():
        return _load_one(
            open_document(source, file, sets, variables or {}, allow_paths), case, environ
        )


def _load_one(opened: Opened, case: str, environ: Mapping[str, str] | None) -> Loaded:
    matrix = matrix_of(opened.tree) if opened.tree is not None else None
    choices = _chosen(opened, matrix, case)
    if len(choices) > 1 and matrix is not None:
        known = ", ".join(each.name for each in choices[:12])
        message = f"the matrix has {len(choices)} cases"
        help_text = f"choose one with --case, of {known}"
        opened.found.append(
            Diagnostic("R2B140", Severity.ERROR, message, matrix.span, help=help_text)
        )
        choices = ()
    return _finish(opened, choices[0] if choices else None, environ)


def load_cases(
    source: FilePath | str | bytes,
    *,
    file: str = "<text>",
    sets: Sequence[str] = (),
    variables: Variables | None = None,
    environ: Mapping[str, str] | None = None,
    case: str = "",
    allow_paths: Iterable[FilePath] = (),
) -> tuple[Loaded, ...]:
    """Load every case of a spec, or the one that is named; without a matrix, the spec itself.

    The arguments are those of `load_spec`. There is always at least one result; where the matrix
    itself is wrong, it is the document without any case.
    """
    with collector_paused():
        opened = open_document(source, file, sets, variables or {}, allow_paths)
        matrix = matrix_of(opened.tree) if opened.tree is not None else None
        choices = _chosen(opened, matrix, case)
        return tuple(_finish(opened, each, environ) for each in choices or (None,))


def _chosen(opened: Opened, matrix: Matrix | None, case: str) -> tuple[Choice, ...]:
    """The cases that are meant; what is wrong with the matrix is added to the findings."""
    if matrix is not None:
        opened.found += matrix.problems.found
        if any(one.severity is Severity.ERROR for one in matrix.problems.found):
            return ()
    wanted = case.partition("[")[2].removesuffix("]") if case.endswith("]") else case
    choices = matrix.choices if matrix is not None else ()
    if not wanted or opened.tree is None or (matrix is not None and not choices):
        return choices
    found = tuple(each for each in choices if each.name == wanted)
    if not found:
        names = [each.name for each in choices]
        close = did_you_mean(wanted, names)
        known = "there are " + ", ".join(names[:12]) if names else "it has no matrix"
        opened.found.append(
            Diagnostic(
                "R2B140",
                Severity.ERROR,
                f"the document has no case {quote(wanted)}",
                matrix.span if matrix is not None else Span.of_file(opened.file),
                help=f"did you mean '{close}'? {known}" if close else known,
            )
        )
    return found


def _finish(opened: Opened, choice: Choice | None, environ: Mapping[str, str] | None) -> Loaded:
    """One case of a document, from its values to its types."""
    found, tree = list(opened.found), opened.tree
    entries = dict(opened.entries)
    used: frozenset[str] = frozenset()
    spec: Spec | None = None
    if tree is not None and choice is not None:
        tree = chosen(tree, choice)
    if isinstance(tree, MapNode):
        environment = os.environ if environ is None else environ
        substituted = substitute(tree, schema(), opened.sources, environment)
        found += substituted.diagnostics
        tree = substituted.tree
        used = substituted.used | _named_in_conditions(tree)
        entries |= substituted.ways
    if tree is not None and not isinstance(tree, UnknownNode):
        plain = to_plain(tree)
        violations = _violations(tree, plain, opened.sources)
        found += [*violations, *exclusive_errors(tree, violations)]
        if isinstance(tree, MapNode) and MATRIX in tree.entries:
            tree = without(tree, MATRIX)
        if all(one.severity is not Severity.ERROR for one in found):
            spec = to_spec(plain)
    if opened.incomplete:
        found = [one for one in found if not _follows(one, opened.incomplete)]
    routes = Routes(opened.files, entries)
    return Loaded(
        opened.file,
        opened.base_dir,
        spec,
        tree,
        _sorted(routes.told(found)),
        opened.sources,
        used,
        choice=choice,
        routes=routes,
    )


def _violations(tree: TreeNode, plain: Any, sources: Mapping[str, Source]) -> list[Diagnostic]:
    if obeys(plain):
        return []
    from r2bspec.language.violations import explain_violations

    return explain_violations(tree, plain, sources)


def _follows(one: Diagnostic, incomplete: set[Path]) -> bool:
    """Whether a finding may only say that what is missing was to come from elsewhere."""
    if () in incomplete:
        return one.code in _MISSING_FILE
    return one.code in _MISSING and one.path in incomplete


def _named_in_conditions(root: TreeNode) -> frozenset[str]:
    """The variables on which an objective depends by its `when`."""
    slos = child(root, "slos")
    conditions = (
        child(entry.value, "when")
        for entry in (slos.entries.values() if isinstance(slos, MapNode) else ())
    )
    return frozenset(
        name for each in conditions if isinstance(each, MapNode) for name in each.entries
    )


def _sorted(found: list[Diagnostic]) -> tuple[Diagnostic, ...]:
    """By place; the same finding at the same place, as aliases bring it, is told once."""
    unique = {(one.code, one.span, one.message): one for one in reversed(found)}
    ordered = sorted(unique.values(), key=lambda one: one.sort_key)
    if len(ordered) > MOST:
        place = ordered[MOST].span
        message = f"after {MOST:,} problems, further ones are not shown"
        ordered[MOST:] = [Diagnostic("R2B005", Severity.INFO, message, place)]
    return tuple(ordered)
