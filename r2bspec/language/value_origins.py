"""How a value got to where it is: told beside every finding about it.

Values come from other files, from siblings and from repeated entries, and keep the place where
they were written. That place alone would be a riddle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from r2bspec.diagnostics import Diagnostic, Path, Related, Span


@dataclass(frozen=True, slots=True)
class ValueOrigins:
    """The ways of one document.

    Attributes:
        files: for each file that is extended, the places that led to it, the nearest first.
        entries: for the path of an entry that was made of another, the place that asked for it.
    """

    files: Mapping[str, tuple[Related, ...]] = field(default_factory=dict)
    entries: Mapping[Path, tuple[Related, ...]] = field(default_factory=dict)

    def origins_of(self, path: Path, span: Span) -> tuple[Related, ...]:
        """What led to the value at a path, which was written at `span`."""
        found: list[Related] = []
        for length in range(1, len(path) + 1) if self.entries else ():
            found += self.entries.get(path[:length], ())
        return (*found, *self.files.get(span.file, ()))

    def with_origins(self, diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
        """The diagnostics, each with what led to its place."""
        if not self.files and not self.entries:
            return list(diagnostics)
        return [self._with_origins_of_one(one) for one in diagnostics]

    def _with_origins_of_one(self, one: Diagnostic) -> Diagnostic:
        new = tuple(each for each in self.origins_of(one.path, one.span) if each not in one.related)
        return replace(one, related=(*one.related, *new)) if new else one
