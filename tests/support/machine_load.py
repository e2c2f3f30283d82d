"""Busy machines: programs that make a machine busy, and skipping what it then cannot measure.

The summary of the tests names what was skipped.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NoReturn

import pytest

TOO_LOADED = "this machine is too loaded to"
"""Begins the reason of every skip for load."""


def skip_for_load(what: str) -> NoReturn:
    """Skip a test, or all tests of a fixture: the machine is too loaded to do `what`."""
    pytest.skip(f"{TOO_LOADED} {what}")


def load_summary(skipped: Iterable[pytest.TestReport]) -> list[str]:
    """How many tests were skipped for load, and in which modules; a line always comes."""
    by_module = Counter(
        each.nodeid.partition("::")[0] for each in skipped if TOO_LOADED in _reason(each)
    )
    lines = [f"skipped because the machine is too loaded: {by_module.total()}"]
    lines += [f"  {module}: {count} tests" for module, count in sorted(by_module.items())]
    return lines


def _reason(report: pytest.TestReport) -> str:
    return report.longrepr[2] if isinstance(report.longrepr, tuple) else ""


BUSY = "while True: pass"


@contextlib.contextmanager
def busy_programs(number: int) -> Iterator[None]:
    """Keep so many processors busy."""
    programs = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(number)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()
