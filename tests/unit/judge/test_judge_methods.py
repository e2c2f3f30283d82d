"""Which method decides which requirement."""

from __future__ import annotations

import math
from typing import get_args

import pytest

from r2bspec.judge.measure.metric_catalogue import METRICS
from r2bspec.judge.methods import METHODS, Method
from r2bspec.judge.methods.mean_bound import MEAN_BOUND
from r2bspec.judge.methods.peak_bracket import PEAK_BRACKET
from r2bspec.judge.methods.recorded_value import OBSERVATION, SEQUENTIAL_PROBE
from r2bspec.judge.methods.share_bounds import PERCENTILE_BOUND, SHARE_BOUND, WINDOW_SHARE
from r2bspec.judge.pipeline import method_of
from r2bspec.judge.requirement_case import DecisionMethod, RequirementCase
from r2bspec.language.comparison_grammar import parse_requirement


def case(text: str) -> RequirementCase:
    requirement = parse_requirement(text)
    info = METRICS[requirement.metric]
    return RequirementCase("slo", requirement, 30.0, info, "out", math.nan)


@pytest.mark.parametrize(
    ("text", "method"),
    [
        ("latency.p99 < 50 ms", PERCENTILE_BOUND),
        ("latency.p99 == 50 ms", OBSERVATION),
        ("drop_rate <= 1 %", SHARE_BOUND),
        ("drop_rate == 0 %", OBSERVATION),
        ("throughput.mean >= 29 Hz", MEAN_BOUND),
        ("latency.max < 50 ms", OBSERVATION),
        ("missed == 0", OBSERVATION),
        ("latency.p99 < 50 ms in 99 % of 1 s windows", WINDOW_SHARE),
        ("missed == 0 in 99 % of 1 s windows", WINDOW_SHARE),
        ("peak.rate >= 30 Hz", PEAK_BRACKET),
        ("sustained", SEQUENTIAL_PROBE),
    ],
)
def test_a_requirement_has_its_method(text: str, method: DecisionMethod) -> None:
    assert method_of(case(text)) is method


def test_every_method_has_traits() -> None:
    assert set(METHODS) == set(get_args(Method))
