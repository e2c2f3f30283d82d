"""What a terminal shows at the end of a run, as plain text."""

from __future__ import annotations

from r2bspec.compare.report_input import Reported
from r2bspec.report.terminal import to_text


def render(reported: Reported) -> bytes:
    """The terminal report without colours, 100 columns wide."""
    return to_text(reported.result).encode()
