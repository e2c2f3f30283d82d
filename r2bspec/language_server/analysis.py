"""What the compiler knows about documents: the open texts, and the newest analysis of each.

An analysis belongs to one version of the texts: its cases, contexts and findings. An analysis that
is finished after a text has changed again is dropped, so that nothing stale is shown.

While a spec is being written, it is rarely valid: the names of its bag and its nodes are then those
of its last valid text.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final

from r2bspec.check.check_context import Context, DocumentFiles
from r2bspec.check.engine import check_cases, context_of
from r2bspec.diagnostics import Diagnostic
from r2bspec.language.document import Source
from r2bspec.language.load_spec import LoadedSpec, load_cases
from r2bspec.language.located_tree import TreeNode
from r2bspec.language.yaml_document import compose
from r2bspec.safe_io.safe_file import unsaved_files
from r2bspec.safe_io.shared_lookups import shared_lookups


@dataclass(frozen=True)
class Analysis:
    """The analysis of one version of a document.

    Attributes:
        path: the path of the file, absolute.
        text: of this version.
        cases: the cases of its matrix; the document itself without one. Never empty.
        contexts: the contexts of each case; None for one with errors.
        diagnostics: all findings of `r2bspec validate`, sorted by place, also those in other files.
        known: the context, or that of the last valid version; None if there was none.
    """

    path: Path
    text: str = field(repr=False)
    cases: tuple[LoadedSpec, ...] = field(repr=False)
    contexts: tuple[Context | None, ...] = field(repr=False)
    diagnostics: tuple[Diagnostic, ...] = field(repr=False)
    known: Context | None = field(default=None, repr=False)

    @property
    def loaded(self) -> LoadedSpec:
        """The first case: what editors show of a document with several cases."""
        return self.cases[0]

    @property
    def context(self) -> Context | None:
        """The context of the first case that has a context."""
        return next((context for context in self.contexts if context is not None), None)

    @property
    def sources(self) -> Mapping[str, Source]:
        """The texts of the document and of the files that it extends, without options."""
        return self.loaded.sources

    @cached_property
    def written(self) -> Mapping[str, TreeNode]:
        """The text of each file, before anything is extended or substituted."""
        trees = {name: compose(source).tree for name, source in self.sources.items()}
        return {name: tree for name, tree in trees.items() if tree is not None}

    @property
    def tree(self) -> TreeNode | None:
        """The document itself as it is written; None if it cannot be parsed."""
        return self.written.get(str(self.path))


def analyse(path: Path, text: str, unsaved: Mapping[Path, str] | None = None) -> Analysis:
    """Validate a text as the content of a file; nothing that it names is executed.

    Args:
        path: the path of the file, absolute; it need not exist.
        text: the text, saved or not.
        unsaved: the texts of other open files, which take the place of what is on disk.
    """
    with unsaved_files(unsaved or {}), shared_lookups():
        cases = load_cases(text, file=str(path))
        files = DocumentFiles(cases[0].base_dir)
        contexts = tuple(context_of(case, files=files) for case in cases)
        findings = check_cases(cases, contexts=contexts)
    return Analysis(path, text, cases, contexts, tuple(findings))


_IS_SPEC: Final = re.compile(r"^r2bspec[ \t]*:", re.MULTILINE)


@dataclass(frozen=True)
class OpenDocument:
    """A document as it is in the editor.

    Attributes:
        text: of this version.
        version: as the editor counts; None if it does not say.
        uri: by which the editor names it.
        resolved: the path without links.
    """

    text: str
    version: int | None
    uri: str
    resolved: Path

    @cached_property
    def is_spec(self) -> bool:
        """Whether it is a spec, not a part that only others extend."""
        return _IS_SPEC.search(self.text) is not None


class OpenSpecs:
    """Documents by path, and the analyses of those that are specs."""

    def __init__(self) -> None:
        self._documents: dict[Path, OpenDocument] = {}
        self._latest: dict[Path, Analysis] = {}
        self._readable: dict[Path, Analysis] = {}
        self.generation = 0

    def change(self, path: Path, text: str, version: int | None = None, uri: str = "") -> None:
        """Store a text that was opened or changed."""
        self.generation += 1
        self._documents[path] = OpenDocument(text, version, uri, _resolved(path))

    def close(self, path: Path) -> None:
        """Forget a text; the file on disk counts again."""
        self.generation += 1
        for documents in (self._documents, self._latest, self._readable):
            documents.pop(path, None)

    def touch(self) -> None:
        """Note that a file on disk has changed."""
        self.generation += 1

    def text(self, path: Path) -> str | None:
        """Return the newest text of a document; None if it is not open."""
        document = self._documents.get(path)
        return document.text if document is not None else None

    def document(self, path: Path) -> OpenDocument | None:
        """Return a document as it is in the editor; None if it is not open."""
        return self._documents.get(path)

    def specs(self) -> list[Path]:
        """Return the open documents that are specs, not parts that only others extend."""
        return [path for path, document in self._documents.items() if document.is_spec]

    def analyse(self, path: Path) -> Analysis:
        """Analyse the newest text of a document; takes time, and keeps nothing."""
        document = self._documents.get(path)
        text = document.text if document is not None else ""
        return analyse(path, text, self.unsaved())

    def keep(self, analysis: Analysis) -> None:
        """Keep an analysis as the newest of its document."""
        path, before = analysis.path, self._latest.get(analysis.path)
        known = analysis.context or (before.known if before is not None else None)
        self._latest[path] = analysis = replace(analysis, known=known)
        if analysis.tree is not None:
            self._readable[path] = analysis

    def readable(self, path: Path) -> Analysis | None:
        """Return the newest analysis of a text that could be parsed."""
        return self._readable.get(path)

    def affected_by(self, path: Path) -> list[Path]:
        """Return the open specs whose findings may change with a document."""
        specs = self.specs()
        readers = [
            spec
            for spec in specs
            if spec != path and str(path) in getattr(self._latest.get(spec), "sources", ())
        ]
        if path in specs:
            return [path, *readers]
        # Part of a spec, or a file that one names: an interface, parameters, a Python file.
        return specs

    def current(self, path: Path) -> Analysis:
        """Return the analysis of the newest text, which is made if there is none."""
        if not self.is_analysed(path):
            self.keep(self.analyse(path))
        return self._latest[path]

    def is_analysed(self, path: Path) -> bool:
        """Return True if the newest text of a document was analysed."""
        latest = self._latest.get(path)
        return latest is not None and latest.text == self.text(path)

    def unsaved(self) -> Mapping[Path, str]:
        """Return the texts of all open files, by their resolved paths.

        An analysis asks on a thread of its own, while documents are opened and closed.
        """
        documents = list(self._documents.values())
        return {document.resolved: document.text for document in documents}


def _resolved(path: Path) -> Path:
    """Return the path without links.

    One that cannot be resolved, as in a loop of links, as it is.
    """
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError):
        return path
