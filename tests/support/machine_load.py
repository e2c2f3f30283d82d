"""Skipping what a busy machine cannot measure, so that the summary of the tests can name it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
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
