"""The YAML merge key ``<<``: a map with an anchor, merged into other maps."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from r2bspec.diagnostics.diagnostic import Span
from r2bspec.language.located_tree import Entry, MapNode


class Merge(msgspec.Struct, frozen=True):
    """A map to be merged, and the place of its ``<<``."""

    span: Span
    source: MapNode


def merge_entries(merges: Iterable[Merge], own: dict[str, Entry]) -> dict[str, Entry]:
    """The entries of a map with `merges`; its own have precedence, then those of earlier merges.

    Merged entries come first and keep the place where they are written.
    """
    entries: dict[str, Entry] = {}
    for merge in merges:
        for key, entry in merge.source.entries.items():
            entries.setdefault(key, entry)
    return entries | own
