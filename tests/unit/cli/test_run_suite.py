"""``r2bspec run`` with several specs: what is run, in which order, and what comes of it."""

from __future__ import annotations

import functools
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import click
import msgspec
import pytest

from command_line import Call
from example_spec import example
from r2bspec import api
from r2bspec.cli.spec_selection import SpecSelection, suite_entries
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.execute.errors import InterruptedRunError
from r2bspec.execute.identity.identify_graph import graph_identity
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.judge_run import to_json as result_json
from r2bspec.judge.result import Result
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.plan.plan import PlayPlan
from r2bspec.plan.smoke_plan import smoke_plan
from r2bspec.record.run_folder import RunFolder, open_run
from r2bspec.report.suite import (
    SUITE_FORMATS,
    SuiteSummary,
    render,
    run_with_error,
    run_with_result,
    worst_status,
)
from report_runs import HOSTILE_RUN, USUAL, GraphSimulation, skewed
from run_simulation import Played

MATRIX = "variables: {hz: 10 Hz}\nmatrix: {axes: {hz: [10 Hz, 20 Hz]}}\n"


def write_spec(folder: Path, name: str, more: str = "") -> Path:
    text = example(name, slos="{fast: {at: 30 Hz, require: [latency.p90 < 50 ms]}}")
    path = folder / f"{name}.r2b.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text + more)
    return path


def selection(**changes: Any) -> SpecSelection:
    bare = SpecSelection(Path(), sets=(), variables={}, case="")
    return replace(bare, **changes)


def test_every_case_of_every_file_is_a_run(tmp_path: Path) -> None:
    one = write_spec(tmp_path, "one")
    two = write_spec(tmp_path, "two", MATRIX)
    found = suite_entries(selection(), [str(one), str(two)])
    assert [(entry.selection.spec, entry.selection.case) for entry in found] == [
        (one, ""),
        (two, "hz=10 Hz"),
        (two, "hz=20 Hz"),
    ]
    assert suite_entries(selection(case="all"), [str(two)]) == found[1:]
    (only,) = suite_entries(selection(case="hz=20 Hz"), [str(two)])
    assert only.selection.case == "hz=20 Hz"


def test_scanned_values_are_variables_or_keys(tmp_path: Path) -> None:
    spec = write_spec(tmp_path, "a", "variables: {threads: 1}\n")
    found = suite_entries(
        selection(sets=("name=x",)), [str(spec)], scan=["threads=1,2", "benchmark.warm_up=1 s,2 s"]
    )
    assert [entry.suffix for entry in found] == [
        "[threads=1,benchmark.warm_up=1 s]",
        "[threads=1,benchmark.warm_up=2 s]",
        "[threads=2,benchmark.warm_up=1 s]",
        "[threads=2,benchmark.warm_up=2 s]",
    ]
    last = found[-1].selection
    assert (last.variables, last.sets) == ({"threads": "2"}, ("name=x", "benchmark.warm_up=2 s"))
    with pytest.raises(click.UsageError):
        suite_entries(selection(), [str(spec)], scan=["threads"])


@pytest.mark.parametrize(
    ("statuses", "worst"),
    [([], 0), ([0, 3, 0], 3), ([3, 4], 4), ([4, 1, 3], 1), ([1, 2, 4], 2), ([1, 130, 2], 130)],
)
def test_the_worst_status_is_the_one_that_a_retry_mends_least(
    statuses: list[int], worst: int
) -> None:
    assert worst_status(statuses) == worst


SIMULATED = GraphSimulation(
    segments=[Played(30, skewed(150, 0.02, 150 * number)) for number in range(5)],
    monitors=("output",),
)
SLOW = replace(SIMULATED, segments=[Played(30, skewed(150, 0.2)) for _ in range(5)])


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the benchmarks that were played, by a run whose samples are simulated."""
    names: list[str] = []

    def run(prepared: api.PreparedBenchmark, folder: Path, *_: Any, **__: Any) -> Result:
        name = prepared.plan.name
        names.append(name)
        if name.startswith("interrupted"):
            raise InterruptedRunError("interrupted by SIGINT")
        written = (SLOW if name.startswith("slow") else SIMULATED).write(folder)
        place = RunFolder(folder)
        place.write_plan(canonical_json(prepared.plan).decode())
        hashed = plan_hash(prepared.plan)
        identity = graph_identity(prepared.plan, prepared.base_dir)
        place.write_record(
            msgspec.structs.replace(written.record, plan_hash=hashed, identity=identity)
        )
        result = result_of(open_run(folder))
        place.write_result(result_json(result))
        if name.startswith("broken"):
            raise R2bspecError("a process died")
        return result

    monkeypatch.setattr(api, "run", run)
    return names


@pytest.fixture
def call(call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """``r2bspec run`` in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return functools.partial(call, "run")


def suite() -> SuiteSummary:
    """The summary of the runs in the folder ``out``."""
    return msgspec.json.decode(Path("out/suite.json").read_bytes(), type=SuiteSummary)


def write_specs(*names: str) -> None:
    for name in names:
        write_spec(Path("specs"), name)


def test_a_folder_is_run_to_its_end_with_the_worst_status(played: list[str], call: Call) -> None:
    write_specs("a", "broken_b", "slow_c", "t")
    Path("specs/u.r2b.yaml").write_text("r2bspec: 1\n")
    reports = ("--report", "junit=junit.xml", "--report", "csv=csv/{name}.csv")
    said = call("specs", "-o", "out", *reports, status=2)
    assert played == ["a", "broken_b", "slow_c", "t"]
    assert [(run.name, run.outcome, run.exit_status) for run in suite().runs] == [
        ("a", "pass", 0),
        ("broken_b", "error", 4),
        ("slow_c", "fail", 1),
        ("t", "pass", 0),
        ("u", "error", 2),
    ]
    assert said.out.count("✔ PASS") == 2
    assert "5 runs: 2 pass, 2 error, 1 fail" in said.out
    assert said.err.rstrip().endswith("run folder: out")
    assert "error[R2B600" in said.err
    suites = {each.get("name"): each for each in ET.parse("junit.xml").getroot()}  # noqa: S314
    assert list(suites) == ["a", "broken_b", "slow_c", "t", "u"]
    assert [suites[name].get("errors") for name in suites] == ["0", "1", "0", "0", "1"]
    assert suites["slow_c"].get("failures") == "1"
    written = {path.name for path in Path("csv").iterdir()}
    assert written == {"a.csv", "broken_b.csv", "slow_c.csv", "t.csv"}
    assert not [*Path().rglob("*.html")], "nobody has asked for a page"


@pytest.mark.usefixtures("without_charts")
@pytest.mark.parametrize("own", [False, True])
def test_the_page_of_a_suite_leads_to_its_runs_and_each_of_them_back(
    played: list[str], own: bool, call: Call
) -> None:
    write_specs("a", "slow_b")
    Path("specs/u.r2b.yaml").write_text("r2bspec: 1\n")
    page = Path("all pages/100 %.html")
    reports = [f"html={page}", *["html=of runs/{name}.html"] * own]
    call("specs", "-o", "out", *(part for report in reports for part in ("--report", report)))
    assert len(played) == 2
    assert len(re.findall(r'<tr class="(?:pass|fail|error)', page.read_text())) == 3
    links = re.findall(r'<a href="([^"]+)">([^<]+)</a>', page.read_text())
    assert [name for _, name in links] == ["slow_b", "a"]
    for link, _ in links:
        run_page = (page.parent / unquote(link)).resolve()
        assert run_page.is_relative_to(Path("of runs" if own else "out").resolve())
        (back,) = re.findall(r'<a href="([^"#]+)">', run_page.read_text())
        assert (run_page.parent / unquote(back)).resolve() == page.resolve()
    runs = suite().runs
    assert [bool(run.report) for run in runs] == [True, True, False]
    assert runs[0].line.startswith("✔ PASS ")


@pytest.mark.parametrize(
    ("second", "options", "status", "outcomes"),
    [
        ("slow_b", ["--fail-fast"], ExitStatus.FINDINGS_OR_FAILED, ["pass", "fail", "skipped"]),
        ("interrupted_b", [], ExitStatus.INTERRUPTED, ["pass", "error"]),
    ],
)
def test_what_ends_a_folder_early_keeps_the_summary_and_names_its_folder(
    second: str, options: list[str], status: int, outcomes: list[str], played: list[str], call: Call
) -> None:
    write_specs("a", second, "t")
    said = call("specs", "-o", "out", *options, status=status).err
    assert played == ["a", second]
    assert [run.outcome for run in suite().runs] == outcomes
    assert suite().exit_status == status
    assert said.rstrip().endswith("run folder: out")


def test_resume_plays_what_is_missing_changed_or_incomplete(played: list[str], call: Call) -> None:
    write_specs("a", "b", "broken_c")
    call("specs", "-o", "out", status=4)
    write_specs("d")
    write_spec(Path("specs"), "b", "labels: {changed: yes}\n")
    change_record("broken_c", status="incomplete", reason="R2B671")
    played.clear()
    call("specs", "-o", "out", "--resume", status=4)
    assert played == ["b", "broken_c", "d"]
    assert [run.resumed for run in suite().runs] == [True, False, False, False]
    # What was there is kept.
    for name in ("b", "broken_c"):
        assert Path(f"out/{name}.earlier-1/record.json").is_file()


def change_record(name: str, **values: object) -> None:
    record = Path("out", name, "record.json")
    record.write_text(json.dumps(json.loads(record.read_text()) | values))


def test_resume_refuses_the_result_of_other_code(played: list[str], call: Call) -> None:
    spec = write_spec(Path("specs"), "a")
    spec.write_text(spec.read_text().replace("r2bspec.nodes.RelayNode", "./node.py:Relay"))
    node = Path("specs/node.py")
    node.write_text(
        "from rclpy.node import Node\nfrom sensor_msgs.msg import Image\n\n"
        "class Relay(Node):\n"
        "    def __init__(self, **kwargs):\n        super().__init__('relay', **kwargs)\n"
        "        out = self.create_publisher(Image, 'output', 10)\n"
        "        self.create_subscription(Image, 'input', out.publish, 10)\n"
    )
    resumed = functools.partial(call, "specs", "-o", "out", "--resume")
    resumed()
    resumed()
    assert played == ["a"]
    node.write_text(f"{node.read_text()}# changed\n")
    said = resumed().err
    assert played == ["a", "a"]
    assert not suite().runs[0].resumed
    assert "a: the earlier run does not count: node.py changed" in said
    # A result that says nothing of its code does not count either.
    change_record("a", identity=None)
    resumed()
    assert played == ["a", "a", "a"]


@pytest.mark.parametrize("name", list(SUITE_FORMATS))
def test_every_format_keeps_the_words_of_strangers_in_their_place(
    name: str, tmp_path: Path
) -> None:
    judged = {
        each: result_of(simulation.write(tmp_path / each))
        for each, simulation in {"usual": USUAL, "hostile": HOSTILE_RUN}.items()
    }
    runs = [
        run_with_result(one, spec="a.r2b.yaml", folder=each, name=f"<script>{each}\x1b[2J|")
        for each, one in judged.items()
    ]
    runs.append(run_with_error(R2bspecError("::error::x\x07"), name="gone", spec="b.r2b.yaml"))
    summary = SuiteSummary(started_at="a", ended_at="b", exit_status=1, runs=tuple(runs))
    made = render(name, summary, judged)
    assert made == render(name, summary, judged)
    text = made.decode()
    assert "gone" in text
    assert not any(char in text for char in "\x1b\x07")
    if name in {"html", "junit"}:
        assert "<script>" not in text
    if name != "json":
        assert not any(line.startswith("::") for line in text.splitlines())


def test_a_smoke_plan_is_one_short_iteration_and_judges_nothing() -> None:
    plan = USUAL.plan()
    play = (
        PlayPlan(rate_hz=30, duration_ns=10**10, iterations=5, max_iterations=20),
        PlayPlan(rate_hz=10, duration_ns=10**10, iterations=5),
    )
    phases = ("start", "collect")
    smoke = smoke_plan(msgspec.structs.replace(plan, play=play, phases=phases))
    assert [(each.rate_hz, each.iterations) for each in smoke.play] == [(10, 1)]
    assert smoke.play[0].duration_ns <= 2 * 10**9
    assert (smoke.starts, smoke.search, smoke.sustained_hz) == (1, None, ())
    assert {objective.level for objective in smoke.objectives.values()} <= {"off"}
    assert smoke.phases == ("start", "play", "collect")
    assert "nothing is judged" in smoke.title
