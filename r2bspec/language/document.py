"""A parsed document: with the files that it extends and with options, before its matrix."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path as FilePath

import msgspec

from r2bspec.diagnostics import Diagnostic, Path, Related
from r2bspec.language.declaration import language
from r2bspec.language.extend import extend, extend_siblings
from r2bspec.language.extension_keys import without_extensions
from r2bspec.language.located_tree import ScalarNode, TreeNode
from r2bspec.language.overrides import apply_overrides
from r2bspec.language.source_text import ReadResult, Source, decode, read_file, read_text
from r2bspec.language.yaml_composer import compose

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
