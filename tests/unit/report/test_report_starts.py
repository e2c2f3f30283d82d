"""Of how many starts of the processes a verdict is, and what a start took."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import replace

import msgspec
import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.verdict import RequirementVerdict, outcome_of
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import StartRecord
from r2bspec.report.html.page import render
from r2bspec.report.report_wording import BUDGET_CAPTION, starts_text
from r2bspec.report.terminal import to_text
from report_runs import with_starts

ONE = "f this start of the processes: "


def started(
    number: int, cost_s: float, *, overhead_s: float = 0.0, confirms: bool = False
) -> StartRecord:
    return StartRecord(
        number=number,
        began_ns=0,
        ready_ns=round((cost_s + overhead_s) * 1e9),
        overhead_ns=round(overhead_s * 1e9),
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


def test_a_verdict_without_requirements_is_about_nothing(usual: Callable[[int], Run]) -> None:
    verdict = result_of(usual(3), {}).verdict
    assert verdict.reason == outcome_of(())[1] == "The spec has no objective to judge."
    assert not verdict.limits


def test_the_cost_is_that_of_a_start_after_the_first_without_the_harness_overhead() -> None:
    assert starts_text(()) == ""
    assert starts_text([started(1, 4.0, overhead_s=1.5)]) == "1 start, 4 s"
    assert starts_text([started(1, 9.0), started(2, 3.0)]) == "2 starts, 3 s each"
    confirmed = [started(1, 9.0), started(2, 3.0, confirms=True)]
    assert starts_text(confirmed) == "1 start and 1 to confirm, 3 s each"


def test_only_strict_refuses_a_pass_of_a_disturbed_start(usual: Callable[[int], Run]) -> None:
    run = usual(3)
    first, second, third = run.record.starts
    busy = msgspec.structs.replace(second, disturbed=("other processes were busy",), taken=0.9)
    record = msgspec.structs.replace(run.record, starts=(first, busy, third))

    def judged(policy: str) -> tuple[RequirementVerdict, ...]:
        gate = msgspec.structs.replace(run.plan.gate, interference=policy)
        plan = msgspec.structs.replace(run.plan, gate=gate)
        return result_of(replace(run, plan=plan, record=record)).verdict.requirements

    undisturbed = [requirement.outcome for requirement in result_of(run).verdict.requirements]
    assert "pass" in undisturbed
    for policy in ("tolerate", "note"):
        assert [one.outcome for one in judged(policy)] == undisturbed
    refused = [
        one
        for one, was in zip(judged("strict"), undisturbed, strict=True)
        if was == "pass" and one.method != "search bracket"
    ]
    assert {one.outcome for one in refused} == {"inconclusive"}
    assert all("while start 2 came up" in one.notes[-1] for one in refused)


def test_the_budget_is_in_the_text_on_request_and_in_the_page(usual: Callable[[int], Run]) -> None:
    run = usual(3)
    result = result_of(run)
    budgets = [
        requirement.budget
        for requirement in result.verdict.requirements
        if requirement.budget is not None
    ]
    assert budgets
    short, long = (to_text(result, verbose=verbose, width=160) for verbose in (False, True))
    assert "uncertainty" not in short
    assert f"uncertainty  {BUDGET_CAPTION}" in long
    words = " ".join(long.split())
    page = render(ReportInput(result, run)).decode()
    for number, one in enumerate(result.verdict.requirements):
        if one.budget is not None:
            assert one.budget.halve in words
            assert one.budget.halve in html.unescape(page)
            assert f'data-path="verdict/requirements/{number}/budget/half_width"' in page
