"""The time budget: what is optional is left out where it would not fit."""

from __future__ import annotations

from r2bspec.execute.run_context import TimeBudget

HOUR_NS = 3600 * 10**9


def test_no_budget_allows_everything() -> None:
    notes: list[str] = []
    budget = TimeBudget(0, notes.append)
    budget.begin()
    assert budget.allows("no confirmation run", 1e9)
    assert (notes, budget.left_out) == ([], [])


def test_what_fits_is_played_and_what_does_not_is_told() -> None:
    notes: list[str] = []
    budget = TimeBudget(HOUR_NS, notes.append)
    budget.begin()
    assert budget.allows("no more iterations", 60.0)
    assert not budget.allows("no confirmation run", 3601.0)
    assert notes == ["no confirmation run: it would exceed the time budget of 3600 s"]
    assert budget.left_out == ["No confirmation run: it would exceed the time budget of 3600 s."]


def test_time_before_it_begins_does_not_count() -> None:
    budget = TimeBudget(HOUR_NS, lambda _: None)
    assert budget.spent_s() == 0.0
    assert budget.allows("no confirmation run", 3600.0)
    budget.begin()
    assert budget.spent_s() >= 0.0
