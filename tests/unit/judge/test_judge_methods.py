"""The methods of verdicts: each is a module with its entries in the registry, and no more."""

from __future__ import annotations

import math
from pathlib import Path
from typing import get_args

import pytest

from r2bspec.judge import judge_requirement
from r2bspec.judge.decision import Question, window_condition
from r2bspec.judge.judge_requirement import decider_of
from r2bspec.judge.methods.method_registry import DECIDERS, METHODS, Method
from r2bspec.language.requirement_grammar import parse_requirement
from r2bspec.measure.metric_catalogue import METRICS

PACKAGE = Path(judge_requirement.__file__).parents[1]
METHOD_MODULES = PACKAGE / "judge" / "methods"
HELPERS = {"__init__", "method_registry", "forecast"}


def question(text: str) -> Question:
    requirement = parse_requirement(text)
    info = METRICS[requirement.metric]
    windows = window_condition(requirement)
    return Question("slo", requirement, 30.0, info, "out", math.nan, windows=windows)


@pytest.mark.parametrize(
    ("text", "module"),
    [
        ("latency.p99 < 50 ms", "percentile_bound"),
        ("latency.p99 == 50 ms", "observation"),
        ("drop_rate <= 1 %", "share_bound"),
        ("drop_rate == 0 %", "observation"),
        ("throughput.mean >= 29 Hz", "mean_bound"),
        ("latency.max < 50 ms", "observation"),
        ("missed == 0", "observation"),
        ("latency.p99 < 50 ms in 99 % of 1 s windows", "window_share"),
        ("missed == 0 in 99 % of 1 s windows", "window_share"),
        ("peak.rate >= 30 Hz", "peak_bracket"),
        ("sustained", "sustained"),
    ],
)
def test_a_requirement_has_its_method(text: str, module: str) -> None:
    assert decider_of(question(text)).decide.__module__ == f"r2bspec.judge.methods.{module}"


def test_every_method_is_in_the_registry() -> None:
    assert set(METHODS) == set(get_args(Method))
    assert set(DECIDERS) == {each.stem for each in METHOD_MODULES.glob("*.py")} - HELPERS
