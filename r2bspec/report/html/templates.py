"""The templates of pages and drawings, and the files that are written into them as they are."""

from __future__ import annotations

import base64
import hashlib
import importlib.resources
import re
from functools import cache
from typing import TYPE_CHECKING, Any

from r2bspec.diagnostics.quote import clip
from r2bspec.judge.measure.distribution import part_title
from r2bspec.judge.measure.units import at_rate, show, show_rate
from r2bspec.report import report_wording
from r2bspec.report.html.chart import PALETTE
from r2bspec.report.result_table import pointer

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

_CONTROL_CHARACTERS = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


def render_template(name: str, context: dict[str, Any]) -> bytes:
    """A page, UTF-8; see `render_text`."""
    return render_text(name, context).encode("utf-8", errors="replace") + b"\n"


def render_text(name: str, context: dict[str, Any]) -> str:
    """A page, or a drawing as a part of one. The same context gives the same text.

    Args:
        name: of a file in the folder of this module.
        context: the names that the template uses; every text is escaped.
    """
    page = _environment().get_template(name).render(context)
    # HTML cannot contain control characters and the lone surrogates of broken file names.
    return _CONTROL_CHARACTERS.sub("\N{REPLACEMENT CHARACTER}", page)


@cache
def _environment() -> Environment:
    import jinja2

    files = importlib.resources.files(__package__)
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: files.joinpath(name).read_text("utf-8")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"pointer": pointer, "clip": clip}
    environment.globals |= {
        "palette": PALETTE,
        "wording": report_wording,
        **{function.__name__: function for function in (at_rate, part_title, show, show_rate)},
    }
    return environment


def own_style(extra: str = "") -> dict[str, str]:
    """What a page needs of styles: the stylesheet, and the hash that allows it without scripts.

    A browser then loads nothing for the page and runs no script, by its policy (Content Security
    Policy): that has the hash of the style that is in the page, and nothing else.
    """
    colours = "".join(
        f".f-{name}{{fill:var(--{name})}}.k-{name}{{stroke:var(--{name})}}\n" for name in PALETTE
    )
    style = own_text("style.css") + extra + colours
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    return {"style": style, "style_hash": f"sha256-{digest}"}


def own_text(name: str) -> Markup:
    """A file in the folder of this module, which a template contains without escapes."""
    from markupsafe import Markup

    files = importlib.resources.files(__package__)
    return Markup(files.joinpath(name).read_text("utf-8"))  # noqa: S704 - our file
