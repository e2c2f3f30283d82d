"""Drawings of the plotting library as inline SVG that needs no styles and no scripts.

The library writes ``style`` attributes, which a strict content security policy blocks, and ids that
repeat from one drawing to the next. Here every style becomes presentation attributes, every id gets
the drawing's own prefix, and every colour of the palette also becomes a class, so that a stylesheet
can change it where one is allowed (dark mode).
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Final

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
"""Every colour that a drawing may use, by its name in the stylesheet."""

SERIES: Final = tuple(PALETTE[f"s{number}"] for number in range(6))

_CLASSES = {colour: name for name, colour in PALETTE.items()}
_NUMBER = re.compile(r"-?\d+\.\d+")
_URL_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_FONT = re.compile(r"(?:(?P<weight>bold|\d{3}) )?(?P<size>[\d.]+px) (?P<family>.*)")
_ZERO_ROTATION = re.compile(r"rotate\(-?0(?:\.0*)?[ )]")


def inline(
    svg: str, name: str, title: str, description: str, data: Mapping[str, str], labels: list[str]
) -> str:
    """An SVG document as an element of an HTML page.

    Args:
        svg: from the library.
        name: letters, digits and ``-``; unique in the page, put before every id.
        title: of the drawing, for screen readers.
        description: what it shows, likewise.
        data: further attributes of the root, such as ``data-axes``.
        labels: of the series, whose groups have the ids ``series-0``, ``series-1``, ...
    """
    root = ET.fromstring(svg)  # noqa: S314 - written by the plotting library a moment ago
    used: set[str] = set()
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        _plain_attributes(element, name, used)
    _drop(root, {"style", "metadata"})
    _name_series(root, labels)
    for element in root.iter():
        identity = element.get("id")
        if identity is not None:
            if identity in used:
                element.set("id", f"{name}-{identity}")
            else:
                del element.attrib["id"]
    _set_root(root, name, title, description, data)
    return ET.tostring(root, encoding="unicode")


def _plain_attributes(element: ET.Element, name: str, used: set[str]) -> None:
    style = element.attrib.pop("style", "")
    for declaration in style.split(";"):
        key, _, value = declaration.partition(":")
        _declare(element, key.strip(), value.strip())
    for key in [*element.attrib]:
        value = element.attrib[key]
        if key.endswith("}href"):
            del element.attrib[key]
            key = "href"
        if key == "href" and value.startswith("#"):
            used.add(value[1:])
            value = f"#{name}-{value[1:]}"
        elif "url(#" in value:
            used.update(_URL_REFERENCE.findall(value))
            value = _URL_REFERENCE.sub(rf"url(#{name}-\1)", value)
        elif key in {"d", "x", "y", "transform", "points"}:
            if key == "transform" and _ZERO_ROTATION.match(value):
                del element.attrib[key]
                continue
            value = _round_coordinates(value)
        element.set(key, value)
    for key, prefix in (("fill", "f"), ("stroke", "k")):
        known = _CLASSES.get(element.get(key, ""))
        if known is not None:
            before = element.get("class")
            element.set("class", f"{before} {prefix}-{known}" if before else f"{prefix}-{known}")


def _declare(element: ET.Element, key: str, value: str) -> None:
    """One CSS declaration as a presentation attribute; fonts are the page's own."""
    if not key or key in {"font-family", "font-stretch"}:
        return
    if key == "font":
        found = _FONT.fullmatch(value)
        if found is not None:
            element.set("font-size", found["size"])
            if found["weight"]:
                element.set("font-weight", found["weight"])
        return
    element.set(key, value)


def _round_coordinates(value: str) -> str:
    """Coordinates to a tenth of a point, on one line."""
    short = _NUMBER.sub(lambda found: f"{float(found[0]):.1f}".removesuffix(".0"), value)
    return " ".join(short.split())


def _drop(element: ET.Element, tags: set[str]) -> None:
    for child in [*element]:
        if child.tag in tags:
            element.remove(child)
        else:
            _drop(child, tags)


def _name_series(root: ET.Element, labels: list[str]) -> None:
    """Groups of series get their labels, for the script."""
    for element in root.iter("g"):
        kind, _, number = element.get("id", "").partition("-")
        if kind == "series" and number.isdecimal():
            element.set("data-label", labels[int(number)])


def _set_root(
    root: ET.Element, name: str, title: str, description: str, data: Mapping[str, str]
) -> None:
    _, _, width, height = root.get("viewBox", "0 0 0 0").split()
    for key in ("version", "xmlns"):
        root.attrib.pop(key, None)
    root.set("id", name)
    # Points to CSS pixels; a stylesheet may fit it to the column.
    root.set("width", f"{float(width) * 4 / 3:.0f}")
    root.set("height", f"{float(height) * 4 / 3:.0f}")
    root.set("font-family", "system-ui, 'DejaVu Sans', sans-serif")
    root.set("stroke-linejoin", "round")
    root.set("class", "chart")
    root.set("role", "img")
    root.set("aria-labelledby", f"{name}-title")
    root.set("aria-describedby", f"{name}-desc")
    for key, value in data.items():
        root.set(key, value)
    desc = ET.Element("desc", {"id": f"{name}-desc"})
    desc.text = description
    root.insert(0, desc)
    heading = ET.Element("title", {"id": f"{name}-title"})
    heading.text = title
    root.insert(0, heading)
