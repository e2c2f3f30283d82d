"""Comparisons and starts in every report: ratios, intervals, margins, pairs, phases of a start."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from command_line import Call
from example_spec import example
from pair_simulation import Comparison
from r2bspec.compare.report_input import ReportInput, read_folder
from r2bspec.judge.measure.units import show
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.record.comparison_folder import PairedComparison
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import StartRecord
from r2bspec.report.format_registry import FORMATS, check_installed, renderer
from r2bspec.report.wording import bounds_text
from report_runs import with_starts

# Comparisons in every report: base, head, their ratio with its interval, margin, and pairs.


NOISE = np.exp([0.004, -0.006, 0.003, -0.002, 0.005, -0.004])
SHOWN = ("text", "markdown", "html", "junit", "github")
"""The formats that a person reads."""


@pytest.fixture(name="pairs", scope="module")
def pairs_folder(tmp_path_factory: pytest.TempPathFactory) -> PairedComparison:
    comparison = Comparison(
        (0.020 * NOISE).tolist(), (0.022 * NOISE[::-1]).tolist(), unusable={2: "head: late"}
    )
    return comparison.write(tmp_path_factory.mktemp("report") / "pairs")


def ratio(found: ReportInput) -> RequirementVerdict:
    return next(
        requirement
        for requirement in found.result.verdict.requirements
        if requirement.compared is not None
    )


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_takes_a_comparison_and_people_are_shown_ratio_interval_margin_and_pairs(
    pairs: PairedComparison, name: str
) -> None:
    check_installed(name)
    found = read_folder(pairs.folder)
    report = renderer(name)(found)
    assert report
    if name not in SHOWN:
        return
    one = ratio(found)
    assert one.compared is not None
    text = " ".join(report.decode().replace("\\", "").replace("%25", "%").split())
    base, head = (show(value, "s") for value in (one.compared.base, one.compared.head))
    for said in (base, head, "105 %", bounds_text(one)):
        assert said in text, said


def test_the_numbers_of_machines_have_the_ratio_too(pairs: PairedComparison) -> None:
    found = read_folder(pairs.folder)
    one = ratio(found)
    csv = renderer("csv")(found).decode()
    assert f"latency.p50.ratio,share,{one.estimate!r}" in csv


def test_judge_needs_neither_ros_nor_the_first_result(
    pairs: PairedComparison, call: Call, tmp_path: Path
) -> None:
    asked = ("judge", pairs.folder, "--format", "json")
    first = call(*asked, status=1).out
    assert json.loads(first)["pairs"]["planned"] == 6
    assert call(*asked, status=1).out == first
    looser = tmp_path / "looser.r2b.yaml"
    slos = "no_regression: {at: 30 Hz, require: [latency.p50 <= 130 % of baseline]}"
    looser.write_text(example("looser", slos=slos))
    judged = json.loads(call(*asked, "--spec", looser, status=0).out)
    assert judged["judged_by"] == "looser"


# Of how many starts of the processes a verdict is, and what a start took.


ONE = "f this start of the processes: "


def started(number: int, cost_s: float, *, confirms: bool = False) -> StartRecord:
    return StartRecord(
        number=number,
        began_ns=0,
        ready_ns=round(cost_s * 1e9),
        confirms=confirms,
    )


@pytest.fixture
def usual(usual_run: Run) -> Callable[[int], Run]:
    """The usual run of this number of starts."""
    return lambda starts: with_starts(
        usual_run, *(started(1 + number, 3) for number in range(starts))
    )


@pytest.mark.parametrize("name", ["silent", "empty", "hostile"])
def test_a_run_without_starts_in_its_record_is_one_start(
    reported: Callable[[str], ReportInput], name: str
) -> None:
    verdict = reported(name).result.verdict
    assert not reported(name).result.starts
    judged = verdict.outcome not in {"invalid", "incomplete"}
    assert verdict.starts == int(judged)
    assert (ONE in verdict.reason) == judged
