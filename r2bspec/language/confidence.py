"""The confidence of every decision, where a spec states no other."""

from __future__ import annotations

from typing import Final

CONFIDENCE: Final = 0.95
"""One-sided each way: PASS and FAIL are each wrong in at most 5 % of runs."""

CONFIRMATION_CONFIDENCE: Final = 0.9
"""The confidence at which a second run confirms a failure (`r2bspec.judge.confirmation`)."""
