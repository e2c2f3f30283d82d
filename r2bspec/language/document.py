"""A parsed document: with the files that it extends and with options, before its matrix.

Values come from extended files, siblings and repeated entries, and keep the place where they are
written. `ValueOrigins` are the places that led there: without them, a finding would be hard to
understand. Keys that begin with ``x-`` are for notes and anchors; the language ignores them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path as FilePath

import msgspec
from msgspec.structs import replace

from r2bspec.diagnostics import Diagnostic, Path, Related, Span
from r2bspec.language.declaration import Rule, language
from r2bspec.language.extended_files import extend
from r2bspec.language.extended_siblings import extend_siblings
from r2bspec.language.located_tree import Entry, MapNode, ScalarNode, TreeNode
from r2bspec.language.overrides import apply_overrides
from r2bspec.language.source_text import ReadResult, Source, decode, read_file, read_text
from r2bspec.language.yaml_composer import compose


class ValueOrigins(msgspec.Struct, frozen=True):
    """The origins of the values of one document.

    Attributes:
        files: for each file that is extended, the places that led to it, the nearest first.
        entries: for the path of an entry made from another, the place that says so.
    """

    files: Mapping[str, tuple[Related, ...]] = msgspec.field(default_factory=dict)
    entries: Mapping[Path, tuple[Related, ...]] = msgspec.field(default_factory=dict)

    def origins_of(self, path: Path, span: Span) -> tuple[Related, ...]:
        """The places that led to the value at a path, which is written at `span`."""
        found: list[Related] = []
        for length in range(1, len(path) + 1) if self.entries else ():
            found += self.entries.get(path[:length], ())
        return (*found, *self.files.get(span.file, ()))

    def with_origins(self, diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
        """The diagnostics, each with the places that led to its own."""
        if not self.files and not self.entries:
            return list(diagnostics)
        return [self._with_origins_of_one(one) for one in diagnostics]

    def _with_origins_of_one(self, one: Diagnostic) -> Diagnostic:
        new = tuple(each for each in self.origins_of(one.path, one.span) if each not in one.related)
        return replace(one, related=(*one.related, *new)) if new else one


PREFIX = "x-"


def without_extensions(root: TreeNode, rule: Rule) -> TreeNode:
    """The tree without ``x-`` keys in maps whose keys `rule` defines.

    In maps whose keys are names given by the user, such a key is an ordinary name. Shared values
    stay shared.
    """
    done: dict[tuple[int, int], TreeNode] = {}

    def strip(node: TreeNode, rule: Rule | None) -> TreeNode:
        if rule is None or not isinstance(node, MapNode):
            return node
        name = (id(node), id(rule))
        if name not in done:
            done[name] = strip_map(node, rule)
        return done[name]

    def strip_map(node: MapNode, rule: Rule) -> MapNode:
        known = rule.keys
        entries: dict[str, Entry] = {}
        changed = False
        for key, entry in node.entries.items():
            if known is not None and key.startswith(PREFIX):
                changed = True
                continue
            if type(entry.value) is MapNode:
                value = strip(entry.value, rule.below(key))
                if value is not entry.value:
                    changed = True
                    entry = Entry(entry.key_span, value, entry.key_resolved)
            entries[key] = entry
        return MapNode(entries, node.span) if changed else node

    return strip(root, rule)


Variables = Mapping[str, bool | int | float | str]


class ParsedDocument(msgspec.Struct):
    """What all cases of a document share.

    Attributes:
        tree: None where the text is not YAML.
        files: for each extended file, the places that led to it.
        entries: for each entry that extends a sibling, the place that says so.
        incomplete: paths that extend something that does not exist; the empty path is the
            document.
    """

    file: str
    tree: TreeNode | None
    diagnostics: list[Diagnostic]
    sources: dict[str, Source]
    files: dict[str, tuple[Related, ...]] = msgspec.field(default_factory=dict)
    entries: dict[Path, tuple[Related, ...]] = msgspec.field(default_factory=dict)
    incomplete: set[Path] = msgspec.field(default_factory=set)

    @property
    def base_dir(self) -> FilePath:
        """The folder to which paths in the document are relative."""
        return FilePath(self.file).parent


def open_document(
    source: FilePath | str | bytes,
    file: str,
    sets: Sequence[str],
    variables: Variables,
    allow_paths: Iterable[FilePath],
) -> ParsedDocument:
    """Read a document, up to its matrix."""
    allow_paths = tuple(allow_paths)
    read = _read(source, file, allow_paths)
    document = ParsedDocument(
        read.source.file, None, list(read.diagnostics), {read.source.file: read.source}
    )
    if read.usable:
        composed = compose(read.source)
        document.diagnostics += composed.diagnostics
        document.tree = composed.tree
        if isinstance(composed.tree, ScalarNode):
            # It is no spec, and perhaps a file of secrets: findings show no line of it.
            blank = "\n" * (len(read.source.lines) - 1)
            document.sources[read.source.file] = Source(read.source.file, blank)
    if document.tree is None:
        return document
    extended = extend(document.tree, document.file, language(), allow_paths)
    siblings = extend_siblings(extended.tree)
    overridden = apply_overrides(siblings.tree, sets, variables)
    for problems in (extended.problems, siblings.problems, overridden.problems):
        document.diagnostics += problems.diagnostics
    document.sources |= extended.sources | overridden.sources
    document.files, document.entries = extended.origins, siblings.origins
    document.incomplete = siblings.incomplete | (set() if extended.complete else {()})
    document.tree = without_extensions(overridden.tree, language())
    return document


def _read(source: FilePath | str | bytes, file: str, allow_paths: Iterable[FilePath]) -> ReadResult:
    if isinstance(source, FilePath):
        return read_file(source, allow_paths)
    if isinstance(source, bytes):
        return decode(source, file)
    return read_text(source, file)
