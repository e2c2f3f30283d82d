"""Imports modules and says what came of it: ``python -m r2bspec.doctor.import_probe NAME…``.

Runs in a process of its own, so that each import is timed from a fresh interpreter and a broken
installation cannot take the doctor down. ``module:function`` also calls the function.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import sys
import time
from typing import Any


def probe(name: str) -> dict[str, Any]:
    """Import one module: seconds, version, file and what the function said, or the error."""
    module_name, _, function = name.partition(":")
    began = time.perf_counter()
    try:
        module = importlib.import_module(module_name)
        seconds = time.perf_counter() - began
        said = getattr(module, function)() if function else None
    except BaseException as error:
        return {"error": f"{type(error).__name__}: {error}"}
    return {
        "seconds": seconds,
        "version": str(getattr(module, "__version__", "")),
        "file": str(getattr(module, "__file__", "") or ""),
        "said": None if said is None else str(said),
    }


def main() -> None:
    """Probe what the command line names; prints one JSON object."""
    # What modules print while they are imported must not get between.
    with contextlib.redirect_stdout(sys.stderr):
        found = {name: probe(name) for name in sys.argv[1:]}
    print(json.dumps(found))  # noqa: T201 - the answer


if __name__ == "__main__":
    main()
