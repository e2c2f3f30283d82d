"""The page of `r2bspec plan --graph html` in a real browser, under its own policy."""

from __future__ import annotations

from pathlib import Path

import pytest
from chromium import Chromium, needs_chromium
from chromium import browser as browser

from r2bspec.cli.main import main

pytestmark = needs_chromium
RELAY = Path(__file__).parents[2] / "specs" / "relay.r2b.yaml"


@pytest.mark.parametrize("dark", [False, True])
def test_the_policy_blocks_nothing_of_the_page(
    browser: Chromium, tmp_path: Path, dark: bool
) -> None:
    file = tmp_path / "graph.html"
    assert main(["plan", str(RELAY), "--graph", "html", "-o", str(file)]) == 0
    with browser.page(file.as_uri(), dark=dark) as page:
        assert page.console() == []
        assert page.requests() == [file.as_uri()]
        # The colours of boxes are in the style, in a light and in a dark one.
        paper = page.evaluate("getComputedStyle(document.querySelector('svg .f-paper')).fill")
        assert paper == ("rgb(26, 32, 41)" if dark else "rgb(255, 255, 255)")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
