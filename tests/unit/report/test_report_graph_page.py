"""``r2bspec plan --graph html``: the drawing as one page that loads and runs nothing."""

from __future__ import annotations

import base64
import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from r2bspec.cli.main import main

RELAY = Path(__file__).parents[3] / "specs" / "relay.r2b.yaml"
_LOADING = {"script", "img", "link", "iframe", "object", "embed", "video", "audio", "base"}


class Page(HTMLParser):
    """Tags, attributes that load or run something, and the texts of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.loads: list[tuple[str, str]] = []
        self.policy = ""
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        found = dict(attrs)
        if found.get("http-equiv") == "Content-Security-Policy":
            self.policy = found["content"] or ""
        self.loads += [
            (name, value or "")
            for name, value in attrs
            if name in {"src", "href", "style", "srcset"} or name.startswith("on")
        ]

    def handle_data(self, data: str) -> None:
        self.texts.append(data.strip())


def page_of(spec: Path, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["plan", str(spec), "--graph", "html"]) == 0
    return capsys.readouterr().out


def test_the_policy_allows_the_style_of_the_page_and_nothing_else(
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = page_of(RELAY, capsys)
    page = Page(text)
    style = re.search(r"<style>(.*)</style>", text, re.DOTALL)
    assert style is not None
    digest = base64.b64encode(hashlib.sha256(style[1].encode()).digest()).decode()
    assert page.policy == f"default-src 'none'; style-src 'sha256-{digest}'"
    assert not _LOADING & {*page.tags}
    assert page.loads == []


def test_the_drawing_shows_the_nodes_and_topics_of_the_plan(
    capsys: pytest.CaptureFixture[str],
) -> None:
    texts = Page(page_of(RELAY, capsys)).texts
    assert {"/r2b/relay", "/r2b/relayed", "player"} <= {*texts}
    assert texts.count("A relay that takes 10 ms for each message") == 1
    assert any(each.startswith("A run takes about ") for each in texts)


def test_names_of_the_spec_are_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = tmp_path / "hostile.r2b.yaml"
    title = "title: '</title><script>alert(1)</script>'"
    spec.write_text(re.sub("title: .*", title, RELAY.read_text("utf-8"), count=1), "utf-8")
    page = Page(page_of(spec, capsys))
    assert "script" not in page.tags
    assert "</title><script>alert(1)</script>" in page.texts
