"""The way in: a file, with options, becomes a `Spec`, or diagnostics that say why not.

The order: parse, ``--set``, ``--var``, substitute, schema, types. Each step reports all that it
finds; what depends on a value that is not known is left unsaid.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath

from r2bspec.diagnostics import Diagnostic, Path, Severity, Span
from r2bspec.spec.columns import inner_span
from r2bspec.spec.compose import compose
from r2bspec.spec.exclusive import exclusive_errors
from r2bspec.spec.extensions import without_extensions
from r2bspec.spec.model import Spec
from r2bspec.spec.overrides import apply_overrides
from r2bspec.spec.problems import MOST
from r2bspec.spec.source import Read, Source, accept, decode, read_file
from r2bspec.spec.tree import MapNode, ScalarNode, TreeNode, UnknownNode, lookup, span_at, to_plain
from r2bspec.spec.typed import to_spec
from r2bspec.spec.validator import schema
from r2bspec.spec.variables import substitute
from r2bspec.spec.violations import explain_violations


@dataclass(frozen=True, slots=True)
class Loaded:
    """What a file turned out to be.

    Attributes:
        file: the name of the file as the user gave it; every span uses it.
        base_dir: the folder to which paths in the document are relative.
        spec: the typed document; None if and only if there are errors.
        tree: the located document after substitution; None where the text is not YAML.
        diagnostics: all that was found, sorted by place.
        sources: the texts that spans point into, by file name; options are among them.
        used_variables: names of the variables that were substituted somewhere.
    """

    file: str
    base_dir: FilePath
    spec: Spec | None
    tree: TreeNode | None
    diagnostics: tuple[Diagnostic, ...]
    sources: Mapping[str, Source] = field(repr=False)
    used_variables: frozenset[str] = frozenset()

    def span(self, path: Path, key: bool = False) -> Span:
        """Where the value at a path stands, or its key.

        Where there is no such value (a default, a key that is missing), the place is the key of
        the nearest ancestor that exists.
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
        """The texts of `sources`, as renderers of diagnostics want them."""
        return {name: source.text for name, source in self.sources.items()}

    def resolved_yaml(self) -> str:
        """The document as YAML, with options, variables and merge keys written out."""
        from r2bspec.spec.dump import to_yaml

        return to_yaml(to_plain(self.tree)) if self.tree is not None else ""


def load_spec(
    source: FilePath | str | bytes,
    *,
    file: str = "<text>",
    sets: Sequence[str] = (),
    variables: Mapping[str, bool | int | float | str] | None = None,
    environ: Mapping[str, str] | None = None,
) -> Loaded:
    """Load one spec. Never raises for any content: whatever is wrong is in `diagnostics`.

    Args:
        source: the path of a file (``Path("-")`` is standard input), or the text itself.
        file: the name for a text that is given as such; its folder is `base_dir`.
        sets: values to replace, each as ``path=value``.
        variables: values for declared variables. A string is read as an unquoted YAML scalar.
        environ: where ``$(env X)`` looks; the environment of this process by default.
    """
    read = _read(source, file)
    base_dir = FilePath(read.source.file).parent
    found = list(read.diagnostics)
    sources: dict[str, Source] = {read.source.file: read.source}
    tree: TreeNode | None = None
    if read.usable:
        composed = compose(read.source)
        found += composed.diagnostics
        tree = composed.tree
    if tree is None:
        return Loaded(read.source.file, base_dir, None, None, _sorted(found), sources)

    overridden = apply_overrides(tree, sets, variables or {})
    found += overridden.problems.found
    sources |= overridden.sources
    tree = without_extensions(overridden.tree, schema())
    used: frozenset[str] = frozenset()
    if isinstance(tree, MapNode):
        environment = os.environ if environ is None else environ
        substituted = substitute(tree, schema(), sources, environment)
        found += substituted.diagnostics
        tree, used = substituted.tree, substituted.used
    spec: Spec | None = None
    if not isinstance(tree, UnknownNode):
        violations = explain_violations(tree, sources)
        found += [*violations, *exclusive_errors(tree, violations)]
    if all(one.severity is not Severity.ERROR for one in found):
        spec = to_spec(to_plain(tree))
    return Loaded(read.source.file, base_dir, spec, tree, _sorted(found), sources, used)


def _read(source: FilePath | str | bytes, file: str) -> Read:
    if isinstance(source, FilePath):
        return read_file(source)
    if isinstance(source, bytes):
        return decode(source, file)
    return accept(source, file)


def _sorted(found: list[Diagnostic]) -> tuple[Diagnostic, ...]:
    """By place; the same finding at the same place, as aliases bring it, is told once."""
    unique = {(one.code, one.span, one.message): one for one in reversed(found)}
    ordered = sorted(unique.values(), key=lambda one: one.sort_key)
    if len(ordered) > MOST:
        place = ordered[MOST].span
        message = f"after {MOST:,} problems, further ones are not shown"
        ordered[MOST:] = [Diagnostic("R2B005", Severity.INFO, message, place)]
    return tuple(ordered)
