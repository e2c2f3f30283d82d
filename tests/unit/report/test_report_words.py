"""What a run says beside its numbers is told by every report that people read, at its lines."""

from __future__ import annotations

import html
import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest

from example_spec import example
from profiled_runs import MISSING, WHOLE
from r2bspec.cli.main import main
from r2bspec.compare.report_input import ReportInput
from r2bspec.errors import UsageError
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.result import Result
from r2bspec.record.graph_identity import GraphIdentity, Revision
from r2bspec.record.run_folder import Run
from r2bspec.record.run_record import Difference, OutputGapRecord, StartRecord, UnplayedMessages
from r2bspec.report.format_registry import renderer
from r2bspec.report.pipelines import render_github as render
from r2bspec.report.write_reports import ReportRequest, write_failure_reports
from report_runs import USUAL, with_monitors, with_starts
from run_simulation import Played, Simulation, objective

pytestmark = pytest.mark.usefixtures("without_charts")

# What a run says beside its numbers is told by every report that people read.


SECOND_NS = 10**9
PARTS = (0.001, 0.002, 0.0021, 0.003, 0.004, 0.0047, 0.005, 0.006)
STARTS = (
    StartRecord(number=1, began_ns=0, ready_ns=9 * SECOND_NS),
    *(
        StartRecord(
            number=number,
            began_ns=0,
            ready_ns=3 * SECOND_NS,
        )
        for number in (2, 3)
    ),
)
GAP = OutputGapRecord(
    segment="rate-30Hz-002",
    topic="/r2b/detections",
    reason="/r2b/a publishes nothing on /r2b/detections",
    way=(),
)
DIFFERENCE = Difference(
    code="R2B204",
    message="node /r2b/a has no topic 'x' that could be remapped to /r2b/y",
    part="remapping",
    owner="/r2b/a",
    name="x",
    help="its topics: /r2b/z",
    harmless=True,
)
UNPLAYED = UnplayedMessages(topic="/r2b/right", count=1, total=56)
HEAD, BASE = (
    GraphIdentity(digest=revision.commit, nodes={}, packages={}, revision=revision)
    for revision in (
        Revision(commit="3f2a1c4d" + "0" * 32, dirty=True),
        Revision(commit="9b1e44f0" + "0" * 32, dirty=False, name="origin/main"),
    )
)


@pytest.fixture(scope="module")
def result(usual_run: Run) -> Result:
    """A result about which there is everything to say."""
    found = with_monitors(
        result_of(with_starts(usual_run, *STARTS)),
        lambda monitors: {
            name: msgspec.structs.replace(
                seen,
                values=seen.values | {"late": 3, "overdue": 2, "unmatched": 5, "early": 1},
            )
            for name, seen in monitors.items()
        },
    )
    return msgspec.structs.replace(
        found,
        monitor_labels={"detections": "Tag detections"},
        versions=found.versions | {"rmw": "rmw_cyclonedds_cpp"},
        output_gaps=(GAP,),
        differences=(DIFFERENCE,),
        profiles=(WHOLE, MISSING),
        unplayed=(UNPLAYED,),
        gate=("allowed: objective fast",),
        identity=HEAD,
        base_identity=BASE,
    )


@pytest.fixture(scope="module")
def text(result: Result) -> Callable[[str], str]:
    """The report of a format, without escapes and line breaks."""

    @cache
    def shown(name: str) -> str:
        verbose = name not in {"html", "github"}
        found = renderer(name)(ReportInput(result=result, verbose=verbose)).decode()
        found = html.unescape(found).replace("\\", "").replace("%25", "%").replace("%3A", ":")
        return " ".join(found.split())

    return shown


@pytest.mark.parametrize(
    ("words", "formats"),
    [
        ("ver 3 starts of the processes: ", "text markdown html junit github json"),
        ("3 starts, 3 s each", "text markdown html"),
        ("1 of 56 messages of /r2b/right have no partner of", "text markdown html junit"),
        ("No more messages on /r2b/detections in rate-30Hz-002. /r2b/a publishes nothing", "text"),
        ("R2B204: node /r2b/a has no topic 'x' that could be remapped", "text"),
        ("3 matched no input, 2 arrived in a later segment (counted as missed)", "text"),
        ("1 arrived before the input", "text"),
        (
            "Profile of relay at 30 Hz, with perf: profile/relay/relay.folded, profile/relay/",
            "text markdown html",
        ),
        (
            "Profile of camera, with py-spy, is missing: process camera was killed",
            "text markdown html",
        ),
        ("Tag detections (detections)", "text markdown html"),
        ("rmw_cyclonedds_cpp", "text markdown html"),
        ("Allowed: objective fast", "text markdown html junit"),
        ("head 3f2a1c4+dirty, base origin/main@9b1e44f", "text markdown html junit"),
    ],
)
def test_it_is_told(text: Callable[[str], str], words: str, formats: str) -> None:
    assert [name for name in formats.split() if words not in text(name)] == []


def test_what_there_is_nothing_of_is_not_spoken_of(reported: Callable[[str], ReportInput]) -> None:
    usual = ReportInput(result=reported("usual").result)
    for name in ("text", "markdown", "junit", "github", "html"):
        shown = " ".join(renderer(name)(replace(usual, verbose=name == "text")).decode().split())
        assert "f this start of the processes: " in shown
        assert name in {"text", "junit"} or "of this start" in heading(name, shown)
        for words in ("starts of the", "interference in", "rmw_", "no partner", 'id="profile"'):
            assert words not in shown, name
        # Nor is said what every run would have alike.
        for words in ("another hour may differ", "of a kind not met", "resembles the previous"):
            assert words not in shown, name


def heading(name: str, shown: str) -> str:
    """The first thing that a report says: of how many starts it is."""
    first = shown.partition("<title>")[2].partition("</title>")[0] if name == "html" else shown
    return first.partition("drop_rate")[0]


def test_what_programs_read_keeps_the_names(text: Callable[[str], str]) -> None:
    assert "detections" in text("csv")
    assert "Tag detections" not in text("csv")


# What was not played is said in every report, and in the verdict where it is more than 5 %.


FEW = UnplayedMessages(topic="/r2b/right", count=1, total=56)
SOME = UnplayedMessages(topic="/r2b/right", count=10, total=56)
MOST = UnplayedMessages(topic="/r2b/right", count=53, total=56)
AGREED = msgspec.structs.replace(MOST, agreed=True)


def unplayed_run(path: Path, *unplayed: UnplayedMessages) -> Run:
    run = Simulation(
        segments=[Played(30, np.full(90, 0.02))],
        objectives={"all": objective("latency.p50 < 50 ms")},
    ).write(path)
    return replace(run, record=msgspec.structs.replace(run.record, unplayed=unplayed))


@pytest.mark.parametrize(("one", "in_verdict"), [(FEW, False), (SOME, True), (AGREED, False)])
def test_above_5_percent_it_is_a_warning_in_the_verdict_unless_agreed(
    tmp_path: Path, one: UnplayedMessages, in_verdict: bool
) -> None:
    found = result_of(unplayed_run(tmp_path, one))
    assert found.verdict.outcome == "pass"
    assert (one.text in found.verdict.reason) == in_verdict


# A run that ends before anything is measured says why in the reports that pipelines show.


FORMATS = ("markdown", "github", "junit", "html", "json")


def test_findings_are_in_the_reports_of_a_spec_that_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("spec.r2b.yaml").write_text(example() + "nonsense: 1\n")
    reports = [f"--report={name}=out/{name}" for name in FORMATS]
    assert main(["run", "spec.r2b.yaml", "--output", "run", *reports]) == 2
    assert {path.name for path in Path("out").iterdir()} == set(FORMATS)
    markdown = Path("out/markdown").read_text()
    assert markdown.startswith("### ✘ error R2B602: nothing was measured\n\n    spec.r2b.yaml:")
    assert "unknown-key" in markdown
    assert "::error file=spec.r2b.yaml,line=" in Path("out/github").read_text()
    assert "R2B101" in Path("out/junit").read_text()
    assert "R2B602" in Path("out/html").read_text()
    assert json.loads(Path("out/json").read_text())["code"] == "R2B602"
    assert not Path("run").exists()


def test_an_error_without_findings_is_one_at_the_spec(tmp_path: Path) -> None:
    requests = [ReportRequest(name, str(tmp_path / name)) for name in FORMATS]
    error = UsageError("no\n```\n<b>base</b>\n::error::x", hint="Fetch it.")
    write_failure_reports(requests, error, Path("bench/a.r2b.yaml"))
    lines = (tmp_path / "markdown").read_text().splitlines()[2:]
    # Nothing in the text ends the block.
    assert all(line.startswith("    ") for line in lines)
    (command,) = (tmp_path / "github").read_text().splitlines()
    assert command.startswith("::error file=bench/a.r2b.yaml,line=1")
    assert "Fetch it." in command


# Annotations point at the lines that state what failed.


Annotated = Callable[[Path | None], list[str]]


@pytest.fixture
def annotated(reported: Callable[[str], ReportInput]) -> Annotated:
    """The annotations of the usual run, whose spec is a file, or unknown."""
    return lambda spec: render(replace(reported("usual"), spec_file=spec)).decode().splitlines()


@pytest.mark.parametrize("content", [None, "", "a: [", "r2bspec: 1\nslos: {camera: {at: 3}}"])
def test_without_a_line_there_is_still_an_annotation(
    tmp_path: Path, annotated: Annotated, content: str | None
) -> None:
    spec = tmp_path / "a.r2b.yaml"
    if content is not None:
        spec.write_text(content)
    found = annotated(spec if content is not None else None)
    assert any("drop_rate <= 1 %25" in each and each.startswith("::error ") for each in found)


def test_ten_annotations_at_most(tmp_path: Path) -> None:
    many = replace(USUAL, objectives={"a": objective(*["latency.p50 < 1 ms"] * 30)})
    run = many.write(tmp_path / "run")
    found = render(ReportInput(result=result_of(run), run=run)).decode().splitlines()
    assert sum(each.startswith("::") for each in found) == 10
    assert found[-1].startswith("21 more requirements")
