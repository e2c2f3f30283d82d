"""One document in every report: the same table, the same sentences, the same numbers."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from test_report_words import STARTS

from html_elements import Page
from r2bspec.compare.report_input import ReportInput
from r2bspec.errors import OUTPUT_FOLLOWS
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.measure.metrics import distribution
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import DisturbedIteration
from r2bspec.report.document import Detail, Table
from r2bspec.report.format_registry import renderer
from r2bspec.report.notes import idle_work_notes, notes
from r2bspec.report.result_document import result_document
from r2bspec.report.wording import headline
from report_runs import GraphSimulation, with_starts
from run_simulation import Played, objective

pytestmark = pytest.mark.usefixtures("without_charts")

PASSING = GraphSimulation(
    segments=[Played(30, np.tile(np.linspace(0.02, 0.031, 200), 3)) for _ in range(6)],
    objectives={"fast": objective("latency.p50 < 40 ms", "drop_rate <= 2 %")},
)


@pytest.fixture
def passing(tmp_path: Path) -> ReportInput:
    run = with_starts(PASSING.write(tmp_path / "run"), *STARTS)
    return ReportInput(result=result_of(run), run=run)


def test_an_ordinary_run_that_passes_has_no_note(passing: ReportInput) -> None:
    assert passing.result.verdict.outcome == "pass"
    assert notes(passing.result) == ()
    for name in ("text", "markdown"):
        lines = renderer(name)(passing).decode().splitlines()
        assert not [line for line in lines if line == "notes" or line.startswith(">")], name


def cells(table: Table) -> list[str]:
    return [cell.text for row in table.rows for cell in row.cells if cell.text]


@pytest.mark.parametrize(
    ("name", "detail"),
    [("text", Detail.ROOMY), ("markdown", Detail.COMMENT), ("html", Detail.PAGE)],
)
def test_every_medium_has_every_cell_that_it_has_room_for(
    reported: Callable[[str], ReportInput], name: str, detail: Detail
) -> None:
    report_input = reported("usual")
    content = renderer(name)(report_input)
    shown = Page(content).text if name == "html" else content.decode()
    flat = " ".join(re.sub(r"[\\`|]", "", shown).split()).replace("&lt;", "<")
    document = result_document(report_input, whole=True)
    tables = [
        block.shown(detail)
        for section in document.sections
        if section.detail <= detail
        for block in section.blocks
        if isinstance(block, Table) and block.detail <= detail
    ]
    assert len(tables) >= 3
    for table in tables:
        for text in cells(table):
            assert re.sub(r"[\\`|]", "", text).split()[0] in flat, (table.title, text)


def with_work(result: Result, work_s: float) -> Result:
    """The result, in which the node used this processor time in every step."""
    work = distribution(np.full(100, work_s))
    (rate,) = result.metrics.rates
    values = rate.pooled.values | {"cpu.apriltag.mean": 0.5, "work.apriltag": work}
    pooled = msgspec.structs.replace(rate.pooled, values=values)
    rates = (msgspec.structs.replace(rate, pooled=pooled),)
    return msgspec.structs.replace(
        result, metrics=msgspec.structs.replace(result.metrics, rates=rates)
    )


@pytest.mark.parametrize(
    # Two cores and outputs after 29.9 ms (p90): 59.8 ms, and a tenth of the period of 33 ms.
    ("work_s", "is_said"),
    [(0.020, False), (0.062, False), (0.067, True)],
)
def test_cpu_without_messages_is_what_exceeds_all_cores_until_the_outputs_came(
    passing: ReportInput, work_s: float, is_said: bool
) -> None:
    result = with_work(passing.result, work_s)
    said = [text for text in idle_work_notes(result) if "apriltag" in text]
    assert bool(said) == is_said
    if is_said:
        assert said[0].startswith("Process apriltag uses CPU without messages: 67 ms a step")
        assert said[0] in notes(result)


def busy(result: Result) -> Result:
    """The result of a machine that other programs used in every iteration."""
    disturbed = tuple(
        DisturbedIteration(
            segment=iteration.segment,
            rate_hz=rate.offered_hz,
            reasons=("other processes used 1.8 of 2 cores",),
        )
        for rate in result.metrics.rates
        for iteration in rate.iterations
    )
    opened = tuple(
        msgspec.structs.replace(one, outcome="inconclusive", remedy="About 7 more starts.")
        for one in result.verdict.requirements
    )
    verdict = msgspec.structs.replace(result.verdict, disturbed=disturbed)
    return msgspec.structs.replace(result, verdict=verdict.with_requirements(opened, "report"))


def test_a_busy_machine_is_said_first_and_alone_and_no_advice_contradicts_it(
    passing: ReportInput,
) -> None:
    result = busy(passing.result)
    assert "not shown on this busy machine" in headline(result)
    (note,) = notes(result)
    assert note.startswith("The machine was busy: host interference in 6 of 6 iterations")
    for name in ("text", "markdown", "html"):
        text = renderer(name)(replace(passing, result=result)).decode()
        assert "About 7 more starts" not in text, name


def test_what_is_left_open_stands_beside_the_verdict(passing: ReportInput) -> None:
    first, second = passing.result.verdict.requirements
    left = msgspec.structs.replace(second, outcome="inconclusive", left_open=True)
    verdict = passing.result.verdict.with_requirements((first, left), "report")
    result = msgspec.structs.replace(passing.result, verdict=verdict)
    assert result.verdict.outcome == "pass"
    assert headline(result).startswith("✔ PASS simulated: latency.p50 ")
    assert headline(result).endswith("; drop_rate is open on this busy machine")
    assert "? OPEN" in renderer("markdown")(replace(passing, result=result)).decode()


def test_a_crash_is_said_with_its_place_and_the_last_lines_of_its_output(
    passing: ReportInput,
) -> None:
    reason = "R2B634: worker: it raised ValueError: no (worker.py:14)"
    lines = '  File "worker.py", line 14, in work\n    <b>raise</b>\nValueError: no'
    verdict = msgspec.structs.replace(
        passing.result.verdict,
        outcome="incomplete",
        exit_code=4,
        reason=f"{reason}{OUTPUT_FOLLOWS}{lines}",
    )
    result = msgspec.structs.replace(passing.result, verdict=verdict)
    assert headline(result) == f"! INCOMPLETE simulated: {reason}"
    markdown = renderer("markdown")(replace(passing, result=result)).decode()
    assert '\n      File "worker.py", line 14, in work\n        <b>raise</b>\n' in markdown
    page = renderer("html")(replace(passing, result=result)).decode()
    assert "&lt;b&gt;raise" in page
    text = renderer("text")(replace(passing, result=result)).decode()
    assert "ValueError: no\n" in text
