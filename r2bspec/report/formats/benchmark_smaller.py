"""Input of github-action-benchmark's tool ``customSmallerIsBetter``."""

from __future__ import annotations

from r2bspec.compare.report_input import Reported
from r2bspec.report.action_benchmark import to_json


def render(reported: Reported) -> bytes:
    """The list; see `r2bspec.report.action_benchmark`."""
    return to_json(reported, bigger=False)
