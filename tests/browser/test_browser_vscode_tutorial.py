"""The spec of the tutorial is written in a real VS Code with what it offers.

Keys are pressed, and proposals are accepted; only names and numbers are typed. See
`test_browser_vscode` for what it needs.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
import yaml
from test_browser_vscode import CONTROL, SPACE, TIMEOUT_S, Window, pytestmark, write_environment
from test_browser_vscode import address as address
from test_browser_vscode import window as window

from r2bspec.api import validate
from tutorial_page import page_files, steps, write_robot

__all__ = ["pytestmark"]

TAB, DOWN, ESCAPE, ENTER, SAVE = (
    {"key": name, "code": code, "windowsVirtualKeyCode": number}
    for name, code, number in (
        ("Tab", "Tab", 9),
        ("ArrowDown", "ArrowDown", 40),
        ("Escape", "Escape", 27),
        ("Enter", "Enter", 13),
        ("s", "KeyS", 83),
    )
)
SETTINGS = {
    "[r2bspec]": {
        "editor.quickSuggestions": {"other": False, "strings": False},
        "editor.autoIndent": "none",
    },
    "editor.suggestOnTriggerCharacters": False,
    "editor.wordBasedSuggestions": "off",
    "editor.autoClosingBrackets": "never",
    "files.autoSave": "off",
}
"""The list opens when it is asked for, and a new line is indented by its spaces alone."""
ROW = ".suggest-widget.visible .monaco-list-row"
MOST_ROWS = 400


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the user of the tutorial has: the node, and the recording; and an empty file."""
    folder = tmp_path_factory.mktemp("robot")
    write_environment(folder)
    write_robot(folder)
    (folder / "stereo.r2b.yaml").touch()
    (folder / ".vscode").mkdir()
    (folder / ".vscode" / "settings.json").write_text(json.dumps(SETTINGS))
    return folder


class Typist:
    """Writes in the editor of a window."""

    def __init__(self, window: Window) -> None:
        self._window = window

    def type(self, text: str) -> None:
        self._window.type(text)

    def line(self, text: str) -> None:
        """Begin a line, out of the snippet that was accepted last."""
        self._window.press(ESCAPE)
        self._window.type(text)

    def next_stop(self, _: str) -> None:
        self._window.press(TAB)

    def accept(self, label: str) -> None:
        """Choose a proposal of the list, which is opened again until it has it."""
        deadline = time.monotonic() + TIMEOUT_S
        while not self._focus(label):
            shown = self._window.texts(".view-lines .view-line")
            assert time.monotonic() < deadline, f"{label!r} is not offered in {shown}"
            self._window.press(ESCAPE)
        self._window.press(ENTER)
        self._window.wait_until_gone(ROW)

    def _focus(self, label: str) -> bool:
        self._window.press(SPACE, CONTROL)
        if not self._window.has(ROW):
            return False
        for _ in range(MOST_ROWS):
            focused = self._window.texts(f"{ROW}.focused .label-name")
            if focused == [label]:
                return True
            self._window.press(DOWN)
        return False


def test_the_spec_of_the_tutorial(window: Window, workspace: Path) -> None:
    window.open("stereo.r2b.yaml")
    typist = Typist(window)
    for kind, text in steps():
        getattr(typist, kind)(text)
    window.press(SAVE, CONTROL)
    file = workspace / "stereo.r2b.yaml"
    deadline = time.monotonic() + TIMEOUT_S
    while not file.read_text():
        assert time.monotonic() < deadline, "it is not saved"
        time.sleep(0.1)
    assert yaml.safe_load(file.read_text()) == yaml.safe_load(page_files()["stereo.r2b.yaml"])
    assert [each.message for each in validate(file) if each.severity != "info"] == []
