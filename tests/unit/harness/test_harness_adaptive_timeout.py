"""Waiting in vain is done once in full, and then ever shorter."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from r2bspec.harness.loader import AdaptiveTimeout

SECOND = 1_000_000_000


def test_the_first_wait_lasts_the_full_patience() -> None:
    patience = AdaptiveTimeout(5 * SECOND)
    assert patience.limit_ns == patience.final_ns == 5 * SECOND
    patience.answered(SECOND)
    assert patience.limit_ns == 5 * SECOND


def test_a_thousand_messages_that_nobody_answers_cost_little_more_than_one() -> None:
    patience = AdaptiveTimeout(5 * SECOND)
    waited_ns = 0
    for _ in range(1000 // 4):
        waited_ns += patience.limit_ns
        patience.expired()
    assert waited_ns < 4 * 5 * SECOND


def test_the_end_is_waited_for_longer_than_what_comes_between() -> None:
    patience = AdaptiveTimeout(5 * SECOND)
    for _ in range(20):
        patience.expired()
    assert patience.limit_ns < SECOND // 10
    assert patience.final_ns >= SECOND // 2
