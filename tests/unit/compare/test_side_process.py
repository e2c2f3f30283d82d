"""When either side of a comparison by turns is played."""

from __future__ import annotations

from typing import Any

import pytest

from r2bspec.compare.side_process import LONGEST_TURN_S, STEPS, BothSides
from r2bspec.ipc.schedule import Turns


def turns(rate_hz: float, step_s: float, seed: int = 1) -> dict[str, Turns]:
    both = BothSides(seed=seed, alone=frozenset({"head"}), channels={})
    point: Any = ("turns", {"rate_hz": rate_hz, "step_s": step_s})
    answers = both._answers({"base": point, "head": point})
    return {side: answers[side] for side in ("base", "head")}


def due_ns(side: Turns) -> list[int]:
    return [round(step * 1e9 / side.pair_hz) + delay for step, delay in enumerate(side.delays_ns)]


@pytest.mark.parametrize(("rate_hz", "step_s"), [(20.0, 0.006), (20.0, 0.04), (100.0, 0.0)])
def test_each_pair_of_steps_has_a_turn_of_either_side(rate_hz: float, step_s: float) -> None:
    played = turns(rate_hz, step_s)
    base, head = played["base"], played["head"]
    assert base.begin_ns == head.begin_ns
    assert base.pair_hz == head.pair_hz <= rate_hz
    turn_ns = 0.5e9 / base.pair_hz
    assert turn_ns >= 2 * step_s * 1e9
    for one, other in zip(due_ns(base), due_ns(head), strict=True):
        assert abs(one - other) == pytest.approx(turn_ns, abs=2)


def test_a_coin_decides_which_side_is_first() -> None:
    orders = [
        tuple(delay > 0 for delay in turns(20.0, 0.0, seed)["base"].delays_ns) for seed in range(8)
    ]
    assert len(set(orders)) == len(orders)
    assert all(len(order) == STEPS and 5 < sum(order) < STEPS - 5 for order in orders)


def test_steps_that_take_too_long_are_played_alone() -> None:
    both = BothSides(seed=1, alone=frozenset({"head"}), channels={})
    point: Any = ("turns", {"rate_hz": 20.0, "step_s": LONGEST_TURN_S})
    assert both._answers({"base": point, "head": point}) == {"base": None, "head": None}
    assert "a step takes" in both.too_long
    alone: Any = ("alone", None)
    assert sorted(both._answers({"base": alone, "head": alone}).values()) == [0, 1]


def test_the_base_is_played_alone_only_where_that_is_needed() -> None:
    both = BothSides(seed=1, alone=frozenset({"head"}), channels={})
    alone: Any = ("alone", None)
    assert both._answers({"base": alone, "head": alone}) == {"base": None, "head": 0}


def test_turns_are_twice_as_long_while_steps_of_a_side_outlast_them() -> None:
    both = BothSides(seed=1, alone=frozenset({"head"}), channels={})
    ask: Any = ("turns", {"rate_hz": 20.0, "step_s": 0.0})

    def pair_hz() -> float:
        return both._answers({"base": ask, "head": ask})["head"].pair_hz

    def crowded(*, base: bool, head: bool) -> bool:
        answers = both._answers({"base": ("crowded", base), "head": ("crowded", head)})
        assert answers["base"] == answers["head"]
        return bool(answers["head"])

    assert pair_hz() == 20.0
    assert crowded(base=True, head=False)
    assert pair_hz() == 10.0
    assert crowded(base=False, head=True)
    assert pair_hz() == 5.0
    assert not crowded(base=False, head=False)
    assert pair_hz() == 20.0


def test_steps_that_never_fit_are_played_alone() -> None:
    both = BothSides(seed=1, alone=frozenset({"head"}), channels={})
    ask: Any = ("turns", {"rate_hz": 20.0, "step_s": 0.0})
    played = 0
    while both._answers({"base": ask, "head": ask})["head"] is not None:
        played += 1
        both._answers({"base": ("crowded", True), "head": ("crowded", True)})
    assert played == 4
    assert "a step takes" in both.too_long
