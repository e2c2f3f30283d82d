"""``r2bspec plan --graph html``: the drawing as one page that loads and runs nothing."""

from __future__ import annotations

import base64
import hashlib
import re
from pathlib import Path

from command_line import Call
from html_elements import Page

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
    assert page.text.count("A relay that takes 10 ms for each message") == 1
    assert "A run takes about " in page.text


def test_names_of_the_spec_are_text(tmp_path: Path, call: Call) -> None:
    spec = tmp_path / "hostile.r2b.yaml"
    title = "title: '</title><script>alert(1)</script>'"
    spec.write_text(re.sub("title: .*", title, RELAY.read_text("utf-8"), count=1), "utf-8")
    page = Page(call("plan", spec, "--graph", "html", status=0).out.encode())
    assert not page.of("script")
    assert "</title><script>alert(1)</script>" in page.text
