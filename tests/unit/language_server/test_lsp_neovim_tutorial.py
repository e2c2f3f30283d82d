"""The spec of the tutorial is written in Neovim: keys are pressed, and proposals are accepted.

Neovim runs without a screen; what a user would see is read from it. Its completion knows no
placeholders, so that the keys of a snippet are accepted one by one.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from r2bspec.api import validate
from tutorial_page import page_files, write_robot

NEOVIM = shutil.which("nvim") or ""
pytestmark = [
    pytest.mark.skipif(not NEOVIM, reason="Neovim is not installed"),
    pytest.mark.timeout(290),
]
TIMEOUT_S = 120.0
START = """
vim.o.autoindent = false
vim.o.completeopt = 'menuone'
local client = vim.lsp.start_client({{name = 'r2bspec', cmd = {command}, root_dir = '{root}'}})
vim.lsp.buf_attach_client(0, client)
vim.bo.omnifunc = 'v:lua.vim.lsp.omnifunc'
"""
ACCEPTED = re.compile(r"«([^»]*)»")
SPEC = """\
«r2bspec»«1»
«name»stereo_brightness
«data_loader»
  «bag»«./drive»
  «topics»
    «/left/image_raw»recorded/left
    «/right/image_raw»recorded/right
«playback»
  «pairing»
    «slop»10 «ms»
  «inputs»
    «left/image_raw»
      «from»«recorded/left»
      «format»«sensor_msgs/msg/Image»
    «right/image_raw»
      «from»«recorded/right»
      «format»«sensor_msgs/msg/Image»
«graph»
  «nodes»
    brightness:
      «python»«./stereo_brightness.py:StereoBrightness»
«monitors»
  brightness:
    «topic»«brightness»
    «format»«geometry_msgs/msg/PointStamped»
«benchmark»
  «rates»[20 «Hz»]
  «duration»1500 «ms»
  «iterations»4
«slos»
  keeps_up:
    «at»«20 Hz»
    «require»
      - «latency.p90» «<» 200 «ms»
      - «drop_rate» «<=» 5 «%»
"""
"""What is accepted is in «»; the rest is typed."""


class Neovim:
    """A Neovim that listens, with a file open and the server attached."""

    def __init__(self, folder: Path, file: str) -> None:
        self._socket = str(folder / "nvim.sock")
        words = [NEOVIM, "--headless", "-u", "NONE", "-n", "--listen", self._socket, file]
        self._process = subprocess.Popen(words, cwd=folder, stderr=subprocess.DEVNULL)
        self.wait_for("it listens", lambda: Path(self._socket).exists())
        script = folder / "start.lua"
        command = f"{{'{sys.executable}', '-m', 'r2bspec', 'lsp'}}"
        script.write_text(START.format(command=command, root=folder))
        self._tell("--remote-send", f":luafile {script}<CR>")
        ready = "luaeval('#vim.lsp.buf_get_clients(0) > 0')"
        self.wait_for("the server is attached", lambda: self.ask(ready) is True)
        self.press("i")

    def ask(self, expression: str) -> object:
        return json.loads(self._tell("--remote-expr", f"json_encode({expression})"))

    def press(self, keys: str) -> None:
        self._tell("--remote-send", keys)

    def type(self, text: str) -> None:
        self.press(text.replace("<", "<lt>").replace("\n", "<CR>"))

    def accept(self, label: str) -> None:
        """Choose an entry of the menu of proposals, which is opened again until it has it."""
        shown: list[str] = []

        def is_offered() -> bool:
            self.press("<C-e><C-x><C-o>" if shown else "<C-x><C-o>")
            found = self._entries()
            shown[:] = found
            return label in found

        self.wait_for(f"{label!r} is offered", is_offered)
        # The first entry is selected when the menu opens.
        self.press("<C-n>" * shown.index(label) + "<C-y>")

    def _entries(self) -> list[str]:
        """The texts of the menu; none if it does not open soon."""
        deadline = time.monotonic() + 3
        while time.monotonic() < deadline:
            found = self.ask("map(complete_info(['items']).items, 'v:val.abbr')")
            if isinstance(found, list) and found:
                return found
        return []

    def lines(self) -> list[str]:
        found = self.ask("getline(1, '$')")
        assert isinstance(found, list)
        return found

    def close(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(timeout=30)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _tell(self, kind: str, words: str) -> str:
        done = subprocess.run(
            [NEOVIM, "--server", self._socket, kind, words],
            check=True,
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
        )
        return done.stdout or done.stderr

    def wait_for(self, what: str, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while not condition():
            assert self._process.poll() is None, "Neovim has ended"
            assert time.monotonic() < deadline, f"{what}: {self.lines()}"


@pytest.fixture
def neovim(tmp_path: Path) -> Iterator[Neovim]:
    write_robot(tmp_path)
    editor = Neovim(tmp_path, "stereo.r2b.yaml")
    yield editor
    editor.close()


def test_the_spec_of_the_tutorial(neovim: Neovim, tmp_path: Path) -> None:
    parts = ACCEPTED.split(SPEC)
    for typed, accepted in zip(parts[::2], [*parts[1::2], ""], strict=True):
        neovim.type(typed)
        if accepted:
            neovim.accept(accepted)
    neovim.press("<Esc>:wa<CR>")
    file = tmp_path / "stereo.r2b.yaml"
    neovim.wait_for("it is saved", file.exists)
    assert yaml.safe_load("\n".join(neovim.lines())) == yaml.safe_load(
        page_files()["stereo.r2b.yaml"]
    )
    assert [each.message for each in validate(file) if each.severity != "info"] == []
