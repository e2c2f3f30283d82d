"""The HTML report in a real browser: with scripts, without, and under Jenkins' policy."""

from __future__ import annotations

import functools
import http.server
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from chromium import Chromium, Page, needs_chromium
from chromium import browser as browser

from histories import commit, noisy, some_result, write_history
from r2bspec.compare.history import read_histories
from r2bspec.compare.report_input import ReportInput
from r2bspec.judge.judge_run import result_of
from r2bspec.report.html.page import render
from r2bspec.report.trend_document import render as render_trend
from report_runs import HOSTILE_RUN, USUAL

pytestmark = needs_chromium

JENKINS = "sandbox allow-same-origin; default-src 'none'; img-src 'self'; style-src 'self';"
"""The content security policy that Jenkins serves the files of a build with."""

UNREADABLE = Path(__file__).with_name("unreadable.js").read_text(encoding="utf-8")


class Server(http.server.ThreadingHTTPServer):
    """Serves a folder, with a policy if there is one."""

    policy = ""


class Handler(http.server.SimpleHTTPRequestHandler):
    server: Server

    def end_headers(self) -> None:
        # A page that the browser kept would keep its policy, too.
        self.send_header("Cache-Control", "no-store")
        if self.server.policy:
            self.send_header("Content-Security-Policy", self.server.policy)
        super().end_headers()

    def do_GET(self) -> None:
        if self.path == "/favicon.ico":
            self.send_response(204)
            self.end_headers()
        else:
            super().do_GET()

    def log_message(self, *_arguments: Any) -> None:
        """Nobody reads it."""


@pytest.fixture(scope="module", name="folder")
def report_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reports")
    for name, simulation in {"usual": USUAL, "hostile": HOSTILE_RUN}.items():
        run = simulation.write(tmp_path_factory.mktemp(name) / "run")
        reported = ReportInput(result=result_of(run), run=run)
        (folder / f"{name}.html").write_bytes(render(reported))
    results = tmp_path_factory.mktemp("history") / "results"
    write_history(results, some_result(results.parent / "run"), noisy(40, {25: 1.12}))
    (folder / "trend.html").write_bytes(render_trend("html", *read_histories([results])))
    return folder


@pytest.fixture(scope="module", name="server")
def report_server(folder: Path) -> Iterator[Server]:
    with Server(("127.0.0.1", 0), functools.partial(Handler, directory=str(folder))) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture(autouse=True)
def no_policy(server: Server) -> None:
    server.policy = ""


def address(server: Server, name: str = "usual") -> str:
    return f"http://127.0.0.1:{server.server_address[1]}/{name}.html"


def charts_are_drawn(page: Page) -> None:
    sizes = page.evaluate(
        """[...document.querySelectorAll("svg:not(.budget)")].map((svg) => {
          const box = svg.getBoundingClientRect();
          return [box.width, box.height, svg.querySelectorAll("path").length];
        })"""
    )
    assert len(sizes) >= 5
    assert all(width > 200 and height > 40 and shapes for width, height, shapes in sizes)


@pytest.mark.parametrize("scripts", [True, False], ids=["scripts", "no scripts"])
def test_it_renders_with_a_clean_console(browser: Chromium, server: Server, scripts: bool) -> None:
    with browser.page(address(server), scripts=scripts) as page:
        charts_are_drawn(page)
        assert page.console() == []
        assert page.evaluate("document.querySelectorAll('.tools').length > 0") is scripts
        assert [request for request in page.requests() if "favicon" not in request] == [
            address(server)
        ]


def test_it_reads_fully_under_the_policy_of_jenkins(browser: Chromium, server: Server) -> None:
    server.policy = JENKINS
    with browser.page(address(server)) as page:
        charts_are_drawn(page)
        # The stylesheet and the script are refused, once each, and nothing else is.
        said = page.console()
        assert sum("inline style" in each for each in said) <= 1
        assert sum("script" in each.lower() for each in said) <= 1
        assert len(said) <= 2, said
        # Colours and sizes come from attributes.
        drawn = page.evaluate(
            """[...document.querySelectorAll("svg [class*='k-s0']")]
                 .map((one) => getComputedStyle(one).stroke)"""
        )
        assert set(drawn) == {"rgb(11, 98, 168)"}
        assert page.evaluate("document.querySelector('.tools')") is None


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_every_word_can_be_read(browser: Chromium, server: Server, dark: bool) -> None:
    with browser.page(address(server), dark=dark) as page:
        assert page.evaluate(UNREADABLE) == []


def test_a_narrow_screen_needs_no_sideways_scrolling(browser: Chromium, server: Server) -> None:
    with browser.page(address(server), width=390) as page:
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_hostile_words_run_nothing(browser: Chromium, server: Server) -> None:
    with browser.page(address(server, "hostile")) as page:
        assert page.console() == []
        assert page.evaluate("document.querySelectorAll('img, body script').length") == 1
        assert "<script>alert(1)</script>" in page.evaluate("document.body.innerText")


@pytest.mark.parametrize("width", [390, 1280])
def test_pointing_at_a_value_of_a_history_says_its_commit(
    browser: Chromium, server: Server, width: int
) -> None:
    with browser.page(address(server, "trend"), width=width) as page:
        assert page.console() == []
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        assert page.evaluate("document.querySelector('svg.chart').textContent").count("since") >= 1
        point_at_the_middle(page, place=1 / 16)
        told = page.evaluate("document.querySelector('.tip').textContent")
        assert any(f": {commit(number)[:7]}, 2026-01-01T" in told for number in range(8))


def point_at_the_middle(page: Page, place: float = 1 / 4) -> None:
    """Point at a value of the first line, a fourth of its numbers being the middle of it."""
    x, y = page.evaluate(
        """((place) => {
          const svg = document.querySelector("svg.chart");
          svg.scrollIntoView({behavior: "instant"});
          const path = svg.querySelector("g[data-label] > path");
          const numbers = path.getAttribute("d").match(/-?[\\d.]+/g).map(Number);
          const middle = Math.floor(numbers.length * place) * 2;
          const on = new DOMPoint(numbers[middle], numbers[middle + 1])
            .matrixTransform(svg.getScreenCTM());
          return [on.x, on.y];
        })"""
        f"({place})"
    )
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
