"""What can be started from a document, and how it went the last time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from lsprotocol import types

from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.editor_commands import (
    DRAW_GRAPH,
    PLAN,
    RUN,
    SHOW_RESULT,
    SMOKE,
    SpecCommand,
)
from r2bspec.language_server.latest_result import latest_result
from r2bspec.language_server.text_positions import TextPositions

_MAX_CASES: Final = 8
"""Cases with lenses of their own; a long line of them could not be read."""


def code_lenses(
    analysis: Analysis, positions: TextPositions, folder: Path
) -> Iterator[types.CodeLens]:
    """The lenses of a document: of each case one line.

    Args:
        analysis: of the document.
        positions: of its text.
        folder: in which runs are started.
    """
    if analysis.context is None:
        return
    place = analysis.loaded.span(("name",), key=True)
    if place.file != str(analysis.path):
        # The name is in an extended file: the lenses are at the beginning of this one.
        where = positions.range_of_offsets(0, 0)
    else:
        where = positions.range(place)
    for loaded in analysis.cases[:_MAX_CASES]:
        about = SpecCommand(str(analysis.path), loaded.case)
        suffix = f" {loaded.case}" if loaded.case else ""
        for title, name in (("run", RUN), ("smoke", SMOKE), ("plan", PLAN), ("graph", DRAW_GRAPH)):
            if not suffix or name in {RUN, SMOKE}:
                yield types.CodeLens(where, about.as_command(f"{title}{suffix}", name))
        latest = latest_result(loaded.id, folder)
        if latest is not None:
            shown = types.Command(latest.text, SHOW_RESULT, arguments=[str(latest.folder)])
            yield types.CodeLens(where, shown)
