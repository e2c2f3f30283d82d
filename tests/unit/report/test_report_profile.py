"""A profile is named in every report, and the page draws its stacks."""

from __future__ import annotations

import importlib.resources
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from profiled_runs import MISSING, WHOLE, profiled_run
from r2bspec.compare.report_input import ReportInput
from r2bspec.record.run_folder import Stacks, write_stacks
from r2bspec.report.format_registry import renderer
from r2bspec.report.html.chart import PALETTE
from r2bspec.report.html.flame_graph import flame_graph
from report_runs import HOSTILE


def html(report_input: ReportInput) -> str:
    return renderer("html")(report_input).decode()


def test_the_page_draws_the_stacks(tmp_path: Path) -> None:
    found = profiled_run(tmp_path, WHOLE, MISSING)
    assert "<svg" not in html(found).partition('<h2 id="profile">')[2]
    write_stacks(
        tmp_path / WHOLE.stacks, {("relay", "main", "compute_ms"): 3, ("relay", "idle"): 1}
    )
    page = html(found).partition('<h2 id="profile">')[2]
    assert page.count("<svg") == 1
    assert "Where relay spends its CPU time at 30 Hz, seen by perf" in page
    assert "4 samples; most were in compute_ms 75%, idle 25%" in page


def test_a_folder_of_a_stranger_draws_nothing_from_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("secret_words 7\n")
    outside = msgspec.structs.replace(WHOLE, stacks="../secret")
    page = html(profiled_run(tmp_path / "run", outside))
    assert "secret_words" not in page
    assert "../secret is not drawn: it is a link out of its folder" in page


def boxes(svg: str) -> dict[str, tuple[float, float, float]]:
    """Left, top and width of each function, by its name."""
    found = {}
    for group in ET.fromstring(svg).iter("g"):  # noqa: S314 - our own drawing
        rect = group.find("rect")
        assert rect is not None
        name = (group.findtext("title") or "").rpartition(":")[0]
        found[name] = tuple(float(rect.get(key, "")) for key in ("x", "y", "width"))
    return found  # type: ignore[return-value]


def test_a_function_is_as_wide_as_its_share_and_above_its_caller() -> None:
    stacks = {
        ("main", "a", "leaf"): 30,
        ("main", "a"): 20,
        ("main", "b"): 49,
        ("main", "c"): 1,
    }
    chart = flame_graph("profile-0", "Title", stacks)
    assert chart is not None
    found = boxes(chart.svg)
    widths = {name: width for name, (_, _, width) in found.items()}
    whole = widths["main"]
    assert widths["a"] / whole == pytest.approx(0.5, abs=0.01)
    assert widths["leaf"] / whole == pytest.approx(0.3, abs=0.01)
    assert found["leaf"][0] == found["a"][0] == found["main"][0]
    assert found["b"][0] == pytest.approx(found["a"][0] + whole / 2, rel=0.01)
    assert found["leaf"][1] < found["a"][1] < found["main"][1]
    assert found["a"][1] == found["b"][1] == found["c"][1]


def test_common_calls_and_narrow_boxes_are_not_drawn() -> None:
    stacks = {(*(f"f{depth}" for depth in range(30)), "x"): 9_999, ("f0", "rare"): 1}
    drawn = boxes(flame_graph("a", "T", {next(iter(stacks)): 9}).svg)  # type: ignore[union-attr]
    assert [*drawn] == ["f27", "f28", "f29", "x"]
    drawn = boxes(flame_graph("a", "T", stacks).svg)  # type: ignore[union-attr]
    assert "rare" not in drawn
    assert {"all", "f0", "f29", "x"} <= drawn.keys()


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_every_name_can_be_read(dark: bool) -> None:
    colours: dict[str, str] = dict(PALETTE)
    if dark:
        style = importlib.resources.files("r2bspec.report.html").joinpath("style.css").read_text()
        night = style.partition("prefers-color-scheme: dark")[2].partition("}\n}")[0]
        colours |= dict(re.findall(r"--(\w+): (#\w+)", night))
    stacks: Stacks = {("main", f"function {number}"): 1 for number in range(200)}
    chart = flame_graph("a", "T", stacks)
    assert chart is not None
    tints = {
        ((each.get("class") or "").removeprefix("f-"), float(each.get("fill-opacity", "")))
        for each in ET.fromstring(chart.svg).iter("rect")  # noqa: S314 - our own drawing
    }
    assert len(tints) > 15
    ink, paper = (rgb(colours[name]) for name in ("ink", "paper"))
    for name, tint in tints:
        behind = tint * rgb(colours[name]) + (1 - tint) * paper
        dim, bright = sorted((luminance(ink), luminance(behind)))
        assert (bright + 0.05) / (dim + 0.05) > 4.5, (name, tint)


def rgb(colour: str) -> NDArray[np.float64]:
    return np.array([int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)])


def luminance(colour: NDArray[np.float64]) -> float:
    """As WCAG 2 defines it."""
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def test_without_samples_nothing_is_drawn() -> None:
    assert flame_graph("a", "T", {}) is None


def test_deep_recursion_is_drawn_up_to_a_limit() -> None:
    chart = flame_graph("a", "T", {("r",) * 50_000: 2, ("s",): 1})
    assert chart is not None
    assert 50 < len(ET.fromstring(chart.svg).findall("g")) < 100  # noqa: S314 - our own drawing


def test_hostile_names_are_only_text() -> None:
    chart = flame_graph("a", HOSTILE, {("main", HOSTILE): 3, ("main", "\x00\x1b[2J\ud800"): 2})
    assert chart is not None
    assert "<script" not in chart.svg
    tags = {each.tag for each in ET.fromstring(chart.svg).iter()}  # noqa: S314 - our own drawing
    assert tags <= {"svg", "title", "desc", "g", "rect", "text"}
    assert not re.search(r"[\x00-\x08\x1b]", chart.svg)


def test_the_same_stacks_give_the_same_drawing() -> None:
    stacks: Stacks = {("main", f"f{number}"): number for number in range(1, 20)}
    backwards = dict(reversed([*stacks.items()]))
    one, other = (flame_graph("a", "T", each) for each in (stacks, backwards))
    assert one is not None
    assert other is not None
    assert one.svg == other.svg
    assert replace(one, svg="") == replace(other, svg="")
