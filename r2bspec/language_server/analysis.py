"""What the compiler knows about one version of a document: its cases, contexts and findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from r2bspec.check.check_context import Context
from r2bspec.check.document_files import DocumentFiles
from r2bspec.check.engine import check_cases_in_contexts, context_of
from r2bspec.diagnostics import Diagnostic
from r2bspec.language.load_spec import LoadedSpec, load_cases
from r2bspec.language.located_tree import TreeNode
from r2bspec.language.source_text import Source
from r2bspec.language.yaml_composer import compose
from r2bspec.language_server.tentative_spec import tentative_context
from r2bspec.untrusted.looked_up_files import shared_lookups
from r2bspec.untrusted.unsaved_files import unsaved_files


@dataclass(frozen=True)
class Analysis:
    """One version of a document.

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
        """The first case: what editors show of a document with several."""
        return self.cases[0]

    @property
    def context(self) -> Context | None:
        """The context of the first case that has one."""
        return next((each for each in self.contexts if each is not None), None)

    @cached_property
    def known(self) -> Context | None:
        """The context, or, of a spec with errors, that of the rest; for what is proposed."""
        return self.context or tentative_context(self.loaded)

    @property
    def sources(self) -> Mapping[str, Source]:
        """The texts of the document and of the files that it extends, without options."""
        return self.loaded.sources

    @cached_property
    def written(self) -> Mapping[str, TreeNode]:
        """Each file as it is written: before anything is extended or substituted."""
        trees = {name: compose(source).tree for name, source in self.sources.items()}
        return {name: tree for name, tree in trees.items() if tree is not None}


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
        contexts = tuple(context_of(each, files=files) for each in cases)
        found = check_cases_in_contexts(cases, contexts)
    return Analysis(path, text, cases, contexts, tuple(found))
