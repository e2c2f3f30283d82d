"""The C of the harness is small enough to be read in one go when a measurement is doubted."""

from __future__ import annotations

from pathlib import Path

import r2bspec.native

MOST_LINES = 1_200
MOST_COLUMNS = 100


def test_the_c_can_be_read_in_one_go() -> None:
    # What does not have to be on time, or in a process of the graph, belongs into Python.
    folder = Path(r2bspec.native.__file__).parent
    sources = {each.name: each.read_text().splitlines() for each in folder.glob("*.[ch]")}
    assert {"player.c", "monitor.c", "join.c", "harness.h"} <= set(sources)
    counts = {name: len(lines) for name, lines in sources.items()}
    assert sum(counts.values()) <= MOST_LINES, counts
    # Room is not made by longer lines.
    too_long = [
        (name, line)
        for name, lines in sources.items()
        for line in lines
        if len(line) > MOST_COLUMNS
    ]
    assert not too_long
