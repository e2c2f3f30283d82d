"""Tests that are skipped for load are counted and named at the end of the run."""

from __future__ import annotations

import pytest

from machine_load import load_summary, skip_for_load


def report(nodeid: str, reason: str) -> pytest.TestReport:
    return pytest.TestReport(
        nodeid, ("", None, ""), {}, "skipped", ("file.py", 1, f"Skipped: {reason}"), "setup"
    )


def reason_of_skip() -> str:
    with pytest.raises(pytest.skip.Exception) as caught:
        skip_for_load("play on time")
    return str(caught.value)


def test_skips_for_load_are_counted_by_module() -> None:
    loaded = reason_of_skip()
    skipped = [
        report("tests/ros/test_b.py::test_one", loaded),
        report("tests/ros/test_a.py::test_two", loaded),
        report("tests/ros/test_a.py::test_three[case::1]", loaded),
        report("tests/ros/test_c.py::test_four", "no Chromium is installed"),
    ]
    assert load_summary(skipped) == [
        "skipped because the machine is too loaded: 3",
        "  tests/ros/test_a.py: 2 tests",
        "  tests/ros/test_b.py: 1 tests",
    ]


def test_the_line_comes_also_where_nothing_was_skipped() -> None:
    assert load_summary([]) == ["skipped because the machine is too loaded: 0"]
