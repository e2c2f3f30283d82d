"""The anatomy of an iteration in every report: tables and graph."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from html_elements import Page
from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.measure.anatomy_summary import AnatomySummary
from r2bspec.report.format_registry import renderer
from simulated_anatomies import CHAIN, FORK, Graph, ObservedSimulation, Stage


def reported(path: Path, graph: Graph) -> ReportInput:
    run = ObservedSimulation.of(graph).write(path)
    return ReportInput(result=result_of(run), run=run)


@pytest.fixture(scope="module")
def fork(tmp_path_factory: pytest.TempPathFactory) -> ReportInput:
    return reported(tmp_path_factory.mktemp("anatomy") / "run", FORK)


@pytest.fixture(scope="module")
def fork_page(fork: ReportInput) -> str:
    return shown(fork, "html")


def summary(report_input: ReportInput) -> AnatomySummary:
    anatomies = report_input.result.anatomies
    assert anatomies
    return anatomies[0]


def shown(report_input: ReportInput, form: str) -> str:
    return renderer(form)(report_input).decode()


def test_shares_and_means_of_parts_add_up(fork: ReportInput) -> None:
    for path in summary(fork).paths:
        assert sum(part.share for part in path.parts) == pytest.approx(1)
        assert sum(part.mean or 0 for part in path.parts) == pytest.approx(path.mean)
        assert sum(part.slowest or 0 for part in path.parts) == pytest.approx(path.slowest)


def test_the_terminal_has_the_path_of_most_messages(fork: ReportInput) -> None:
    text = shown(fork, "text")
    (heading,) = (line for line in text.splitlines() if line.startswith("anatomy"))
    assert "player → /in → split → /image → left → /a → fuse → /out → out" in heading
    assert "--verbose shows the other paths, 1 more" in text
    verbose = shown(replace(fork, verbose=True), "text")
    assert "→ right → /b → fuse" in verbose
    assert "more paths" not in verbose


def test_markdown_has_every_path_and_node(fork: ReportInput) -> None:
    text = shown(fork, "markdown")
    assert "| left | callback | 2.69 ms | 3.55 ms | 52 % | 3.7 ms |" in text
    assert "| fuse | held | " in text
    assert "| right | 20 % | 1 | 200 | 0 | " in text


def test_the_graph_of_the_page_has_the_times(fork_page: str) -> None:
    page = Page(fork_page.encode())
    assert "callback 2.99 ms, p99 3.94 ms" in page.text
    assert "transport 99.9 µs, p99 110 µs" in page.text


def test_the_reason_is_said_for_which_no_path_is_known(fork: ReportInput) -> None:
    assert fork.run is not None
    plan = msgspec.structs.replace(fork.run.plan, anatomy=("left",))
    (seen,) = result_of(replace(fork.run, plan=plan)).anatomies or ()
    assert seen.only == ("left",)
    for only, reason in (((), "path to an input that is known"), (seen.only, "only left was to")):
        bare = msgspec.structs.replace(seen, paths=(), only=only)
        result = msgspec.structs.replace(fork.result, anatomies=(bare,))
        text = " ".join(shown(replace(fork, result=result), "text").split())
        assert "200 of 200 messages of out have no" in text
        assert reason in text
        assert "in one iteration;" in text


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    found = reported(tmp_path / "run", CHAIN)
    assert found.run is not None
    (record,) = found.run.record.anatomies
    failed = msgspec.structs.replace(record, start=2, error="blur did not start.")
    record = msgspec.structs.replace(record, error="blur is static.")
    run = replace(
        found.run, record=msgspec.structs.replace(found.run.record, anatomies=(record, failed))
    )
    text = shown(ReportInput(result=result_of(run), run=run), "text")
    assert "blur is static\n" in text
    assert "No iteration of start 2 was observed from inside: blur did not start\n" in text


ONE_NODE = Graph(
    stages=(Stage("track", ("/in", "/other"), "/out", 0.008),), inputs=("/in", "/other"), rate_hz=20
)
"""The second message of a step comes while the callback of the first one runs."""

BESIDE_A_TIMER = Graph(
    stages=(
        Stage("track", ("/in",), "/out", 0.001, process="all"),
        Stage("spin", (), "", 0.02, period_s=0.1, process="all"),
    )
)


@pytest.mark.parametrize(
    ("graph", "said"),
    [
        (ONE_NODE, "/other waits at track for the callback of /in: 100 % of the wait, "),
        (ONE_NODE, "; one thread calls both"),
        (
            replace(ONE_NODE, threads=(("track", 2),)),
            "; of 2 threads none calls both at once: they are in one mutually exclusive",
        ),
        (BESIDE_A_TIMER, "/in waits at track for a timer of spin (every 100 ms): "),
        (
            CHAIN.with_stage("blur", service_s=0.012),
            "/image waits at blur for the callback of the messages before: 100 % of the wait, ",
        ),
    ],
)
def test_the_callback_for_which_messages_wait_is_named_with_its_reason(
    tmp_path: Path, graph: Graph, said: str
) -> None:
    assert said in " ".join(shown(reported(tmp_path / "run", graph), "text").split())


@pytest.mark.parametrize(
    "graph",
    [
        CHAIN,
        # Nodes of one process that two threads call: one waits for the other only if both are busy.
        replace(BESIDE_A_TIMER, threads=(("all", 2),)),
    ],
)
def test_a_callback_that_only_runs_beside_is_not_named(tmp_path: Path, graph: Graph) -> None:
    assert summary(reported(tmp_path / "run", graph)).blockers == ()
