"""The notes of a report: five at most, the most important first, and none twice."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from command_line import Call
from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import DisturbedIteration
from r2bspec.record.run_record import OutputGapRecord, StartRecord
from r2bspec.report.format_registry import renderer
from r2bspec.report.notes import MOST_NOTES, all_notes, notes
from report_runs import USUAL, with_monitors, with_starts
from run_simulation import Played, Simulation, objective


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
    assert len(found.shown) == MOST_NOTES == 5
    assert found.shown[0].startswith("No more messages on /r2b/out")
    assert "A note about one requirement." in found.shown[1]
    assert found.shown[2].startswith("Host interference in 2 of ")
    assert found.shown[3:] == ("Planned part 0 was not played.", "Planned part 1 was not played.")
    weights = [note.weight for note in all_notes(result)]
    assert weights == sorted(weights)
    assert found == notes(result)


def test_verbose_has_all_of_them(tmp_path: Path) -> None:
    result = noted(tmp_path / "run")
    short, whole = notes(result), notes(result, verbose=True)
    assert (*short.shown, *short.others) == whole.shown
    assert (whole.others, whole.more) == ((), "")
    assert short.more == f"{len(short.others)} more notes: with --verbose, or in the HTML report"


def test_interference_is_told_in_a_line_and_in_full_where_all_is_told(tmp_path: Path) -> None:
    result = noted(tmp_path / "run")
    # What happened in one way is told in that way.
    (line,) = [text for text in notes(result).shown if "interference" in text]
    assert line.startswith("Host interference in 2 of 6 iterations: iteration-001 at 30 Hz (")


def test_a_note_of_several_requirements_is_told_once(tmp_path: Path) -> None:
    result = noted(tmp_path / "run")
    failed = [
        msgspec.structs.replace(verdict, outcome="fail", notes=("Confirmed by 5 new starts.",))
        for verdict in result.verdict.requirements[:3]
    ]
    verdict = msgspec.structs.replace(result.verdict, requirements=tuple(failed))
    told = [
        note.text
        for note in all_notes(msgspec.structs.replace(result, verdict=verdict))
        if "Confirmed" in note.text
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
        # The page has every note, verbose or not.
        text = html_page(simulation).decode().partition("<main>")[2]
    else:
        text = renderer(name)(replace(source, verbose=verbose)).decode()
    flat = " ".join(text.replace("&lt;", "<").replace("&gt;", ">").split())
    for sentence in [result.verdict.reason, *(note.text for note in all_notes(result))]:
        assert flat.count(sentence) <= 1, sentence


def test_the_options_of_the_command_line(tmp_path: Path, call: Call) -> None:
    folder = replace(USUAL, labels=()).write(tmp_path / "run").folder
    for verbose in ((), ("--verbose",)):
        for asked in (("judge", folder), ("report", folder, "--report", "text=-")):
            text = call(*asked, *verbose).out
            reason = "at 95 % confidence at least"
            assert (reason in " ".join(text.split())) == bool(verbose)


def test_the_page_shows_the_first_and_folds_the_others(tmp_path: Path) -> None:
    result = noted(tmp_path / "run")
    page = renderer("html")(ReportInput(result=result)).decode()
    section = page.partition('<h2 id="notes">')[2].partition("</section>")[0]
    visible, _, folded = section.partition("<details>")
    found = notes(result)
    assert visible.count("<li>") == len(found.shown)
    assert folded.count("<li>") == len(found.others)


def varied_run(number: int, folder: Path) -> Result:
    """One of many runs: other sizes, starts, losses, limits and machines."""
    random = np.random.default_rng(number)
    starts, rate_hz = int(random.choice([1, 3, 5, 10])), float(random.choice([10, 30, 100]))
    messages = int(random.choice([60, 400]))
    scatter, level_s = random.choice([0.01, 0.05, 0.2]), random.choice([0.002, 0.02, 0.2])
    lost, played = random.choice([0, 0, 0.002, 0.02]), []
    for _ in range(2 * starts):
        latency = level_s * np.exp(random.normal(0, scatter, messages) + random.normal(0, 0.01))
        latency[random.random(messages) < lost] = np.nan
        played.append(Played(rate_hz, latency))
    limit_ms = 1000 * level_s * random.choice([0.8, 1.05, 1.3, 2, 5])
    asked = np.array(
        [
            f"latency.p90 < {limit_ms * (1 + 1.3 * scatter):f} ms",
            f"latency.mean < {limit_ms:f} ms",
            "drop_rate <= 1 %",
            "throughput.mean >= 97 % of offered",
        ]
    )
    busy = {"busy_s": 1.0, "stolen_s": 0.01, "waited_s": 0.04, "throttled_s": 0.0}
    simulation = Simulation(
        played,
        {"slo": objective(*asked[random.random(4) < 0.7].tolist(), at=f"{rate_hz:g} Hz")},
        interference=busy if random.random() < 0.3 else {},
    )
    run = simulation.write(folder)
    return result_of(
        with_starts(
            run, *(StartRecord(number=at, began_ns=0, ready_ns=1) for at in range(1, starts + 1))
        )
    )


def test_no_sentence_stands_in_every_report(tmp_path: Path) -> None:
    """One that does tells nobody anything about the run."""
    results = [varied_run(number, tmp_path / str(number)) for number in range(20)]
    assert {result.verdict.outcome for result in results} == {"pass", "fail", "inconclusive"}
    said = Counter(
        sentence
        for result in results
        for sentence in {re.sub(r"[\d.,]+", "#", note.text) for note in all_notes(result)}
    )
    assert said
    assert max(said.values()) <= len(results) / 2


def test_feedback_of_an_action_is_not_duplicated(tmp_path: Path) -> None:
    result = result_of(USUAL.write(tmp_path / "run"))
    monitor = next(iter(result.metrics.rates[0].pooled.monitors.values()))
    often = msgspec.structs.replace(monitor, duplicates=7)
    named = {"plan": monitor, "plan_accepted": monitor, "plan_feedback": often, "a_feedback": often}
    texts = [each.text for each in all_notes(with_monitors(result, lambda _: named))]
    duplicated = {text.partition(" ")[0] for text in texts if "7 duplicated" in text}
    assert duplicated == {"a_feedback"}
