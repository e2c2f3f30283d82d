"""A document while it is loaded: one value that each step changes, and what it found.

Values come from extended files, siblings and repeated entries, and keep the place where they are
written. `ValueOrigins` are the places that led there: without them, a finding would be hard to
understand.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path as FilePath

import msgspec
from msgspec.structs import replace

from r2bspec.diagnostics import Diagnostic, Path, Related, Span
from r2bspec.language.located_tree import TreeNode
from r2bspec.language.source_text import DiagnosticCollector, Source


class ValueOrigins(msgspec.Struct, frozen=True):
    """The origins of the values of one document.

    Attributes:
        files: for each file that is extended, the places that led to it, the nearest first.
        entries: for the path of an entry made from another, the place that says so.
    """

    files: dict[str, tuple[Related, ...]] = msgspec.field(default_factory=dict)
    entries: dict[Path, tuple[Related, ...]] = msgspec.field(default_factory=dict)

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


class Document(msgspec.Struct):
    """What all cases of a document share.

    Attributes:
        tree: None where the text is not YAML.
        sources: the texts that places point into, by file name.
        incomplete: paths that extend something that does not exist; the empty path is the
            document.
    """

    file: str
    tree: TreeNode | None = None
    problems: DiagnosticCollector = msgspec.field(default_factory=DiagnosticCollector)
    sources: dict[str, Source] = msgspec.field(default_factory=dict)
    origins: ValueOrigins = msgspec.field(default_factory=ValueOrigins)
    incomplete: set[Path] = msgspec.field(default_factory=set)

    @property
    def base_dir(self) -> FilePath:
        """The folder to which paths in the document are relative."""
        return FilePath(self.file).parent
