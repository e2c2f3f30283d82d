"""The drawing of a plan as a page of its own: one file, without scripts."""

from __future__ import annotations

import base64
import hashlib

from r2bspec.plan.plan import Plan
from r2bspec.plan.time_estimate import estimate_time
from r2bspec.report.html.chart import PALETTE
from r2bspec.report.html.graph_drawing import lay_out
from r2bspec.report.html.page import own_text, render_template

_WIDE = "header,main{max-width:none}\n"
"""The drawing has the whole width of the window, or of the panel of an editor."""


def render_graph(plan: Plan) -> bytes:
    """The page, UTF-8. The same plan gives the same bytes.

    A browser loads nothing for it and runs no script: its policy (Content Security Policy) allows
    the style that is in the page, by its hash, and nothing else.
    """
    style = own_text("style.css") + _WIDE + _colours()
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    context = {
        "name": plan.name,
        "title": plan.title or plan.name,
        "time": estimate_time(plan).text(),
        "graph": lay_out(plan, {}),
        "palette": PALETTE,
        "style": style,
        "style_hash": f"sha256-{digest}",
    }
    return render_template("graph_page.html.j2", context)


def _colours() -> str:
    return "".join(
        f".f-{name}{{fill:var(--{name})}}.k-{name}{{stroke:var(--{name})}}\n" for name in PALETTE
    )
