"""The page of a search: complete, self-contained, and harmless whatever a result says."""

from __future__ import annotations

import base64
import hashlib
import math
import re
from collections.abc import Callable

import pytest

import tuning_results
from html_elements import Page
from r2bspec.tune.tuning_page import to_html
from r2bspec.tune.tuning_result import TuningResult
from tuning_results import deployment, gain, improved, not_met, trial

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")

EVERY = pytest.mark.parametrize(
    "made", [tuning_results.improved, tuning_results.not_met, tuning_results.hostile]
)


@EVERY
def test_a_page_loads_nothing_and_runs_nothing(made: Callable[[], TuningResult]) -> None:
    content = to_html(made())
    page = Page(content)
    assert not page.of("script")
    assert not page.of("link")
    for _, attributes in page.elements:
        assert not any(name.startswith("on") or name in {"style", "src"} for name in attributes)
        assert attributes.get("href", "#").startswith("#")
    assert "\x1b" not in content.decode()
    (policy,) = [each["content"] for each in page.of("meta") if "http-equiv" in each]
    style = re.findall(r"<style>(.*?)</style>", content.decode(), re.DOTALL)
    assert len(style) == 1
    digest = base64.b64encode(hashlib.sha256(style[0].encode()).digest()).decode()
    assert policy == f"default-src 'none'; style-src 'sha256-{digest}'"


def test_the_page_has_the_figures_and_every_trial() -> None:
    result = improved()
    page = Page(to_html(result))
    assert [each["class"] for each in page.of("svg")] == ["chart", "chart"]
    assert result.reason in page.text
    assert "The search saw 84 %" in page.text
    assert "4, proposed" in page.text
    assert "today" in page.text
    rows = re.findall(r"<tr class=\"\w*\">", to_html(result).decode())
    assert len(rows) == len(result.trials)
    assert to_html(result) == to_html(result)


@pytest.mark.parametrize(
    ("unit", "said"), [("share", ", %"), ("s", ", ms"), ("B", ", MiB"), ("Hz", ", Hz")]
)
def test_the_cost_is_drawn_in_its_unit(unit: str, said: str) -> None:
    page = Page(to_html(improved(goal_unit=unit)))
    assert f"{improved().goal}{said}" in page.text


def test_numbers_without_an_end_are_drawn() -> None:
    far = (
        trial(0, deployment(), 1.0, -math.inf),
        trial(1, deployment(threads=1), 2.0, math.inf),
        trial(2, deployment(threads=2), 2.0, 0.0, state="invalid"),
    )
    gains = (gain("a", 1e9), gain("b", None), gain("c", 1.0, upper=math.inf, lower=None))
    page = Page(to_html(improved(trials=far, levers=gains)))
    assert "What is beyond 400 % is drawn there." in page.text
    assert "1 without a measurement are in the table only." in page.text


def test_a_page_without_any_measurement() -> None:
    result = not_met(trials=(trial(0, deployment(), None, 0.0, state="broken", margins=()),))
    page = Page(to_html(result))
    assert not page.of("svg")
    assert "! broken" in page.text.replace("\u00a0", " ")
