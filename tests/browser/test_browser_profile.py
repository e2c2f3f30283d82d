"""The flame graph of the HTML report in a real browser."""

from __future__ import annotations

from pathlib import Path

import pytest
from chromium import Chromium, needs_chromium
from chromium import browser as browser

from profiled_runs import MISSING, WHOLE, profiled_run
from r2bspec.record.run_folder import Stacks, write_stacks
from r2bspec.report.html.page import render
from report_runs import HOSTILE

pytestmark = needs_chromium

CUT = """(() => {
  const room = (text) => text.parentElement.querySelector("rect").getBoundingClientRect();
  return [...document.querySelectorAll("svg#profile-0 text")]
    .filter((text) => text.getBoundingClientRect().right > room(text).right + 1)
    .map((text) => text.textContent);
})()"""

STACKS: Stacks = {
    ("relay", HOSTILE): 50,
    **{
        ("relay", "main", f"caller number {number % 7} of the node", f"called {number}"): number
        for number in range(1, 60)
    },
}


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("profile")
    run = profiled_run(folder, WHOLE, MISSING)
    write_stacks(folder / WHOLE.stacks, STACKS)
    page = folder / "page.html"
    page.write_bytes(render(run))
    return page


@pytest.mark.parametrize("width", [1100, 390])
def test_it_is_drawn_within_the_page(browser: Chromium, page_file: Path, width: int) -> None:
    with browser.page(page_file.as_uri(), width=width) as page:
        assert page.console() == []
        assert page.evaluate("document.querySelectorAll('svg#profile-0 rect').length") > 50
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        assert page.evaluate("document.querySelectorAll('img, body script').length") == 1


def test_names_stay_in_their_boxes_and_are_whole_where_the_pointer_is(
    browser: Chromium, page_file: Path
) -> None:
    with browser.page(page_file.as_uri()) as page:
        assert page.evaluate(CUT) == []
        titles = page.evaluate(
            "[...document.querySelectorAll('svg#profile-0 g > title')].map((e) => e.textContent)"
        )
        assert any(title.startswith("caller number 3 of the node: ") for title in titles)
