"""``r2bspec plan --graph html``: the drawing as one page that loads and runs nothing."""

from __future__ import annotations

import base64
import hashlib
import re
from pathlib import Path

import pytest

from html_elements import Page
from r2bspec.cli.main import main

RELAY = Path(__file__).parents[3] / "specs" / "relay.r2b.yaml"
_LOADING = {"script", "img", "link", "iframe", "object", "embed", "video", "audio", "base"}


def page_of(spec: Path, capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["plan", str(spec), "--graph", "html"]) == 0
    return capsys.readouterr().out


def test_the_policy_allows_the_style_of_the_page_and_nothing_else(
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = page_of(RELAY, capsys)
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


def test_the_drawing_shows_the_nodes_and_topics_of_the_plan(
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = Page(page_of(RELAY, capsys).encode()).text
    assert {"/r2b/relay", "/r2b/relayed", "player"} <= set(text.split())
    assert text.count("A relay that takes 10 ms for each message") == 1
    assert "A run takes about " in text


def test_names_of_the_spec_are_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = tmp_path / "hostile.r2b.yaml"
    title = "title: '</title><script>alert(1)</script>'"
    spec.write_text(re.sub("title: .*", title, RELAY.read_text("utf-8"), count=1), "utf-8")
    page = Page(page_of(spec, capsys).encode())
    assert not page.of("script")
    assert "</title><script>alert(1)</script>" in page.text
