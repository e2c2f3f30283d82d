"""Drawings of the HTML report and of ``plan --graph html``: arrows, labels, legends, one page."""

from __future__ import annotations

import base64
import hashlib
import itertools
import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from command_line import Call
from html_elements import Page
from r2bspec import api
from r2bspec.report.html.graph_drawing import PlacedBox, Rectangle, lay_out

# Drawings of the HTML report: arrows around boxes, labels inside axes, legends without doubles.


SPECS = sorted((Path(__file__).parents[3] / "specs").rglob("*.r2b.yaml"))


def points(path: str) -> Iterator[tuple[float, float]]:
    """Points along an SVG path of M, L and C."""
    at = (0.0, 0.0)
    for command, text in re.findall(r"([MLC])([^MLC]*)", path):
        numbers = [float(each) for each in text.split()]
        pairs = list(zip(numbers[::2], numbers[1::2], strict=True))
        if command != "M":
            corners = [at, *pairs]
            for number in range(26):
                t = number / 25
                line = corners
                while len(line) > 1:  # de Casteljau
                    line = [
                        (x0 + (x1 - x0) * t, y0 + (y1 - y0) * t)
                        for (x0, y0), (x1, y1) in itertools.pairwise(line)
                    ]
                yield line[0]
        at = pairs[-1]


def is_inside(box: PlacedBox | Rectangle, x: float, y: float) -> bool:
    """Whether a point is inside a box, and not on its border."""
    return box.x + 1 < x < box.x + box.width - 1 and box.y + 1 < y < box.y + box.height - 1


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: f"{spec.parent.name}-{spec.name}")
def test_no_arrow_passes_through_a_box(spec: Path) -> None:
    plan = api.compile_plan(spec)
    for width in (math.inf, 990.0, 500.0):
        drawing = lay_out(plan, {}, width)
        assert drawing.edges
        widest = max(box.width for box in drawing.boxes)
        assert drawing.width <= max(width, widest + 2 * min(box.x for box in drawing.boxes) + 2)
        for edge in drawing.edges:
            way = list(points(edge.path))
            crossed = {box.title for box in drawing.boxes for at in way if is_inside(box, *at)}
            assert crossed == set(), edge.path
            assert all(0 <= x <= drawing.width and 0 <= y <= drawing.height for x, y in way)


# ``r2bspec plan --graph html``: the drawing as one page that loads and runs nothing.


RELAY = Path(__file__).parents[3] / "specs" / "relay.r2b.yaml"
_LOADING = {"script", "img", "link", "iframe", "object", "embed", "video", "audio", "base"}


def test_the_page_shows_the_plan_and_its_policy_allows_its_style_and_nothing_else(
    call: Call,
) -> None:
    text = call("plan", RELAY, "--graph", "html", status=0).out
    page = Page(text.encode())
    style = re.search(r"<style>(.*)</style>", text, re.DOTALL)
    assert style is not None
    digest = base64.b64encode(hashlib.sha256(style[1].encode()).digest()).decode()
    (policy,) = (each["content"] for each in page.of("meta") if "http-equiv" in each)
    assert policy == f"default-src 'none'; style-src 'sha256-{digest}'"
    for tag, attributes in page.elements:
        assert tag not in _LOADING
        assert not attributes.keys() & {"src", "href", "style", "srcset"}
        assert not any(name.startswith("on") for name in attributes)
    assert {"/r2b/relay", "/r2b/relayed", "player"} <= set(page.text.split())
    assert "A relay that takes 10 ms for each message" in page.text
    assert "A run takes about " in page.text


def test_names_of_the_spec_are_text(tmp_path: Path, call: Call) -> None:
    spec = tmp_path / "hostile.r2b.yaml"
    title = "title: '</title><script>alert(1)</script>'"
    spec.write_text(re.sub("title: .*", title, RELAY.read_text("utf-8"), count=1), "utf-8")
    page = Page(call("plan", spec, "--graph", "html", status=0).out.encode())
    assert not page.of("script")
    assert "</title><script>alert(1)</script>" in page.text
