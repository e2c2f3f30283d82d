"""The extension in a real VS Code: code-server, with a headless Chromium as its window.

Set R2BSPEC_CODE_SERVER to the words that start code-server, and R2BSPEC_TEST_EDITORS=1.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from chromium import Chromium, Page, needs_chromium

from vscode_extension import packaged

SERVER = shlex.split(os.environ.get("R2BSPEC_CODE_SERVER", ""))
pytestmark = [
    needs_chromium,
    pytest.mark.skipif(not SERVER, reason="R2BSPEC_CODE_SERVER does not name a code-server"),
    pytest.mark.timeout(500),
]

RELAY = Path(__file__).parents[2] / "specs" / "relay.r2b.yaml"
TIMEOUT_S = 90.0

TEXTS = "[...document.querySelectorAll({selector!r})].map((each) => each.innerText)"
F1, SPACE, ENTER, END = (
    {"key": name, "code": name, "windowsVirtualKeyCode": number}
    for name, number in (("F1", 112), ("Space", 32), ("Enter", 13), ("End", 35))
)
CONTROL = 2


def write_environment(folder: Path) -> None:
    """The environment of these tests as that of a workspace."""
    programs = folder / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "r2bspec").write_text(f'#!/bin/sh\nexec {sys.executable} -m r2bspec "$@"\n')
    (programs / "r2bspec").chmod(0o755)


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two specs."""
    folder = tmp_path_factory.mktemp("robot")
    write_environment(folder)
    text = RELAY.read_text("utf-8")
    (folder / "right.r2b.yaml").write_text(text)
    # The mistake is in the first lines, which the window shows.
    (folder / "wrong.r2b.yaml").write_text(text.replace("labels: {", "lables: {"))
    return folder


@pytest.fixture(scope="module")
def address(workspace: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Where the server with the extension answers."""
    own = tmp_path_factory.mktemp("code-server")
    folders = ["--user-data-dir", str(own / "data"), "--extensions-dir", str(own / "extensions")]
    extension = packaged(tmp_path_factory.mktemp("extension"))
    subprocess.run([*SERVER, *folders, "--install-extension", str(extension)], check=True)
    words = ["--auth=none", "--bind-addr=127.0.0.1:0", "--disable-telemetry"]
    words += ["--disable-update-check", "--disable-workspace-trust"]
    log = own / "log"
    with log.open("wb") as stream:
        server = subprocess.Popen([*SERVER, *folders, *words], stdout=stream, stderr=stream)
    try:
        deadline = time.monotonic() + TIMEOUT_S
        while not (found := re.search(r"listening on (http://\S+?)/?\s", log.read_text())):
            assert server.poll() is None, log.read_text()
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.1)
        yield found[1]
    finally:
        server.terminate()
        server.wait(30)


@pytest.fixture
def window(workspace: Path, address: str) -> Iterator[Window]:
    url = f"{address}/?folder={workspace}"
    with Chromium() as browser, browser.page(url, width=1400) as page:
        yield Window(page)


class Window:
    """The window of the editor."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self.wait_for(".monaco-workbench .explorer-folders-view .monaco-list-row")

    def wait_for(self, selector: str, text: str = "") -> list[str]:
        """The texts of the elements, once there is one, and one with this text."""
        deadline = time.monotonic() + TIMEOUT_S
        while True:
            found: list[str] = self._page.evaluate(TEXTS.format(selector=selector)) or []
            if found and any(text in each for each in found):
                return found
            if time.monotonic() > deadline:
                raise AssertionError(f"{selector} with {text!r} in {found}")
            time.sleep(0.2)

    def texts(self, selector: str) -> list[str]:
        """The texts of the elements now."""
        found: list[str] = self._page.evaluate(TEXTS.format(selector=selector)) or []
        return found

    def has(self, selector: str, timeout_s: float = 3.0) -> bool:
        """Whether there is an element soon."""
        deadline = time.monotonic() + timeout_s
        while not self.texts(selector):
            if time.monotonic() > deadline:
                return False
            time.sleep(0.05)
        return True

    def wait_until_gone(self, selector: str) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while self.texts(selector):
            assert time.monotonic() < deadline, f"{selector} is still there"
            time.sleep(0.05)

    def press(self, key: dict[str, Any], modifiers: int = 0) -> None:
        for kind in ("rawKeyDown", "keyUp"):
            self._page.call("Input.dispatchKeyEvent", type=kind, modifiers=modifiers, **key)

    def type(self, text: str) -> None:
        self._page.call("Input.insertText", text=text)

    def pick(self, words: str, row: str) -> None:
        """Choose a row of the palette: of commands with `>`, of files without."""
        self.press(F1)
        self.wait_for(".quick-input-widget .quick-input-box")
        self._page.evaluate("document.querySelector('.quick-input-box input').select()")
        self.type(words)
        self.wait_for(".quick-input-widget .monaco-list-row", row)
        self.press(ENTER)

    def open(self, name: str) -> None:
        self.pick(name, name)
        self.wait_for(".tab.active", name)


def test_findings_are_problems(window: Window) -> None:
    window.open("wrong.r2b.yaml")
    window.pick(">Problems: Focus", "Focus on Problems View")
    window.wait_for(".markers-panel .monaco-list-row", "R2B101")
    window.wait_for(".markers-panel .monaco-list-row", "unknown key 'lables'")


def test_lenses_completion_and_the_graph(window: Window) -> None:
    window.open("right.r2b.yaml")
    titles = window.wait_for(".codelens-decoration a", "graph")
    assert titles[:4] == ["run", "smoke", "plan", "graph"]
    window.press(END, CONTROL)
    window.type("\n    ")
    window.press(SPACE, CONTROL)
    rows = window.wait_for(".suggest-widget.visible .monaco-list-row", "confidence")
    assert any(row.startswith("when") for row in rows)
    window.pick(">r2bspec: Draw", "Draw the Graph")
    window.wait_for(".tab", "Graph of right.r2b.yaml")


def test_cases_are_tests(window: Window) -> None:
    window.open("right.r2b.yaml")
    window.wait_for(".codelens-decoration a", "run")
    window.pick(">Testing: Focus on Test Explorer", "Test Explorer")
    window.wait_for(".test-explorer .monaco-list-row", "right.r2b.yaml")
