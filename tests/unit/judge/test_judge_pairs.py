"""Comparisons of interleaved runs, from their folders to their verdicts."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pair_simulation import Comparison, latencies
from r2bspec.compare.report_input import judge_comparison_folder
from r2bspec.judge.measure.metrics import summarise
from r2bspec.judge.measure.run_samples import merged_samples, read_samples
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.record.comparison_folder import open_comparison
from r2bspec.record.files import RecordError
from run_simulation import Played, Simulation, objective, renew_digests

NOISE = np.exp([0.004, -0.006, 0.003, -0.002, 0.005, -0.004])
BASE = (0.020 * NOISE).tolist()
SAME = (0.020 * NOISE[::-1]).tolist()
SLOWER = (0.022 * NOISE[::-1]).tolist()


def judged(comparison: Comparison, path: Path) -> Verdict:
    return judge_comparison_folder(comparison.write(path / "pairs")).result.verdict


def ratio(verdict: Verdict) -> RequirementVerdict:
    return next(
        requirement
        for requirement in verdict.requirements
        if requirement.objective == "no_regression"
    )


def test_what_is_the_same_passes_and_says_what_it_is_of(tmp_path: Path) -> None:
    verdict = judged(Comparison(BASE, SAME), tmp_path)
    assert (verdict.outcome, verdict.exit_code) == ("pass", 0)
    one = ratio(verdict)
    assert (one.method, one.n, one.unit, one.limit) == ("paired t on logs", 6, "share", 1.05)
    assert one.compared is not None
    assert one.compared.base_values == pytest.approx(BASE, rel=0.01)
    assert one.lower is not None
    assert one.upper is not None
    assert one.lower < 1 < one.upper < 1.05


def test_what_is_slower_fails_unless_more_pairs_mend_it(tmp_path: Path) -> None:
    alone = judged(Comparison(BASE, SLOWER), tmp_path / "alone")
    assert (alone.outcome, alone.exit_code) == ("fail", 1)
    assert alone.reason.endswith("No more pairs were played to confirm it.")
    fresh = list(zip(BASE[:3], SLOWER[:3], strict=True))
    confirmed = judged(Comparison(BASE, SLOWER, fresh=fresh), tmp_path / "confirmed")
    assert (confirmed.outcome, ratio(confirmed).n) == ("fail", 9)
    assert confirmed.reason.endswith("Confirmed by 3 more pairs.")
    calm = list(zip(BASE[:3], SAME[:3], strict=True))
    mended = judged(Comparison(BASE, SLOWER, fresh=calm), tmp_path / "mended")
    assert (mended.outcome, mended.exit_code) == ("inconclusive", 3)
    assert mended.reason.endswith("It had failed, but does not with 3 more pairs.")


def test_other_requirements_rest_on_the_runs_of_the_head(tmp_path: Path) -> None:
    one = next(
        requirement
        for requirement in judged(Comparison(BASE, SAME), tmp_path).requirements
        if requirement.objective == "fast"
    )
    assert (one.outcome, one.method, one.n) == ("pass", "exact binomial", 6 * 30)


def test_an_unusable_pair_is_replaced_by_the_one_played_again(tmp_path: Path) -> None:
    broken = [0.2, *SAME[1:]]
    comparison = Comparison(BASE, broken, unusable={1: "head: late"}, again={1: (BASE[0], SAME[0])})
    verdict = judged(comparison, tmp_path)
    assert verdict.outcome == "pass"
    compared = ratio(verdict).compared
    assert compared is not None
    assert compared.head_values[0] == pytest.approx(SAME[0], rel=0.01)


def test_an_unusable_pair_is_dropped_and_said(tmp_path: Path) -> None:
    pairs = Comparison(BASE, SAME, unusable={2: "head: late"}).write(tmp_path / "pairs")
    result = judge_comparison_folder(pairs).result
    assert ratio(result.verdict).n == 5
    assert result.pairs is not None
    assert (result.pairs.planned, result.pairs.used) == (6, 5)
    assert [each.number for each in pairs.usable_pairs()] == [1, 3, 4, 5, 6]


@pytest.mark.parametrize("number", [3, 0])
def test_an_interrupted_comparison_is_incomplete(tmp_path: Path, number: int) -> None:
    killed = Comparison(
        BASE[:number], SAME[:number], planned=6, status="incomplete", reason="R2B670: interrupted"
    )
    verdict = judged(killed, tmp_path)
    assert (verdict.outcome, verdict.exit_code) == ("incomplete", 4)
    assert ratio(verdict).n == number
    assert number or all(requirement.outcome != "pass" for requirement in verdict.requirements)


@pytest.mark.parametrize(
    ("text", "outcome", "said"),
    [
        ("latency.p98x <= 105 % of baseline", "fail", ""),
        ("nobody.latency.p50 <= 105 % of baseline", "fail", ""),
        ("sent <= 105 % of baseline", "fail", ""),
        ("latency.p50 == 100 % of baseline", "inconclusive", "exactly equal"),
    ],
)
def test_what_no_pair_can_answer_never_passes(
    tmp_path: Path, text: str, outcome: str, said: str
) -> None:
    comparison = Comparison(BASE[:2], SAME[:2], objectives={"no_regression": objective(text)})
    one = ratio(judged(comparison, tmp_path))
    assert one.outcome == outcome
    assert said in one.reason


def test_a_silent_head_fails_also_where_the_base_is_silent(tmp_path: Path) -> None:
    everything = objective(
        "latency.p50 <= 105 % of baseline",
        "throughput.mean >= 95 % of baseline",
        "drop_rate <= 105 % of baseline",
    )
    comparison = Comparison(BASE, SAME, objectives={"no_regression": everything})
    pairs = comparison.write(tmp_path / "pairs")
    for pair in pairs.record.pairs:
        for folder in (pair.base, pair.head):
            (segment,) = (pairs.folder / folder / "samples").iterdir()
            (segment / "monitor.detections.npy").unlink()
            silent = Simulation(segments=[Played(30.0, latencies(0.02), silent=("detections",))])
            mute = silent.write(tmp_path / "mute" / folder).folder / "samples" / segment.name
            (mute / "monitor.detections.npy").rename(segment / "monitor.detections.npy")
            renew_digests(pairs.folder / folder)
    verdict = judge_comparison_folder(pairs).result.verdict
    assert [requirement.outcome for requirement in verdict.requirements] == ["fail"] * 3


def test_runs_read_as_one_keep_every_sample(tmp_path: Path) -> None:
    pairs = Comparison(BASE, SLOWER).write(tmp_path / "pairs")
    merged = pairs.merged(pairs.usable_pairs(), "head")
    samples = read_samples(merged)
    (iterations,) = samples.iterations.values()
    assert [iteration.segment.index for iteration in iterations] == [1, 2, 3, 4, 5, 6]
    assert len({iteration.segment.id for iteration in iterations}) == 6
    alone = [read_samples(pairs.run(usable_pair, "head")) for usable_pair in pairs.usable_pairs()]
    for one, run in zip(iterations, alone, strict=True):
        (own,) = next(iter(run.iterations.values()))
        np.testing.assert_array_equal(
            one.monitors["detections"].latency,
            own.monitors["detections"].latency,
        )
        assert one.processes.keys() == own.processes.keys()
    together = merged_samples(merged, alone)
    assert summarise(together) == summarise(samples)
    assert together.incomplete == samples.incomplete


def test_a_newer_folder_and_an_exchanged_plan_are_said(tmp_path: Path) -> None:
    pairs = Comparison(BASE[:2], SAME[:2]).write(tmp_path / "pairs")
    plan = pairs.folder / "plan.json"
    plan.write_text(plan.read_text().replace("simulated", "exchanged"))
    with pytest.raises(RecordError, match="not the plan"):
        open_comparison(pairs.folder)
    record = pairs.folder / "pairs.json"
    record.write_text(json.dumps(json.loads(record.read_text()) | {"r2bspec_pairs": 2}))
    with pytest.raises(RecordError, match="version 2") as caught:
        open_comparison(pairs.folder)
    assert caught.value.hint
