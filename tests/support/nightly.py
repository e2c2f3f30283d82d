"""How large a test is: a sample by default, the whole with ``R2BSPEC_NIGHTLY=1``."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TypeVar

import pytest

Case = TypeVar("Case")

NIGHTLY = os.environ.get("R2BSPEC_NIGHTLY", "") not in {"", "0"}


def size(sample: int, whole: int) -> int:
    """The number of simulated runs, or of whatever else a test repeats.

    Args:
        sample: as many as take seconds.
        whole: with which the stated errors are known to a fraction of themselves.
    """
    return whole if NIGHTLY else sample


def sampled(cases: Iterable[Case], every: int, first: int = 0) -> list[Case]:
    """From the first on one of every so many cases; with ``R2BSPEC_NIGHTLY=1`` each of them."""
    return [*cases] if NIGHTLY else [*cases][first::every]


def only_nightly() -> pytest.MarkDecorator:
    """The mark of a test that repeats at length what a sample already shows."""
    return pytest.mark.skipif(not NIGHTLY, reason="only with R2BSPEC_NIGHTLY=1 (make nightly)")


def noise(share: float) -> float:
    """What a small sample may add to a share by chance; nothing in the whole simulation."""
    return 0.0 if NIGHTLY else share
