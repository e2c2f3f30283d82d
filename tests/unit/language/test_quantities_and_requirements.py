"""Strings with units, and the sentences that are judged."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nightly import size
from r2bspec.language.comparison_grammar import Bound, ComparisonError, parse_requirement
from r2bspec.language.quantities import Duration, Quantity, QuantityError, Rate, Share, Size

NS = st.integers(0, 10**18)


@given(NS)
def test_durations_survive_being_written(ns: int) -> None:
    assert Duration.parse(str(Duration(ns))) == Duration(ns)


@given(st.integers(0, 2**50))
def test_sizes_survive_being_written(count: int) -> None:
    assert Size.parse(str(Size(count))) == Size(count)


@given(st.floats(1e-6, 1e9))
def test_rates_and_shares_survive_being_written(value: float) -> None:
    assert Rate.parse(str(Rate(value))) == Rate(value)
    assert Share.parse(str(Share(value))).fraction == pytest.approx(value)


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (Duration, "10 s", Duration(10**10)),
        (Duration, "0.5s", Duration(5 * 10**8)),
        (Duration, "1.5e2 ms", Duration(15 * 10**7)),
        (Duration, " 2 µs ", Duration(2000)),
        (Duration, "2 μs", Duration(2000)),  # the Greek letter
        (Duration, "1 min", Duration(60 * 10**9)),
        (Rate, "30fps", Rate(30)),
        (Rate, "500 mHz", Rate(0.5)),
        (Share, "2 %", Share(0.02)),
        (Size, "64 MiB", Size(2**26)),
    ],
)
def test_quantities(kind: type[Quantity], text: str, value: Quantity) -> None:
    assert kind.parse(text) == value


@pytest.mark.parametrize(
    ("kind", "text", "suggestion", "same"),
    [
        (Duration, "10", "10 s", False),
        (Duration, "10 sec", "10 s", True),
        (Duration, "10 S", "10 s", True),
        (Duration, "10 m", "10 s", False),  # metres, minutes, milliseconds?
        (Duration, "ten", "10 s", False),
        (Duration, "-1 s", "10 s", False),
        (Duration, "1 s 2 ms", "10 s", False),
        (Duration, "٣ s", "10 s", False),
        (Rate, "30 hz", "30 Hz", True),
        (Rate, "30 MHz", "30 Hz", False),
        (Share, "5 percent", "5 %", True),
        (Size, "5 mb", "5 MB", True),
        (Duration, "1e20 s", "", False),
        (Duration, "1e99999 s", "", False),
        (Duration, "9" * 100 + " s", "10 s", False),
    ],
)
def test_what_is_none(kind: type[Quantity], text: str, suggestion: str, same: bool) -> None:
    with pytest.raises(QuantityError) as caught:
        kind.parse(text)
    assert (caught.value.suggestion, caught.value.is_equivalent) == (suggestion, same)
    assert len(str(caught.value)) < 150


@pytest.mark.parametrize(
    ("text", "metric", "op", "value", "dimension"),
    [
        ("latency.p99 < 50 ms", "latency.p99", "<", 0.05, "time"),
        ("detections.latency.p99<=50ms", "detections.latency.p99", "<=", 0.05, "time"),
        (" drop_rate <= 0.5 %", "drop_rate", "<=", 0.005, "share"),
        ("peak.rate >= 30 Hz", "peak.rate", ">=", 30.0, "rate"),
        ("memory.x.max < 1 GiB", "memory.x.max", "<", 2.0**30, "size"),
        ("missed == 0", "missed", "==", 0.0, "count"),
        ("throughput.mean >= 97 % of offered", "throughput.mean", ">=", 0.97, "share"),
    ],
)
def test_requirements(text: str, metric: str, op: str, value: float, dimension: str) -> None:
    found = parse_requirement(text)
    assert found.bound is not None
    assert (found.metric, found.op) == (metric, op)
    assert found.bound.value == pytest.approx(value)
    assert found.bound.dimension == dimension
    assert text[found.metric_column :].startswith(metric)
    assert text[found.bound_column :].strip()[0].isdigit()


@pytest.mark.parametrize(
    ("text", "column", "suggestion"),
    [
        ("", 0, "latency.p99 < 50 ms"),
        ("  < 5 ms", 2, "latency.p99 < 50 ms"),
        ("latency.p99 5 ms", 12, "latency.p99 < ..."),
        ("latency.p99 =< 5 ms", 12, "latency.p99 <= ..."),
        ("latency.p99 ≥ 5 ms", 12, "latency.p99 >= ..."),
        ("latency.p99 <", 13, "50 ms"),
        ("latency.p99 < 5 mss", 16, "5 ms"),
        ("latency.p99 < soon", 14, ""),
        ("sustained > 3", 10, ""),
        ("x >= 97 % of base", 13, "97 % of baseline"),
        ("latency." + "p" * 1000, 0, ""),
    ],
)
def test_where_a_sentence_breaks(text: str, column: int, suggestion: str) -> None:
    with pytest.raises(ComparisonError) as caught:
        parse_requirement(text)
    assert (caught.value.column, caught.value.suggestion) == (column, suggestion)


@settings(max_examples=size(30, 200))
@given(st.text(max_size=60))
def test_any_text_is_a_requirement_or_says_where_not(text: str) -> None:
    broken_at = None
    try:
        parse_requirement(text)
    except ComparisonError as error:
        broken_at = error.column
    assert broken_at is None or 0 <= broken_at <= len(text)


def test_a_bound_relative_to_an_earlier_run() -> None:
    bound = parse_requirement("latency.p50 <= 105 % of baseline").bound
    assert bound == Bound(value=1.05, dimension="share", of_baseline=True)
