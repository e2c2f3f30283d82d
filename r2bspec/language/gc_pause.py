"""Python's cyclic garbage collector, paused while a document is read."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def gc_paused() -> Iterator[None]:
    """Pause the collector.

    Reading creates many values and no cycles: the collector would traverse them all repeatedly and
    free nothing. Their number is limited (`r2bspec.language.yaml_composer`).
    """
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
