"""Numbers on the page with their location in ``result.json``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from r2bspec.measure.units import show

if TYPE_CHECKING:
    from markupsafe import Markup


class Numbers:
    """Writes a value of the result as ``<data value="0.0123" data-path="…">12.3 ms</data>``.

    The exact value is in the markup of the rounded text, so that a program, or a test, can read the
    page and compare it with the file.
    """

    def __init__(self, result: Any) -> None:
        self._result = result

    def __call__(self, path: str, unit: str) -> Markup:
        """The value at a path, a JSON pointer without its first slash; or a dash.

        Raises:
            KeyError: the result has no such place.
        """
        from markupsafe import Markup

        value = self._result
        for part in path.split("/"):
            value = value[int(part)] if isinstance(value, list | tuple) else value[_unescaped(part)]
        if value is None:
            return Markup("-")
        return Markup('<data value="{}" data-path="{}">{}</data>').format(
            repr(value), path, show(float(value), unit)
        )


def pointer(key: str) -> str:
    """A key as a part of a JSON pointer (RFC 6901)."""
    return key.replace("~", "~0").replace("/", "~1")


def _unescaped(part: str) -> str:
    return part.replace("~1", "/").replace("~0", "~")
