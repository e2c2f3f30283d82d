"""Python's cyclic garbage collector, paused while a document is read."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def gc_paused() -> Iterator[None]:
    """Pause the collector.

    Reading makes very many values and no cycles: the collector would walk them all, again and
    again, and find nothing. How much there can be is bounded (`r2bspec.language.yaml_composer`).
    """
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
