"""Every report says of how many starts of the processes the verdict is, and what a start took."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of, to_json
from r2bspec.judge.verdict import RequirementVerdict, outcome_of
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import StartRecord
from r2bspec.report.format_registry import renderer
from r2bspec.report.report_wording import starts_text
from r2bspec.report.terminal import to_text
from report_runs import SIMULATIONS

ONE = "f this start of the processes: "
SEVERAL = "ver 3 starts of the processes: "


def started(
    number: int, cost_s: float, *, overhead_s: float = 0.0, confirms: bool = False
) -> StartRecord:
    ready_ns = round((cost_s + overhead_s) * 1e9)
    return StartRecord(
        number=number,
        began_ns=0,
        ready_ns=ready_ns,
        overhead_ns=round(overhead_s * 1e9),
        confirms=confirms,
    )


def run_of(folder: Path, starts: int) -> Run:
    """The usual run, its iterations taken in turn from this number of starts."""
    run = SIMULATIONS["usual"].write(folder)
    record = msgspec.structs.replace(
        run.record,
        segments=tuple(
            msgspec.structs.replace(each, start=1 + number % starts)
            for number, each in enumerate(run.record.segments)
        ),
        starts=(started(1, 9.0, overhead_s=2.0), started(2, 3.0), started(3, 3.2))[:starts],
    )
    return replace(run, record=record)


def reports(run: Run) -> dict[str, str]:
    """The run in every format that says in words how it was judged."""
    result = result_of(run)
    reported = ReportInput(result=result)  # the charts of single messages say nothing of it
    shown = ("markdown", "html", "junit", "github")
    texts = {name: renderer(name)(reported).decode() for name in shown}
    return texts | {
        "json": to_json(result).decode(),
        # On one line, however wide the terminal is.
        "text": " ".join(to_text(result, run.folder, 80).split()),
    }


@pytest.mark.parametrize(("starts", "words"), [(1, ONE), (3, SEVERAL)])
def test_every_report_says_of_how_many_starts_the_verdict_is(
    tmp_path: Path, starts: int, words: str
) -> None:
    found = reports(run_of(tmp_path / "run", starts))
    assert {name for name, text in found.items() if words in text} == set(found)
    other = SEVERAL if words == ONE else ONE
    assert not [name for name, text in found.items() if other in text]


def test_the_first_line_of_a_report_says_that_it_is_about_one_start(tmp_path: Path) -> None:
    for starts in (1, 3):
        found = reports(run_of(tmp_path / f"{starts}", starts))
        headings = {
            "markdown": found["markdown"].splitlines()[0],
            "github": found["github"].splitlines()[0].partition("::")[2],
            "html": found["html"].partition("<title>")[2].partition("</title>")[0],
        }
        for name, heading in headings.items():
            assert ("of this start" in heading) == (starts == 1), name


def test_the_cost_of_a_start_is_shown(tmp_path: Path) -> None:
    found = reports(run_of(tmp_path / "run", 3))
    for name in ("markdown", "html", "text"):
        assert "3 starts, 3.1 s each" in found[name]


def test_a_requirement_that_rests_on_probes_says_that_they_are_of_one_start(
    tmp_path: Path,
) -> None:
    note = "Probed in the first start of the processes alone."
    for starts, noted in ((1, set()), (3, {"search bracket"})):
        verdict = result_of(run_of(tmp_path / f"{starts}", starts)).verdict
        assert {one.method for one in verdict.requirements if note in one.notes} == noted
    # In a comparison in pairs, each run has probes of its own.
    run = run_of(tmp_path / "pairs", 3)
    probed = [
        msgspec.structs.replace(run.record.segments[0], id=f"p{start}", kind="probe", start=start)
        for start in (1, 2, 3)
    ]
    segments = (*run.record.segments, *probed)
    paired = replace(run, record=msgspec.structs.replace(run.record, segments=segments))
    assert not [one for one in result_of(paired).verdict.requirements if note in one.notes]


@pytest.mark.parametrize("name", ["silent", "empty", "hostile"])
def test_a_run_without_starts_in_its_record_is_one_start(tmp_path: Path, name: str) -> None:
    run = SIMULATIONS[name].write(tmp_path / "run")
    assert not run.record.starts
    verdict = result_of(run).verdict
    judged = verdict.outcome not in {"invalid", "incomplete"}
    assert verdict.starts == int(judged)
    assert (ONE in verdict.reason) == judged


def test_a_verdict_without_requirements_is_about_nothing(tmp_path: Path) -> None:
    verdict = result_of(run_of(tmp_path / "run", 3), {}).verdict
    assert verdict.reason == outcome_of(())[1] == "The spec has no objective to judge."
    assert not verdict.limits


def test_the_cost_is_that_of_a_start_after_the_first_without_the_harness_overhead() -> None:
    assert starts_text(()) == ""
    assert starts_text([started(1, 4.0, overhead_s=1.5)]) == "1 start, 4 s"
    assert starts_text([started(1, 9.0), started(2, 3.0)]) == "2 starts, 3 s each"
    confirmed = [started(1, 9.0), started(2, 3.0, confirms=True)]
    assert starts_text(confirmed) == "1 start and 1 to confirm, 3 s each"


def disturbed(run: Run, *numbers: int) -> Run:
    """The run, some of whose starts were disturbed while they came up."""
    starts = tuple(
        msgspec.structs.replace(each, disturbed=("other processes used 1.9 of 2 cores",), taken=0.9)
        if each.number in numbers
        else each
        for each in run.record.starts
    )
    return replace(run, record=msgspec.structs.replace(run.record, starts=starts))


def test_a_start_that_was_disturbed_is_told_in_every_report(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run", 3)
    words = "while 2 of 3 starts came up: 2 (other processes used 1.9 of 2 cores); 3 (other"
    found = reports(disturbed(run, 2, 3))
    del found["json"], found["github"]
    assert {name for name, text in found.items() if words in text} == set(found)
    assert not [name for name, text in reports(run).items() if "starts came up" in text]


def test_only_strict_refuses_a_pass_of_a_disturbed_start(tmp_path: Path) -> None:
    run = disturbed(run_of(tmp_path / "run", 3), 2)

    def judged(policy: str) -> tuple[RequirementVerdict, ...]:
        gate = msgspec.structs.replace(run.plan.gate, interference=policy)
        plan = msgspec.structs.replace(run.plan, gate=gate)
        return result_of(replace(run, plan=plan)).verdict.requirements

    usual = [one.outcome for one in result_of(run_of(tmp_path / "plain", 3)).verdict.requirements]
    assert "pass" in usual
    for policy in ("tolerate", "note"):
        assert [one.outcome for one in judged(policy)] == usual
    refused = [
        one
        for one, was in zip(judged("strict"), usual, strict=True)
        if was == "pass" and one.method != "search bracket"
    ]
    assert {one.outcome for one in refused} == {"inconclusive"}
    assert all("while start 2 came up" in one.notes[-1] for one in refused)
