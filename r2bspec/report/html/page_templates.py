"""The templates of pages, and the files that are written into them as they are."""

from __future__ import annotations

import importlib.resources
import re
from typing import TYPE_CHECKING, Any

from r2bspec.report.html.number_links import pointer

if TYPE_CHECKING:
    from markupsafe import Markup

_CONTROL_CHARACTERS = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


def render_template(name: str, context: dict[str, Any]) -> bytes:
    """A page, UTF-8. The same context gives the same bytes.

    Args:
        name: of a file in the folder of this module.
        context: the names that the template uses; every text is escaped.
    """
    import jinja2

    files = importlib.resources.files("r2bspec.report.html")
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda each: files.joinpath(each).read_text("utf-8")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["pointer"] = pointer
    page = environment.get_template(name).render(context)
    # HTML cannot contain control characters and the lone surrogates of broken file names.
    text = _CONTROL_CHARACTERS.sub("\N{REPLACEMENT CHARACTER}", page)
    return text.encode("utf-8", errors="replace") + b"\n"


def own_text(name: str) -> Markup:
    """A file in the folder of this module, which a template contains without escapes."""
    from markupsafe import Markup

    files = importlib.resources.files("r2bspec.report.html")
    return Markup(files.joinpath(name).read_text("utf-8"))  # noqa: S704 - our file
