"""Input of github-action-benchmark's tool ``customBiggerIsBetter``."""

from __future__ import annotations

from r2bspec.report.action_benchmark import to_json
from r2bspec.report.reported import Reported


def render(reported: Reported) -> bytes:
    """The list; see `r2bspec.report.action_benchmark`."""
    return to_json(reported, bigger=True)
