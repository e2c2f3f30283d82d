"""What the compiler knows about documents: the open texts, and the newest analysis of each.

An analysis belongs to one version of the texts: its cases, contexts and findings. An analysis that
is finished after a text has changed again is dropped, so that nothing stale is shown.

While a spec is being written, it is never valid. To complete names from its bag and its nodes, what
is wrong is left out and what is missing is filled in with the examples of the schema, until the
rest is valid (`tentative_context`). Nothing of that is shown as a finding.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from r2bspec.check.check_context import Context, DocumentFiles
from r2bspec.check.engine import check_cases, context_of
from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.diagnostics import Path as TreePath
from r2bspec.language.declaration import ValueRule, rule_at
from r2bspec.language.document import Source
from r2bspec.language.load_spec import LoadedSpec, load_cases, load_spec
from r2bspec.language.located_tree import TreeNode, to_plain
from r2bspec.language.matrix import KEY as MATRIX
from r2bspec.language.yaml_document import compose, to_yaml
from r2bspec.safe_io import limits
from r2bspec.safe_io.looked_up_files import shared_lookups
from r2bspec.safe_io.safe_file import unsaved_files

_MAX_ROUNDS: Final = 8
"""Each round repairs all errors that are seen; a repaired value may have further ones."""


def tentative_context(loaded: LoadedSpec) -> Context | None:
    """Return the context of the valid part of a document; None if no part is valid.

    Args:
        loaded: the document, with errors.
    """
    plain = to_plain(loaded.tree) if loaded.tree is not None else None
    if not isinstance(plain, dict):
        return None
    # Values may be shared, as those of aliases are.
    plain = copy.deepcopy(plain)
    plain.pop("extends", None)
    plain.pop(MATRIX, None)
    _fill(plain, ())
    for _ in range(_MAX_ROUNDS):
        attempt = load_spec(to_yaml(plain), file=loaded.file, environ={})
        if attempt.spec is not None:
            return context_of(attempt)
        if not _repair(plain, attempt.diagnostics):
            return None
    return None


def _repair(plain: dict[str, Any], found: Iterable[Diagnostic]) -> bool:
    """Remove what errors are about, deepest first, and fill in what is then missing."""
    before = copy.deepcopy(plain)
    paths = [finding.path for finding in found if finding.severity is Severity.ERROR]
    for path in sorted(paths, key=len, reverse=True):
        if path:
            _remove(plain, path)
    _fill(plain, ())
    return plain != before


def _remove(plain: dict[str, Any], path: TreePath) -> None:
    owner: Any = plain
    for part in path[:-1]:
        try:
            owner = owner[part]
        except (KeyError, IndexError, TypeError):
            return
    last = path[-1]
    if isinstance(owner, dict):
        owner.pop(last, None)
    elif isinstance(owner, list) and isinstance(last, int) and last < len(owner):
        del owner[last]


def _fill(value: Any, path: TreePath) -> None:
    """Drop the keys without a value, and add the required ones that are missing."""
    if isinstance(value, list):
        for index, item in enumerate(value):
            _fill(item, (*path, index))
    if not isinstance(value, dict):
        return
    for key in [key for key, below in value.items() if below is None]:
        del value[key]
    rule = rule_at(path)
    if rule is not None and rule.keys is not None:
        for key in rule.required:
            if key not in value:
                value[key] = _example(rule.keys[key])
    if rule is not None and rule.values is not None and rule.about.at_least and not value:
        value.update(_example(rule))
    for key, below in value.items():
        _fill(below, (*path, key))


def _example(rule: ValueRule) -> Any:
    return copy.deepcopy(rule.about.examples[0]) if rule.about.examples else "example"


@dataclass(frozen=True)
class Analysis:
    """The analysis of one version of a document.

    Attributes:
        path: of the file, absolute.
        text: of this version.
        cases: of its matrix; the document itself without one. Never empty.
        contexts: of each case; None for one with errors.
        diagnostics: all findings of `r2bspec validate`, sorted by place, also those in other files.
    """

    path: Path
    text: str = field(repr=False)
    cases: tuple[LoadedSpec, ...] = field(repr=False)
    contexts: tuple[Context | None, ...] = field(repr=False)
    diagnostics: tuple[Diagnostic, ...] = field(repr=False)

    @property
    def loaded(self) -> LoadedSpec:
        """The first case: what editors show of a document with several cases."""
        return self.cases[0]

    @property
    def context(self) -> Context | None:
        """The context of the first case that has a context."""
        return next((context for context in self.contexts if context is not None), None)

    @cached_property
    def known(self) -> Context | None:
        """The context; for a spec with errors, that of its valid part, for proposals."""
        if (
            self.context is None
            and len(self.text) * _MAX_ROUNDS <= limits.MAX_EDITOR_PARSED_CHARACTERS
        ):
            return tentative_context(self.loaded)
        return self.context

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
        path: of the file, absolute; it need not exist.
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
        self._valid: dict[Path, Analysis] = {}
        self.generation = 0

    def change(self, path: Path, text: str, version: int | None = None, uri: str = "") -> None:
        """Store a text that was opened or changed."""
        self.generation += 1
        self._documents[path] = OpenDocument(text, version, uri, _resolved(path))

    def close(self, path: Path) -> None:
        """Forget a text; the file on disk counts again."""
        self.generation += 1
        for documents in (self._documents, self._latest, self._valid):
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
        self._latest[analysis.path] = analysis
        if analysis.context is not None:
            self._valid[analysis.path] = analysis

    def latest(self, path: Path) -> Analysis | None:
        """Return the newest analysis; that of an older text while a newer text is analysed."""
        return self._latest.get(path)

    def latest_known(self, path: Path) -> Analysis | None:
        """Return the newest analysis from which names can be proposed, else the newest."""
        latest = self._latest.get(path)
        if latest is None or latest.known is not None:
            return latest
        return self._valid.get(path, latest)

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
