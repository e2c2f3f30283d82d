"""``--report FORMAT=PATH`` is checked first and appears whole; what is told while a run goes on."""

from __future__ import annotations

import importlib.util
import json
import os
import threading
from pathlib import Path
from typing import Any

import pytest

from r2bspec.cli.main import main
from r2bspec.errors import ExitStatus
from r2bspec.extras import install_command
from r2bspec.plan.time_estimate import BOTH_SIDES, TimeEstimate
from r2bspec.record.run_folder import Run
from r2bspec.report.format_registry import ReportError, ReportUsageError
from r2bspec.report.progress import RemainingTime, shown_progress
from r2bspec.report.write_reports import parse_report_requests
from report_runs import EMPTY

pytestmark = pytest.mark.usefixtures("without_charts")

# ``--report FORMAT=PATH``: what is asked for is checked first, and appears whole.


@pytest.fixture(name="run")
def run_folder(usual_run: Run) -> Path:
    return usual_run.folder


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["html"], "takes FORMAT=PATH"),
        (["html="], "takes FORMAT=PATH"),
        (["htlm=x"], "unknown report format 'htlm'; Did you mean 'html'?"),
        (["json=-", "csv=-"], "standard output"),
        (["json=a", "csv=a"], "'a'"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_runs(options: list[str], said: str) -> None:
    with pytest.raises(ReportUsageError) as caught:
        parse_report_requests(options)
    assert said in f"{caught.value}; {caught.value.hint}"


def test_a_missing_library_is_named_before_anything_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec

    def find(name: str, package: str | None = None) -> Any:
        return None if name == "jinja2" else found(name, package)

    monkeypatch.setattr(importlib.util, "find_spec", find)
    with pytest.raises(ReportError, match="needs jinja2") as caught:
        parse_report_requests(["html=x"])
    assert install_command("report") in caught.value.hint


def test_folders_are_made_and_reports_are_whole(run: Path, tmp_path: Path) -> None:
    target = tmp_path / "deep" / "er" / "result.json"
    junit = tmp_path / "j.xml"
    arguments = ["judge", str(run), "--report", f"json={target}", "--report", f"junit={junit}"]
    assert main(arguments) == json.loads((target).read_text())["verdict"]["exit_code"]
    assert junit.read_text().startswith("<?xml")
    assert not [*tmp_path.rglob("*.tmp")]


def test_a_report_on_standard_output_stands_alone(
    run: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    main(["judge", str(run), "--report", "json=-"])
    assert json.loads(capfdbinary.readouterr().out)["name"] == "simulated"


def test_a_pipe_is_written_to_and_not_replaced(run: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    main(["judge", str(run), "--report", f"csv={pipe}"])
    reader.join(30)
    assert read[0].startswith(b"run_id,")
    assert pipe.is_fifo()


def test_an_incomplete_run_has_its_reports_too(tmp_path: Path) -> None:
    run = EMPTY.write(tmp_path / "run").folder
    target = tmp_path / "report.md"
    assert main(["judge", str(run), "--report", f"markdown={target}"]) == 4
    assert "INCOMPLETE" in target.read_text()


# What a user is told while a run goes on.


def test_the_log_of_a_ci_job_has_a_line_a_minute_and_each_note_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr("r2bspec.report.progress.time.monotonic", lambda: now[0])
    monkeypatch.setenv("CI", "true")
    estimate = TimeEstimate({"load": 1.0, "play": 200.0}, 201.0)
    remaining = RemainingTime(estimate, clock=lambda: now[0])
    with shown_progress(remaining=remaining) as listener:
        listener.phase("load", "reading a bag")
        listener.note("/image: 15 messages")
        listener.note("/image: 15 messages")
        listener.phase("play", "playing at fixed rates")
        for number in range(20):
            listener.segment(f"20 Hz, iteration {number}", 100)
            for _ in range(40):
                now[0] += 0.25
                listener.playing(40, 39)
    said = capsys.readouterr().err.splitlines()
    # 200 s, a note, and a line at the start.
    assert len(said) == 1 + 1 + 3
    assert said[0].endswith("reading a bag · about 3 min 30 s left")
    assert "playing at fixed rates · 20 Hz, iteration 5" in said[2]
    assert said[2].endswith("about 2 min 30 s left")


def test_the_remaining_time_counts_phases_and_runs() -> None:
    now = [0.0]
    estimate = TimeEstimate({"load": 10.0, "start": 5.0, "play": 100.0}, 230.0, runs=2)
    remaining = RemainingTime(estimate, after_s=7.0, clock=lambda: now[0])
    assert remaining.seconds() == 2 * 115 + 7
    remaining.begin("load")
    now[0] += 4
    assert remaining.seconds() == 2 * 115 + 7 - 4
    remaining.begin("a phase that nobody has planned")
    remaining.begin("play")
    assert remaining.seconds() == 100 + 115 + 7
    now[0] += 500
    assert remaining.seconds() == 115 + 7
    remaining.begin("load")
    assert remaining.seconds() == 504 + 7, "the next run will take as long as the last one"


def test_the_rest_of_a_comparison_by_turns_follows_its_starts() -> None:
    now = [0.0]
    estimate = TimeEstimate({BOTH_SIDES: 10.0}, 154.0, 12, 5, "starts of both sides", once_s=4.0)
    remaining = RemainingTime(estimate, clock=lambda: now[0])
    assert remaining.seconds() == 124
    remaining.begin(BOTH_SIDES)
    now[0] += 4
    assert remaining.text() == "about 2 min left if all are played"
    assert remaining.seconds() == 120
    now[0] += 15
    remaining.begin(BOTH_SIDES)
    assert remaining.seconds() == 11 * 15
    for _ in range(11):
        now[0] += 15
        remaining.begin(BOTH_SIDES)
    assert remaining.text() == "takes longer than estimated", "a confirmation has begun"


@pytest.mark.parametrize(("late_s", "known"), [(4.0, True), (6.0, False)])
def test_the_rest_of_a_phase_that_takes_longer_is_not_known(late_s: float, known: bool) -> None:
    now = [0.0]
    remaining = RemainingTime(TimeEstimate({"load": 3.0, "play": 9.0}, 12.0), clock=lambda: now[0])
    remaining.begin("load")
    now[0] += 3.0 + late_s
    assert remaining.text() == ("about 9 s left" if known else "takes longer than estimated")


# A report replaces nothing that it is made from.


def test_no_report_of_a_run_replaces_what_the_run_needs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec, output = tmp_path / "x.r2b.yaml", tmp_path / "out"
    spec.write_text("r2bspec: 1\n")
    for target in (spec, tmp_path / "{name}.r2b.yaml", output / "record.json"):
        for verb in ([], ["--case", "all"]):
            arguments = ["run", str(spec), "--output", str(output), "--report", f"junit={target}"]
            assert main([*arguments, *verb]) == ExitStatus.USAGE
            said = capsys.readouterr().err
            assert "would replace" in said, (target, verb, said)
    assert not output.exists()
    assert spec.read_text() == "r2bspec: 1\n"
