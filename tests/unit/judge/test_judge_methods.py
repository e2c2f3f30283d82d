"""Which method decides which requirement."""

from __future__ import annotations

import math
from typing import get_args

import pytest

from r2bspec.judge.measure.metric_catalogue import METRICS
from r2bspec.judge.methods import METHODS, Method
from r2bspec.judge.methods.mean_bound import judge_mean
from r2bspec.judge.methods.peak_bracket import judge_peak
from r2bspec.judge.methods.recorded_value import judge_accuracy, judge_observation, judge_sustained
from r2bspec.judge.methods.share_bounds import judge_percentile, judge_share, judge_windows
from r2bspec.judge.pipeline import Decide, method_of
from r2bspec.judge.requirement_case import RequirementCase
from r2bspec.language.comparison_grammar import parse_requirement


def case(text: str) -> RequirementCase:
    requirement = parse_requirement(text)
    info = METRICS[requirement.metric]
    return RequirementCase("slo", requirement, 30.0, info, "out", math.nan)


@pytest.mark.parametrize(
    ("text", "method"),
    [
        ("latency.p99 < 50 ms", judge_percentile),
        ("latency.p99 == 50 ms", judge_observation),
        ("drop_rate <= 1 %", judge_share),
        ("drop_rate == 0 %", judge_observation),
        ("throughput.mean >= 29 Hz", judge_mean),
        ("latency.max < 50 ms", judge_observation),
        ("missed == 0", judge_observation),
        ("latency.p99 < 50 ms in 99 % of 1 s windows", judge_windows),
        ("missed == 0 in 99 % of 1 s windows", judge_windows),
        ("peak.rate >= 30 Hz", judge_peak),
        ("sustained", judge_sustained),
        ("accuracy.tag_missed <= 1 %", judge_accuracy),
    ],
)
def test_a_requirement_has_its_method(text: str, method: Decide) -> None:
    assert method_of(case(text)) is method


def test_every_method_has_traits() -> None:
    assert set(METHODS) == set(get_args(Method))
