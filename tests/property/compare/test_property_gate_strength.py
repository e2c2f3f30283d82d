"""What is true of any two gates: a spec is as strong as itself, and equal strength is equality."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from compared_gates import DOCUMENT, GONE, side, with_value
from nightly import size
from r2bspec.compare.gate_strength import compare_gates
from r2bspec.compare.objective_strength import implies
from r2bspec.language.comparison_grammar import parse_requirement
from r2bspec.plan.prepared_benchmark import PreparedBenchmark

GATE_VALUES: dict[tuple[str | int, ...], list[Any]] = {
    ("benchmark", "duration"): ["2 s", "4 s"],
    ("benchmark", "iterations"): [8, 10],
    ("benchmark", "starts"): [2, 3, 5],
    ("benchmark", "rates"): [["10 Hz", "30 Hz"], ["30 Hz"], ["30 Hz", "50 Hz"]],
    ("benchmark", "warm_up"): ["1 s", "2 s"],
    ("benchmark", "gate", "confidence"): ["90 %", "95 %"],
    ("benchmark", "gate", "inconclusive"): ["pass", "report", "fail"],
    ("benchmark", "gate", "confirm"): [True, False],
    ("benchmark", "gate", "time_budget"): [GONE, "5 min", "10 min"],
    ("benchmark", "gate", "interference"): ["tolerate", "note"],
    ("benchmark", "search", "max"): ["50 Hz", "60 Hz"],
    ("playback", "buffer"): [0, 5, 10],
    ("data_loader", "window", "end"): ["8 s", GONE],
    ("slos", "fast", "level"): [GONE, "warn"],
    ("slos", "fast", "when"): [GONE, {"threads": 1}],
    ("slos", "fast", "confidence"): [GONE, "90 %", "99 %"],
    ("slos", "fast", "require"): [
        ["out.latency.p90 < 50 ms"],
        ["out.latency.p90 <= 50 ms"],
        ["out.latency.p90 < 60 ms", "out.drop_rate <= 1 %"],
        ["out.drop_rate <= 1 %"],
    ],
    ("monitors", "other", "match"): ["stamp", "order"],
}


@lru_cache(maxsize=256)
def gate(choices: tuple[int, ...]) -> PreparedBenchmark:
    document = DOCUMENT
    for (path, values), choice in zip(GATE_VALUES.items(), choices, strict=True):
        document = with_value(document, path, values[choice])
    return side(document)


CHOICES = st.tuples(*(st.integers(0, len(values) - 1) for values in GATE_VALUES.values()))
LIMITS = st.integers(1, 4)
OPERATORS = st.sampled_from(["<", "<=", ">", ">=", "==", "!="])


@settings(max_examples=size(20, 100), deadline=None)
@given(CHOICES)
def test_a_gate_is_as_strong_as_itself(choices: tuple[int, ...]) -> None:
    comparison = compare_gates(gate(choices), gate(choices))
    assert (comparison.weaker, comparison.stronger, comparison.sentences) == ((), (), ())


@settings(max_examples=size(20, 100), deadline=None)
@given(
    CHOICES,
    st.lists(st.tuples(st.integers(0, len(GATE_VALUES) - 1), st.integers(0, 3)), max_size=2),
)
def test_gates_of_which_neither_is_weaker_are_the_same(
    choices: tuple[int, ...], changes: list[tuple[int, int]]
) -> None:
    changed = list(choices)
    sizes = [len(values) for values in GATE_VALUES.values()]
    for index, choice in changes:
        changed[index] = choice % sizes[index]
    one, other = gate(choices), gate(tuple(changed))
    if not compare_gates(one, other).weaker and not compare_gates(other, one).weaker:
        assert _content(one) == _content(other)


def _content(gate_side: PreparedBenchmark) -> tuple[Any, ...]:
    """Everything that these gates may differ in; objectives that cannot fail are not part of it."""
    plan = gate_side.plan
    errors = {name: each for name, each in plan.objectives.items() if each.level == "error"}
    texts = {name: tuple(one.text for one in each.require) for name, each in errors.items()}
    conditions = {name: (each.when, each.confidence) for name, each in errors.items()}
    parts = (plan.play, plan.starts, plan.gate, plan.search, plan.buffer, plan.dataset)
    return (
        *parts,
        plan.monitors,
        plan.warm_up,
        texts,
        _of_gate(conditions, plan.gate.confidence),
    )


def _of_gate(conditions: dict[str, Any], confidence: float) -> dict[str, Any]:
    """The confidence that applies: one that is stated is the same as one that is not."""
    return {
        name: (when, own.fraction if own is not None else confidence)
        for name, (when, own) in conditions.items()
    }


@given(OPERATORS, LIMITS, OPERATORS, LIMITS)
def test_a_bound_implies_another_if_and_only_if_every_value_that_meets_it_meets_the_other(
    op: str, limit: int, other_op: str, other_limit: int
) -> None:
    one, other = (
        parse_requirement(f"sent {symbol} {value}")
        for symbol, value in ((op, limit), (other_op, other_limit))
    )
    values = [each / 2 for each in range(12)]
    meets_both = all(
        other.is_met(value, other_limit) for value in values if one.is_met(value, limit)
    )
    assert implies(one, other) is meets_both
