"""The formats of findings, by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from r2bspec.diagnostics import Diagnostic

FORMATS = {
    "text": "for people",
    "json": "for programs",
    "github": "annotations of a change on GitHub",
    "sarif": "SARIF 2.1.0 for code scanning",
    "junit": "JUnit XML for test reports",
}
"""Each format and its use."""

DOCUMENT_FORMATS = frozenset({"json", "sarif", "junit"})
"""Formats that are one document; nothing else may be printed to the same stream."""


def render(
    name: str,
    diagnostics: Iterable[Diagnostic],
    sources: Mapping[str, str],
    files: Iterable[str],
    *,
    colour: bool = False,
) -> str:
    """The findings in the format of that name.

    Args:
        name: one of `FORMATS`.
        diagnostics: the findings in their order.
        sources: the texts that they point into, by file name.
        files: every file that was checked, with findings or without.
        colour: whether text is coloured.
    """
    if name == "sarif":
        from r2bspec.report.findings import sarif

        return sarif.render(diagnostics, sources, files)
    if name == "junit":
        from r2bspec.report.findings import junit

        return junit.render(diagnostics, sources, files)
    if name == "json":
        from r2bspec.report.findings import json

        return json.render(diagnostics, sources)
    if name == "github":
        from r2bspec.report.findings import github

        return github.render(diagnostics, sources)
    from r2bspec.report.findings import text

    blocks = text.render(diagnostics, sources, colour=colour)
    return blocks + "\n" if blocks else ""
