"""What is said of `tune.minimize`; `tests/golden/check/tune.yaml` has paths and values."""

from __future__ import annotations

import pytest
from check_specs import findings

from example_spec import example

IMAGE = "sensor_msgs/msg/Image"
SPEC = example(
    monitors=f"""
        first: {{topic: output, format: {IMAGE}}}
        again: {{topic: output, format: {IMAGE}, match: order}}
    """
)


@pytest.mark.parametrize(
    ("metric", "words"),
    [
        ("throughput.mean", "better when it is larger"),
        ("latency.p99", "of every monitor: 'first' and 'again'"),
        ("relay.callback.p99", "not observed"),
        ("first.latency.p98x", "no metric"),
        ("first.latency.p99", ""),
        ("memory.graph.max", ""),
    ],
)
def test_what_is_minimized_is_one_value_that_is_better_when_it_is_smaller(
    metric: str, words: str
) -> None:
    found = findings(f"{SPEC}tune: {{minimize: {metric}}}\n", offline=True)
    said = [finding.message for finding in found if finding.code == "R2B810"]
    assert len(said) == bool(words)
    assert all(words in message for message in said)
