"""When either side of a comparison by turns is played."""

from __future__ import annotations

from typing import Any

import pytest

from r2bspec.compare.interleaved_comparison import STEPS
from r2bspec.compare.side_process import BothSides
from r2bspec.ipc.schedule import Turns
from r2bspec.record.run_record import TurnKind

CORES = (0, 2, 5)


def both_sides(seed: int = 1, turns: tuple[TurnKind, ...] = ("turns",)) -> BothSides:
    return BothSides(seed, turns, frozenset({"head"}), CORES, channels={})


def asked(both: BothSides, point: str, base: Any, head: Any) -> dict[str, Any]:
    answers = both._answers({"base": (point, base), "head": (point, head)})
    return {"base": answers["base"], "head": answers["head"]}


def asked_turns(both: BothSides, rate_hz: float, kind: TurnKind = "turns") -> dict[str, Any]:
    return asked(both, "turns", (kind, rate_hz), (kind, rate_hz))


def turns(rate_hz: float, seed: int = 1) -> dict[str, Turns]:
    return asked_turns(both_sides(seed), rate_hz)


def due_ns(side: Turns) -> list[int]:
    return [round(step * 1e9 / side.pair_hz) + delay for step, delay in enumerate(side.delays_ns)]


@pytest.mark.parametrize("rate_hz", [5.0, 20.0, 100.0])
def test_each_pair_of_steps_has_a_turn_of_either_side(rate_hz: float) -> None:
    played = turns(rate_hz)
    base, head = played["base"], played["head"]
    assert base.begin_ns == head.begin_ns
    assert base.pair_hz == head.pair_hz == pytest.approx(rate_hz)
    turn_ns = 0.5e9 / rate_hz
    for one, other in zip(due_ns(base), due_ns(head), strict=True):
        assert abs(one - other) == pytest.approx(turn_ns, abs=2)


def test_a_coin_decides_which_side_is_first() -> None:
    orders = [
        tuple(delay > 0 for delay in turns(20.0, seed)["base"].delays_ns) for seed in range(8)
    ]
    assert len(set(orders)) == len(orders)
    assert all(len(order) == STEPS and 5 < sum(order) < STEPS - 5 for order in orders)


def test_the_base_is_played_alone_only_where_that_is_needed() -> None:
    assert asked(both_sides(), "alone", None, None) == {"base": None, "head": 0}


def test_turns_are_twice_as_long_while_steps_of_a_side_outlast_them() -> None:
    both = both_sides()

    def pair_hz() -> float:
        return float(asked_turns(both, 20.0)["head"].pair_hz)

    def again(base_s: float, head_s: float) -> bool:
        answers = asked(both, "played", base_s, head_s)
        assert answers["base"] == answers["head"]
        return bool(answers["head"])

    assert pair_hz() == 20.0
    assert again(0.030, 0.020)
    assert pair_hz() == 10.0
    assert again(0.020, 0.060)
    assert pair_hz() == 5.0
    assert not again(0.020, 0.060)
    # The next start begins with what steps took in this one.
    assert pair_hz() == pytest.approx(0.5 / 0.090)
    assert not again(0.001, 0.002)
    assert pair_hz() == 20.0


@pytest.mark.parametrize(("rate_hz", "most"), [(20.0, 4), (0.5, 2), (0.1, 0)])
def test_steps_that_never_fit_are_played_alone(rate_hz: float, most: int) -> None:
    both = both_sides()
    played = 0
    while asked_turns(both, rate_hz)["head"] is not None:
        played += 1
        asked(both, "played", 0.0, 100.0)
    assert played == most
    assert "a turn would take" in both.too_long
    assert sorted(asked(both, "alone", None, None).values()) == [0, 1]


def test_a_recording_with_its_own_times_is_not_played_by_turns() -> None:
    both = both_sides()
    assert asked_turns(both, 0.0) == {"base": None, "head": None}
    assert both.too_long == "the recording has its own times"


def test_work_is_played_with_both_graphs_on_one_core_and_on_another_in_the_next_start() -> None:
    both = both_sides(turns=("work_turns",))
    cores = []
    for start in range(1, 2 * len(CORES) + 1):
        both._start = start
        played = asked_turns(both, 20.0, "work_turns")
        assert played["base"].core == played["head"].core
        cores.append(played["head"].core)
    assert set(cores[: len(CORES)]) == set(cores[len(CORES) :]) == set(CORES)
    assert asked_turns(both_sides(), 20.0)["head"].core is None


def test_only_what_requirements_ask_for_is_played_by_turns() -> None:
    both = both_sides(turns=("work_turns",))
    assert asked_turns(both, 20.0, "turns") == {"base": None, "head": None}
    assert not both.too_long
    assert asked_turns(both, 20.0, "work_turns")["base"] is not None
