"""Tests that are larger where ``R2BSPEC_NIGHTLY=1`` is set."""

from __future__ import annotations

import os

import pytest


def size(sample: int, whole: int) -> int:
    """How many: a sample, or the whole where R2BSPEC_NIGHTLY=1 is set."""
    return whole if os.environ.get("R2BSPEC_NIGHTLY") == "1" else sample


def only_nightly() -> pytest.MarkDecorator:
    """The mark of what repeats at length what a sample already shows."""
    return pytest.mark.skipif(size(0, 1) == 0, reason="only with R2BSPEC_NIGHTLY=1")
