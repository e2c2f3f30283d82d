"""The documents that are open: their newest texts, and the newest analysis of each.

An analysis belongs to one version of the texts. One that is finished after a text has changed
again is dropped, so that nothing stale is shown.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from r2bspec.language_server.analysis import Analysis, analyse

_IS_SPEC: Final = re.compile(r"^r2bspec[ \t]*:", re.MULTILINE)


class OpenSpecs:
    """Texts by path, and what is known of those that are specs."""

    def __init__(self) -> None:
        self._texts: dict[Path, str] = {}
        self._latest: dict[Path, Analysis] = {}
        self._valid: dict[Path, Analysis] = {}
        self.generation = 0

    def change(self, path: Path, text: str) -> None:
        """Take over a text that was opened or changed."""
        self.generation += 1
        self._texts[path] = text

    def close(self, path: Path) -> None:
        """Forget a text; what is on disk counts again."""
        self.generation += 1
        for known in (self._texts, self._latest, self._valid):
            known.pop(path, None)

    def touch(self) -> None:
        """Take notice that a file on disk has changed."""
        self.generation += 1

    def text(self, path: Path) -> str:
        """The newest text of a document; empty if it is not open."""
        return self._texts.get(path, "")

    def specs(self) -> list[Path]:
        """The open documents that are specs, and not parts that only others extend."""
        return [path for path, text in self._texts.items() if _IS_SPEC.search(text)]

    def analyse(self, path: Path) -> Analysis:
        """Analyse the newest text of a document; takes time, and keeps nothing."""
        return analyse(path, self._texts.get(path, ""), self.unsaved())

    def keep(self, analysis: Analysis) -> None:
        """Keep an analysis as the newest one of its document."""
        self._latest[analysis.path] = analysis
        if analysis.context is not None:
            self._valid[analysis.path] = analysis

    def latest(self, path: Path) -> Analysis | None:
        """The newest analysis; of an older text while a newer one is being analysed."""
        return self._latest.get(path)

    def latest_known(self, path: Path) -> Analysis | None:
        """The newest analysis from which names can be proposed; otherwise the newest."""
        latest = self._latest.get(path)
        if latest is None or latest.known is not None:
            return latest
        return self._valid.get(path, latest)

    def affected_by(self, path: Path) -> list[Path]:
        """The open specs of which the findings may change with a document."""
        specs = self.specs()
        readers = [
            each
            for each in specs
            if each != path and str(path) in getattr(self._latest.get(each), "sources", ())
        ]
        if path in specs:
            return [path, *readers]
        # Part of a spec, or a file that one names: an interface, parameters, a Python file.
        return specs

    def current(self, path: Path) -> Analysis:
        """The analysis of the newest text; made now if there is none."""
        latest = self._latest.get(path)
        if latest is None or latest.text != self.text(path):
            latest = self.analyse(path)
            self.keep(latest)
        return latest

    def is_analysed(self, path: Path) -> bool:
        """Whether the newest text of a document is the one that was analysed."""
        latest = self._latest.get(path)
        return latest is not None and latest.text == self.text(path)

    def unsaved(self) -> Mapping[Path, str]:
        """The texts of all open files, by their resolved paths.

        An analysis asks on a thread of its own, while documents are opened and closed.
        """
        return {path.resolve(): text for path, text in list(self._texts.items())}
