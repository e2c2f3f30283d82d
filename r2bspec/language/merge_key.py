"""The merge key ``<<``: maps written once under an anchor and taken up elsewhere."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from r2bspec.diagnostics.diagnostic import Span
from r2bspec.language.located_tree import Entry, MapNode


@dataclass(frozen=True, slots=True)
class Merge:
    """One map to be merged, and where the ``<<`` stands that asks for it."""

    span: Span
    source: MapNode


def merge_entries(merges: Iterable[Merge], own: dict[str, Entry]) -> dict[str, Entry]:
    """The entries of a map with `merges`; its own win, then those of the earlier merge.

    Merged entries come first and keep the place where they were written.
    """
    entries: dict[str, Entry] = {}
    for merge in merges:
        for key, entry in merge.source.entries.items():
            entries.setdefault(key, entry)
    return entries | own
