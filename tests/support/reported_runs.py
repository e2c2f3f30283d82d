"""Simulated runs with their results and pages, made once for all tests that only read them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from r2bspec.compare.report_input import ReportInput
    from r2bspec.record.run_folder import Run


@pytest.fixture(scope="session")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], ReportInput]:
    """The input of the reports of a run of `report_runs.SIMULATIONS`, by its name."""
    from r2bspec.compare.report_input import ReportInput
    from r2bspec.judge.judge_run import result_of
    from report_runs import SIMULATIONS

    @cache
    def report_input(name: str) -> ReportInput:
        run = SIMULATIONS[name].write(tmp_path_factory.mktemp("report") / "run")
        return ReportInput(result=result_of(run), run=run)

    return report_input


@pytest.fixture(scope="session")
def usual_run(reported: Callable[[str], ReportInput]) -> Run:
    """The usual run, with everything that most tests of reports read."""
    run = reported("usual").run
    assert run is not None
    return run


@pytest.fixture(scope="session")
def html_page(reported: Callable[[str], ReportInput]) -> Callable[[str], bytes]:
    """The HTML page of such a run."""
    from r2bspec.report.html.page import render

    return cache(lambda name: render(reported(name)))


@pytest.fixture
def without_charts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages have no charts, which take most of their time: for tests of their words and links."""
    from r2bspec.report.html import page

    for name in ("_measurement_charts", "_load_charts"):
        monkeypatch.setattr(page, name, lambda _: ())
