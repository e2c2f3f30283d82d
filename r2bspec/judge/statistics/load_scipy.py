"""Importing SciPy ahead of its first use, which takes a third of a second of processor time.

The first use is otherwise the first look at a probe, while it plays: the import would take a core
from the graph under test.
"""

from __future__ import annotations

import contextlib
import importlib
import threading


def load_scipy() -> threading.Thread:
    """Import it in a thread; it has to be joined before anything is measured."""
    thread = threading.Thread(target=_import, name="import of SciPy", daemon=True)
    thread.start()
    return thread


def _import() -> None:
    # The first use says that it is missing, and how to install it.
    with contextlib.suppress(ImportError):
        importlib.import_module("scipy.special")
