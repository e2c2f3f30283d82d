"""Sines that are the same on every machine are still sines."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.datasets.cameras import cosine, sine


@given(st.floats(-60, 60))
def test_agree_with_the_c_library(angle: float) -> None:
    assert sine(angle) == pytest.approx(math.sin(angle), abs=2e-14)
    assert cosine(angle) == pytest.approx(math.cos(angle), abs=2e-14)


@given(st.floats(-math.pi, math.pi))
def test_are_exact_within_a_turn(angle: float) -> None:
    assert sine(angle) == pytest.approx(math.sin(angle), abs=1e-15)
