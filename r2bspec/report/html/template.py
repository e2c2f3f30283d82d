"""The templates of pages and drawings, and the colours that drawings may use."""

from __future__ import annotations

import importlib.resources
from functools import cache
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from jinja2 import Environment

PALETTE: Final = {
    "ink": "#1b2330",
    "quiet": "#566070",
    "grid": "#dde3ea",
    "paper": "#ffffff",
    "band": "#eef2f6",
    "bad": "#b3261e",
    "good": "#1b7a3d",
    "unsure": "#8a5a00",
    "s0": "#0b62a8",
    "s1": "#b35500",
    "s2": "#00707a",
    "s3": "#7a3e9d",
    "s4": "#8c6d00",
    "s5": "#a8326b",
}
"""Every colour that a drawing may use, by its name in the stylesheet.

A drawing has each as an attribute and as a class: nothing is lost where a policy forbids styles,
and a stylesheet changes them where it may, as for a dark page.
"""


def fill(template: str, **context: object) -> str:
    """Return a filled template of this folder; every text in it is escaped."""
    return _environment().get_template(template).render(context, palette=PALETTE)


@cache
def _environment() -> Environment:
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(own_text),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "kind": lambda block: type(block).__name__,
        "exact": repr,
        # Filled before, by a template: every text in it is escaped.
        "drawn": Markup,
    }
    return environment


def own_text(name: str) -> str:
    """Return a file in the folder of this module."""
    return importlib.resources.files(__package__).joinpath(name).read_text("utf-8")
