"""The report of a search, word for word. After a wanted change: `make generated`."""

from __future__ import annotations

from pathlib import Path

import pytest

import tuning_results
from golden import compare
from tuning_results import to_text

RESULTS = {"improved": tuning_results.improved(), "not_met": tuning_results.not_met()}


@pytest.mark.parametrize("name", RESULTS)
def test_the_report_reads_like_this(name: str) -> None:
    compare(to_text(RESULTS[name]), Path(__file__).with_name(f"{name}.txt"))
