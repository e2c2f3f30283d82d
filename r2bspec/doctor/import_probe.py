"""Imports modules and prints the results: ``python -m r2bspec.doctor.import_probe NAME…``.

It runs in its own process, so that imports are timed in a new interpreter and a broken
installation cannot crash the doctor. ``module:function`` also calls the function.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import sys
import time
from typing import Any


def probe(name: str) -> dict[str, Any]:
    """Import one module: seconds, version, file and the result of the function, or the error."""
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
    """Probe the names on the command line, and print a JSON object."""
    # Modules may print while they are imported; standard output is for the result.
    with contextlib.redirect_stdout(sys.stderr):
        probes = {name: probe(name) for name in sys.argv[1:]}
    print(json.dumps(probes))  # noqa: T201 - the result


if __name__ == "__main__":
    main()
