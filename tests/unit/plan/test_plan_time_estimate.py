"""How long a run is expected to take."""

from __future__ import annotations

import msgspec
import pytest
from plan_specs import plan

from r2bspec.plan.plan import GatePlan, PlayPlan, SearchPlan
from r2bspec.plan.time_estimate import estimate_time, time_text


def plays(rates: int, iterations: int, seconds: float, most: int = 0) -> tuple[PlayPlan, ...]:
    return tuple(
        PlayPlan(
            rate_hz=10.0 * number,
            duration_ns=int(seconds * 1e9),
            iterations=iterations,
            max_iterations=most,
        )
        for number in range(1, rates + 1)
    )


def test_what_is_declared_is_counted() -> None:
    base = msgspec.structs.replace(plan(), play=(), search=None, gate=GatePlan(confirm=False))
    without = estimate_time(base)
    declared = estimate_time(msgspec.structs.replace(base, play=plays(2, 5, 10)))
    assert 100 <= declared.seconds - without.seconds <= 110
    assert declared.at_most_s == declared.seconds
    more = estimate_time(msgspec.structs.replace(base, play=plays(2, 5, 10, most=20)))
    assert more.seconds == declared.seconds
    assert more.at_most_s - more.seconds == pytest.approx(300, abs=10)


def test_a_confirmation_and_a_budget_bound_the_longest_time() -> None:
    base = msgspec.structs.replace(plan(), play=plays(1, 10, 10), search=None)
    once = estimate_time(msgspec.structs.replace(base, gate=GatePlan(confirm=False)))
    twice = estimate_time(msgspec.structs.replace(base, gate=GatePlan(confirm=True)))
    assert twice.seconds == once.seconds
    assert twice.at_most_s > once.at_most_s + 100
    budget = GatePlan(confirm=True, time_budget_ns=130_000_000_000)
    limited = estimate_time(msgspec.structs.replace(base, gate=budget))
    assert once.at_most_s < limited.at_most_s < twice.at_most_s


def test_every_start_takes_time() -> None:
    base = msgspec.structs.replace(plan(), play=plays(1, 10, 2), search=None)
    one, five = (estimate_time(msgspec.structs.replace(base, starts=starts)) for starts in (1, 5))
    later_s = (five.seconds - one.seconds) / 4
    assert later_s > base.warm_up_ns / 1e9
    assert later_s < one.seconds - one.phases["play"]
    assert five.at_most_s - one.at_most_s == pytest.approx(2 * 4 * later_s)


def test_a_search_takes_its_probes_and_its_whole_plays_at_most() -> None:
    base = msgspec.structs.replace(plan(), play=(), sustained_hz=(), gate=GatePlan(confirm=False))
    without = estimate_time(msgspec.structs.replace(base, search=None))

    def added(probe_s: int, confirm_s: int) -> tuple[float, float]:
        search = SearchPlan(
            min_hz=10,
            max_hz=100,
            precision=0.02,
            probe_ns=probe_s * 10**9,
            holds=(),
            confirm_ns=confirm_s * 10**9,
        )
        found = estimate_time(msgspec.structs.replace(base, search=search))
        return found.seconds - without.seconds, found.at_most_s - without.at_most_s

    assert added(10, 30) == pytest.approx((105, 210))
    assert added(10, 0) == pytest.approx((60, 120))
    assert added(5, 10) == pytest.approx((45, 90))


def test_a_rate_that_must_be_sustained_is_played_whole() -> None:
    base = msgspec.structs.replace(plan(), search=None, sustained_hz=())
    asked = msgspec.structs.replace(base, sustained_hz=(10.0, 20.0))
    assert estimate_time(asked).seconds - estimate_time(base).seconds == pytest.approx(20)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "1 s"), (8.1, "9 s"), (41, "45 s"), (89, "90 s"), (91, "2 min"), (4800, "1 h 20 min")],
)
def test_times_are_written_for_people(seconds: float, text: str) -> None:
    assert time_text(seconds) == text
