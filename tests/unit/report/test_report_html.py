"""The HTML page as a file: complete, self-contained, escaped, and in need of no style or script."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from html_elements import Page
from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.judge.measure.units import show
from r2bspec.report.html.page import render
from report_runs import SIMULATIONS
from run_simulation import Played, Simulation, objective


def at(result: Any, path: str) -> Any:
    for part in path.split("/"):
        key = part.replace("~1", "/").replace("~0", "~")
        result = result[int(part)] if isinstance(result, list | tuple) else result[key]
    return result


@pytest.mark.parametrize("simulation", SIMULATIONS)
def test_its_numbers_are_those_of_the_result(
    simulation: str, reported: Callable[[str], ReportInput], html_page: Callable[[str], bytes]
) -> None:
    result = reported(simulation).result
    plain = msgspec.to_builtins(result)
    page = Page(html_page(simulation))
    for path, value, shown in page.data:
        if "\N{REPLACEMENT CHARACTER}" in path:
            continue  # a control character, which no page can hold
        assert float(value) == float(at(plain, path))
        assert shown in {
            show(float(value), unit) for unit in ("s", "Hz", "share", "B", "count", "")
        }
    if result.metrics.rates:
        assert len(page.data) > 20


@pytest.mark.parametrize("simulation", SIMULATIONS)
def test_it_needs_nothing_from_anywhere_and_loses_nothing_to_a_policy_against_inline_styles(
    simulation: str, html_page: Callable[[str], bytes]
) -> None:
    page = Page(html_page(simulation))
    for tag, attributes in page.elements:
        assert tag not in {"link", "img", "iframe", "object", "embed", "base"}
        for key in ("src", "href", "xlink:href", "action", "srcset"):
            assert attributes.get(key, "#").startswith("#"), (tag, attributes)
    assert len(page.of("script")) == 1
    assert len(page.of("style")) == 1
    assert not [element for element in page.elements if "style" in element[1]]
    assert not [
        element for element in page.elements if any(key.startswith("on") for key in element[1])
    ]
    # Colours are attributes, too: without them every shape would be black.
    for attributes in page.of("path"):
        assert "fill" in attributes or "stroke" in attributes or "id" in attributes


def test_every_identity_is_there_once(html_page: Callable[[str], bytes]) -> None:
    page = Page(html_page("usual"))
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    for _, attributes in page.elements:
        for key, value in attributes.items():
            for found in re.findall(r"url\(#([^)]+)\)", value):
                assert found in ids
            if key in {"aria-labelledby", "aria-describedby"} or (key == "href" and value != "#"):
                assert value.lstrip("#") in ids


def test_a_screen_reader_is_told_everything(html_page: Callable[[str], bytes]) -> None:
    page = Page(html_page("usual"))
    for attributes in page.of("svg"):
        assert attributes["role"] == "img"
        assert {"aria-labelledby", "aria-describedby"} <= attributes.keys()
    assert len(page.of("caption")) == len(page.of("table"))
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch(r"h\d", tag)]
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    assert all(attributes.get("scope") in {"col", "row"} for attributes in page.of("th"))
    assert page.of("html")[0]["lang"] == "en"


def test_hostile_words_stay_words(html_page: Callable[[str], bytes]) -> None:
    content = html_page("hostile")
    page = Page(content)
    assert len(page.of("script")) == 1
    assert not page.of("img")
    assert "<script>alert(1)</script>" in page.text
    assert b"\x00" not in content
    assert b"\x1b" not in content


def test_the_verdict_and_its_reasons_come_first(html_page: Callable[[str], bytes]) -> None:
    page = Page(html_page("usual"))
    table = page.text.index("requirement")
    assert page.text.index("✘ FAIL") < table
    assert table < page.text.index("drop_rate <= 1 %") < page.text.index("✔ PASS", table)
    assert page.text.index("got no output") < page.text.index("The graph")


def test_a_long_run_makes_a_page_of_sane_size_that_says_what_it_left_out(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    simulation = Simulation(
        segments=[
            Played(rate, np.where(rng.random(20_000) < 0.02, np.nan, rng.gamma(4, 0.002, 20_000)))
            for rate in (50, 200)
            for _ in range(3)
        ],
        objectives={"a": objective("latency.p99 < 60 ms", at="50 Hz")},
    )
    run = simulation.write(tmp_path / "run")
    content = render(ReportInput(result=result_of(run), run=run))
    assert len(content) < 2_000_000
    assert "only the fastest and the slowest of each interval are drawn" in " ".join(
        Page(content).text.split()
    )


def test_without_samples_it_says_which_charts_are_missing(
    reported: Callable[[str], ReportInput],
) -> None:
    page = Page(render(ReportInput(result=reported("usual").result)))
    assert "the charts of single messages need the run folder" in page.text
    charts = [one for one in page.of("svg") if one.get("class") != "budget"]
    assert [chart.get("id") for chart in charts] == ["offered"]
