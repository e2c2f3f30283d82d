"""The notes of a report: five at most, the most important first, and none twice."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import DisturbedIteration
from r2bspec.record.run_record import OutputGapRecord
from r2bspec.report.format_registry import renderer
from r2bspec.report.notes import MOST_NOTES, notes
from report_runs import USUAL


def noted(folder: Path) -> Result:
    """A run about which there is more to say than a report says."""
    result = result_of(USUAL.write(folder))
    silence = OutputGapRecord(
        segment="iteration-001", topic="/r2b/out", way=(), reason="It crashed."
    )
    first = result.verdict.requirements[0]
    about = msgspec.structs.replace(first, notes=("A note about one requirement.",))
    verdict = msgspec.structs.replace(
        result.verdict,
        requirements=(about, *result.verdict.requirements[1:]),
        disturbed=tuple(
            DisturbedIteration(
                segment=f"iteration-{number:03d}",
                rate_hz=30.0,
                reasons=("other processes used 1.5 of 2 cores",),
            )
            for number in (1, 2)
        ),
    )
    left_out = tuple(f"Planned part {number} was not played." for number in range(6))
    return msgspec.structs.replace(
        result, output_gaps=(silence,), verdict=verdict, left_out=left_out
    )


def test_at_most_five_the_most_important_first(tmp_path: Path) -> None:
    result = noted(tmp_path / "run")
    found = notes(result)
    assert len(found) == MOST_NOTES == 5
    assert found[0].startswith("No more messages on /r2b/out")
    assert "A note about one requirement." in found[1]
    assert found[2].startswith("Host interference in 2 of ")
    assert found[3].startswith("'r2bspec run SPEC --anatomy' shows where the time")
    assert found[4] == "Planned part 0 was not played."


def test_verbose_has_all_of_them(tmp_path: Path) -> None:
    result = noted(tmp_path / "run")
    short, whole = notes(result), notes(result, verbose=True)
    assert whole[: len(short)] == short
    assert len(whole) > len(short)


def test_interference_is_told_in_a_line_with_an_example(tmp_path: Path) -> None:
    result = noted(tmp_path / "run")
    (line,) = [text for text in notes(result) if "interference" in text]
    assert line == (
        "Host interference in 2 of 6 iterations; for example, other processes used 1.5 of 2 cores"
    )


def test_a_note_of_several_requirements_is_told_once(tmp_path: Path) -> None:
    result = noted(tmp_path / "run")
    failed = [
        msgspec.structs.replace(verdict, outcome="fail", notes=("Confirmed by 5 new starts.",))
        for verdict in result.verdict.requirements[:3]
    ]
    verdict = msgspec.structs.replace(result.verdict, requirements=tuple(failed))
    told = [
        text
        for text in notes(msgspec.structs.replace(result, verdict=verdict), verbose=True)
        if "Confirmed" in text
    ]
    assert told == ["latency.p99 < 60 ms at 30 Hz and 2 more: Confirmed by 5 new starts."]


@pytest.mark.parametrize(
    ("name", "verbose"),
    [*itertools.product(["text", "markdown", "junit"], [False, True]), ("html", False)],
)
@pytest.mark.parametrize("simulation", ["usual", "two monitors", "silent", "empty"])
def test_no_sentence_is_said_twice(
    reported: Callable[[str], ReportInput],
    html_page: Callable[[str], bytes],
    name: str,
    simulation: str,
    verbose: bool,
) -> None:
    source = reported(simulation)
    result = source.result
    if name == "html":
        text = html_page(simulation).decode().partition("<main>")[2]
    else:
        text = renderer(name)(replace(source, verbose=verbose)).decode()
    flat = " ".join(text.replace("&lt;", "<").replace("&gt;", ">").split())
    for sentence in [result.verdict.reason, *notes(result, verbose=True)]:
        assert flat.count(sentence) <= 1, sentence
