"""What a busy machine leaves open beside work that is decided."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.pair_comparison import leave_latencies_open
from r2bspec.judge.verdict import DisturbedIteration, Outcome, RequirementVerdict, Verdict
from report_runs import USUAL

POLICY = DecisionPolicy()


def verdict(folder: Path, work: Outcome, latency: Outcome, *, disturbed: int = 4) -> Verdict:
    """The verdict on work and latency by turns, with this number of disturbed iterations."""
    judged = result_of(USUAL.write(folder)).verdict
    first = judged.requirements[0]

    def on(metric: str, outcome: Outcome) -> RequirementVerdict:
        return msgspec.structs.replace(
            first, metric=metric, outcome=outcome, method="trimmed t by turns", remedy="More."
        )

    return msgspec.structs.replace(
        judged,
        requirements=(),
        disturbed=tuple(
            DisturbedIteration(segment=f"iteration-{number}", rate_hz=30, reasons=("busy",))
            for number in range(disturbed)
        ),
    ).with_requirements((on("work.graph.p50", work), on("latency.p50", latency)), "report")


def test_a_latency_that_is_not_decided_beside_work_that_passes_is_left_open(
    tmp_path: Path,
) -> None:
    found = leave_latencies_open(verdict(tmp_path, "pass", "inconclusive"), 6, POLICY)
    assert (found.outcome, found.exit_code) == ("pass", 0)
    work, latency = found.requirements
    assert (work.left_open, latency.left_open) == (False, True)
    assert (latency.outcome, latency.remedy) == ("inconclusive", "")
    assert "1 more could not be decided on this busy machine." in found.reason


@pytest.mark.parametrize(
    ("work", "latency", "disturbed", "policy"),
    [
        ("pass", "fail", 4, POLICY),
        ("inconclusive", "inconclusive", 4, POLICY),
        ("fail", "inconclusive", 4, POLICY),
        ("pass", "inconclusive", 2, POLICY),
        ("pass", "inconclusive", 4, DecisionPolicy(interference="tolerate")),
        ("pass", "inconclusive", 4, DecisionPolicy(inconclusive="fail")),
    ],
)
def test_nothing_else_is(
    tmp_path: Path, work: Outcome, latency: Outcome, disturbed: int, policy: DecisionPolicy
) -> None:
    judged = verdict(tmp_path, work, latency, disturbed=disturbed)
    found = leave_latencies_open(judged, 6, policy)
    assert found == judged
    assert found.outcome != "pass"
