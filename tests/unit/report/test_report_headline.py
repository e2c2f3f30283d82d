"""The first line of a report: the verdict, the one number that decided it, and what changed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from pair_simulation import Comparison
from r2bspec.compare.report_input import ReportInput, read_folder
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import Unusable
from r2bspec.record.graph_identity import GraphIdentity, Revision
from r2bspec.record.run_record import SearchRecord, StartRecord
from r2bspec.report.format_registry import renderer
from r2bspec.report.wording import base_name, headline
from report_runs import with_starts
from run_simulation import Played, Simulation, objective, probe

pytestmark = pytest.mark.usefixtures("without_charts")

NOISE = np.exp([0.004, -0.006, 0.003, -0.002, 0.005, -0.004])
SEARCH = SearchRecord(
    probes=(probe(5, holds=True), probe(200, holds=False), probe(25.5, holds=True)),
    holds_hz=25.5,
    fails_hz=200,
    limited_by="graph",
)


def ramp(low_ms: float, high_ms: float, number: int = 600) -> np.ndarray:
    """Latencies that are spread evenly, and alike in each third."""
    return np.tile(np.linspace(low_ms, high_ms, number // 3) / 1e3, 3)


SIMULATIONS = {
    "usual": Simulation(segments=[Played(30, ramp(20, 31)) for _ in range(6)]),
    "silent": Simulation(
        segments=[Played(30, ramp(20, 31), silent=("extra",)) for _ in range(3)],
        monitors=("detections", "extra"),
    ),
    "few": Simulation(segments=[Played(30, ramp(20, 31, 30)) for _ in range(3)]),
    "probed": Simulation(
        segments=[Played(30, ramp(20, 31))],
        search=SEARCH,
        sustained=(probe(35, holds=True), probe(36, holds=False)),
    ),
    "killed": Simulation(
        segments=[Played(30, ramp(20, 31))],
        status="incomplete",
        reason="process apriltag ended\nwith signal 9",
    ),
    "late": Simulation(segments=[Played(60, ramp(20, 31), late=np.linspace(0, 3, 600))]),
}


def result(
    folder: Path, *requirements: str, at: str = "30 Hz", simulation: str = "usual"
) -> Result:
    """The result of a run, judged; of several starts, so that the line is short."""
    objectives = {"fast": objective(*requirements, at=at)} if requirements else {}
    run = replace(SIMULATIONS[simulation], objectives=objectives).write(folder)
    starts = (StartRecord(number=number, began_ns=0, ready_ns=1) for number in (1, 2, 3))
    return result_of(with_starts(run, *starts))


@pytest.mark.parametrize(
    ("requirements", "line"),
    [
        ("latency.p99 < 40 ms", "✔ PASS simulated: latency.p99 30.9 ms < 40 ms at 30 Hz"),
        ("latency.p99 < 25 ms", "✘ FAIL simulated: latency.p99 30.9 ms > 25 ms at 30 Hz"),
        ("latency.mean < 40 ms", "✔ PASS simulated: latency.mean 25.5 ms < 40 ms at 30 Hz"),
        ("latency.mean < 20 ms", "✘ FAIL simulated: latency.mean 25.5 ms > 20 ms at 30 Hz"),
        ("drop_rate <= 2 %", "✔ PASS simulated: drop_rate 0 % <= 2 % at 30 Hz"),
        (
            "throughput.mean >= 95 % of offered",
            "✔ PASS simulated: throughput.mean 30 Hz >= 28.5 Hz at 30 Hz",
        ),
        ("received <= 3600", "✔ PASS simulated: received 3,600 <= 3,600 at 30 Hz"),
        ("received == 3600", "✔ PASS simulated: received 3,600 = 3,600 at 30 Hz"),
        ("throughput.mean > 60 Hz", "✘ FAIL simulated: throughput.mean 30 Hz < 60 Hz at 30 Hz"),
        ("received > 0", "✔ PASS simulated: received 3,600 > 0 at 30 Hz"),
        ("received == 7", "✘ FAIL simulated: received 3,600 > 7 at 30 Hz"),
        (
            "latncy.p50 < 40 ms",
            (
                "✘ FAIL simulated: latncy.p50 < 40 ms at 30 Hz: there is no metric 'latncy.p50'; "
                "did you mean latency.p50?"
            ),
        ),
        # A pass names the requirement that is nearest to its limit, a fail the furthest beyond.
        (
            "latency.p99 < 1 s; latency.p50 < 31 ms; received > 0",
            "✔ PASS simulated: latency.p50 25.5 ms < 31 ms at 30 Hz, the nearest of 3 to its limit",
        ),
        # The rate that is delivered cannot exceed the offered one, so it is not near to 95 % of it.
        (
            "throughput.mean >= 95 % of offered; latency.p50 < 60 ms",
            "✔ PASS simulated: latency.p50 25.5 ms < 60 ms at 30 Hz, the nearest of 2 to its limit",
        ),
        (
            "latency.p99 < 25 ms; latency.p50 < 10 ms; received > 0",
            "✘ FAIL simulated: latency.p50 25.5 ms > 10 ms at 30 Hz, and 1 more failed",
        ),
        ("", "– NOT JUDGED simulated: The spec has no objective to judge"),
    ],
)
def test_the_number_that_decided_next_to_its_limit(
    tmp_path: Path, requirements: str, line: str
) -> None:
    assert headline(result(tmp_path, *filter(None, requirements.split("; ")))) == line


def test_an_inconclusive_says_what_is_open_and_what_would_decide_it(tmp_path: Path) -> None:
    required = ("latency.p99 < 40 ms", "latency.p50 < 40 ms")
    found = result(tmp_path / "two", *required, simulation="few")
    line = headline(found)
    assert line.startswith("? INCONCLUSIVE simulated: 1 of 2 open, latency.p99 ")
    (verdict,) = (requirement for requirement in found.verdict.requirements if requirement.remedy)
    assert "limit 40 ms" in line
    remedy = verdict.remedy.rpartition(". ")[2].rstrip(".")
    assert line.endswith(f"; {remedy[:1].lower()}{remedy[1:]}")
    alone = headline(result(tmp_path / "one", required[0], simulation="few"))
    assert "open is latency.p99 " in alone


@pytest.mark.parametrize(
    ("requirement", "at", "line"),
    [
        ("peak.rate >= 10 Hz", "", "✔ PASS of this start of simulated: peak.rate 25.5 Hz >= 10 Hz"),
        ("peak.rate >= 300 Hz", "", "✘ FAIL of this start of simulated: peak.rate 25.5 Hz < 300"),
        ("sustained", "35 Hz", "✔ PASS of this start of simulated: 35 Hz was sustained"),
        ("sustained", "36 Hz", "✘ FAIL of this start of simulated: 36 Hz was not sustained"),
    ],
)
def test_a_peak_and_a_sustained_rate(tmp_path: Path, requirement: str, at: str, line: str) -> None:
    assert headline(result(tmp_path, requirement, at=at, simulation="probed")).startswith(line)


def test_a_run_that_was_cut_short_or_cannot_be_judged_says_why(tmp_path: Path) -> None:
    killed = result(tmp_path / "killed", "latency.p50 < 1 s", simulation="killed")
    assert headline(killed) == "! INCOMPLETE simulated: process apriltag ended with signal 9"
    invalid = result(tmp_path / "late", "latency.p50 < 1 s", at="60 Hz", simulation="late")
    assert invalid.verdict.outcome == "invalid"
    assert headline(invalid).startswith("! INVALID simulated: ")
    assert headline(invalid).endswith(" ".join(invalid.verdict.reason.rstrip(".").split()))
    assert isinstance(invalid.verdict.unusable[0], Unusable)


def pairs(folder: Path, factor: float, *, control: bool = False) -> Result:
    level = 0.020 * NOISE
    compared = Comparison(level.tolist(), (level[::-1] * factor).tolist(), control=control)
    return read_folder(compared.write(folder).folder).result


@pytest.fixture(scope="module")
def slower(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A comparison with a head that takes 16 % longer."""
    return pairs(tmp_path_factory.mktemp("slower") / "pairs", 1.16)


@pytest.fixture(scope="module")
def same(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A comparison with a head that takes as long."""
    return pairs(tmp_path_factory.mktemp("same") / "pairs", 1.0)


class TestComparison:
    def test_a_ratio_has_its_interval_and_its_base(
        self, slower: Result, same: Result, tmp_path: Path
    ) -> None:
        assert headline(slower) == (
            "✘ FAIL simulated: latency.p50 116 % [115, 117] of other.r2b.yaml, limit 105 % at 30 Hz"
        )
        assert headline(same).startswith("✔ PASS simulated: latency.p50 ")
        control = pairs(tmp_path / "control", 1.0, control=True)
        assert base_name(control) == "itself"

    def test_what_changed_ends_the_line(self, slower: Result) -> None:
        changed = msgspec.structs.replace(slower, changes=("blur.py changed", "numpy 2.1 → 2.2"))
        end = "; blur.py changed, numpy 2.1 → 2.2"
        assert headline(changed) == headline(slower) + end
        shown = ReportInput(result=changed)
        firsts = {
            "text": renderer("text")(shown).decode().splitlines()[0],
            "markdown": renderer("markdown")(shown).decode().splitlines()[0],
            "github": renderer("github")(shown).decode().splitlines()[0],
            "junit": renderer("junit")(shown).decode().partition("<failure")[2].splitlines()[0],
            "html": renderer("html")(shown).decode().partition("<h1")[2].partition("</h1>")[0],
        }
        for name, first in firsts.items():
            assert "FAIL" in first, name
            assert end[2:] in first, name

    def test_a_base_that_is_a_revision_has_its_name_and_commit(self, slower: Result) -> None:
        revisions = [
            Revision(commit="3f2a1c4d" + "0" * 32, dirty=True),
            Revision(commit="9b1e44f0" + "0" * 32, dirty=False, name="origin/main"),
        ]
        head, base = (
            GraphIdentity(digest=revision.commit, nodes={}, packages={}, revision=revision)
            for revision in revisions
        )
        changes = ("blur.py changed",)
        named = msgspec.structs.replace(slower, identity=head, base_identity=base, changes=changes)
        assert headline(named) == (
            "✘ FAIL simulated: latency.p50 116 % [115, 117] of origin/main@9b1e44f, "
            "limit 105 % at 30 Hz; blur.py changed"
        )
