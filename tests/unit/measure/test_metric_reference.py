"""Every metric is defined, and the command line shows it."""

from __future__ import annotations

import pytest

from example_spec import example
from r2bspec.check import check
from r2bspec.cli.main import main
from r2bspec.judge.measure import metric_catalogue as reference
from r2bspec.judge.measure.metric import PLACEHOLDERS
from r2bspec.judge.measure.metric_declarations import DECLARED
from r2bspec.language.comparison_grammar import ComparisonError, parse_requirement
from r2bspec.language.load_spec import load_spec

METRICS = reference.listed()


def filled(name: str) -> str:
    """A name with something in the place of its placeholder."""
    for placeholder in PLACEHOLDERS:
        name = name.replace(placeholder, "camera")
    return name


def test_every_metric_is_defined_in_a_text_and_a_formula() -> None:
    assert all(metric.text and metric.formula for metric in DECLARED)


def test_every_metric_can_be_explained(capsys: pytest.CaptureFixture[str]) -> None:
    for name, info in METRICS.items():
        assert main(["docs", filled(name)]) == 0
        shown = capsys.readouterr().out
        assert shown.startswith(f"{filled(name)}: {info.description}\n")
        assert f"unit          {info.unit or 'none'}\n" in shown
        assert "\nformula       " in shown


def test_the_example_of_a_metric_is_a_requirement_with_its_unit() -> None:
    for name, info in METRICS.items():
        bound = parse_requirement(filled(info.example)).bound
        assert (bound is None) == (info.dimension == "none"), name
        assert bound is None or info.accepts(bound), name


def test_an_unknown_metric_is_answered_with_the_meant_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["docs", "latncy.p99"]) == 2
    assert "did you mean latency.p99?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "suggestion"),
    [
        ("latency.p99.9 < 50 ms", "latency.p99_9 < 50 ms"),
        ("detections.jitter.p99.95 <= 1 ms", "detections.jitter.p99_95 <= 1 ms"),
    ],
)
def test_a_percentile_with_a_point_is_answered_with_an_underscore(
    text: str, suggestion: str
) -> None:
    with pytest.raises(ComparisonError) as caught:
        parse_requirement(text)
    assert caught.value.suggestion == suggestion
    assert parse_requirement(suggestion).metric == suggestion.split()[0]
    assert text[caught.value.column :].startswith("p99.9")


@pytest.mark.parametrize(
    ("requirement", "written"),
    [
        ("latency.p50 < 100", "write 100 ms"),
        ("throughput.mean >= 25", "write 25 Hz"),
        ("drop_rate <= 1", "write 1 %"),
    ],
)
def test_a_bound_without_a_unit_is_answered_with_one(requirement: str, written: str) -> None:
    loaded = load_spec(example(slos=f"{{fast: {{at: 30 Hz, require: ['{requirement}']}}}}"))
    found = [each for each in check(loaded, offline=True) if each.code == "R2B502"]
    assert [(each.message.endswith("has no unit"), each.help) for each in found] == [
        (True, written)
    ]
