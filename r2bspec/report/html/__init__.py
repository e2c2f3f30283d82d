"""One self-contained HTML page: no network, and nothing lost without scripts or styles.

Numbers stand in tables; drawings are inline SVG with presentation attributes; a stylesheet and a
script, both inside the page, add looks, dark mode, zoom and hover where a policy lets them.
"""

from __future__ import annotations

from r2bspec.report.html.page import render

__all__ = ["render"]
