"""The language server in Neovim, and the spec of the tutorial written with it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from lsprotocol import types

from open_document import OpenDocument, VersionedClient
from tutorial_page import page_files, steps, write_robot
from typing_editor import TypingEditor

# The language server in Neovim, without a screen.


SESSION = Path(__file__).with_name("neovim_session.lua")
SPEC = """\
r2bspec: 1
name: relay
playback:
  mode: Looping
  inputs:
    input: {from: camera/image, format: sensor_msgs/msg/Image}
data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: camera/image}}
graph: {nodes: {relay: {python: r2bspec.nodes.RelayNode}}}
monitors: {copies: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {rates: [10 Hz]}
"""


NEOVIM = shutil.which("nvim") or ""


@pytest.mark.skipif(not NEOVIM, reason="Neovim is not installed")
def test_a_session_in_neovim(tmp_path: Path) -> None:
    spec = tmp_path / "relay.r2b.yaml"
    spec.write_text(SPEC)
    environment = os.environ | {
        "R2BSPEC_LSP": f"{sys.executable} -m r2bspec lsp",
        "HOME": str(tmp_path),
    }
    done = subprocess.run(
        [NEOVIM, "--headless", "-u", "NONE", "-S", str(SESSION), str(spec)],
        check=False,
        capture_output=True,
        text=True,
        env=environment,
        timeout=250,
    )
    said = dict(line.split(": ", 1) for line in done.stdout.splitlines() if ": " in line)
    assert done.returncode == 0, (done.stdout, done.stderr)
    assert said["finding"].startswith("R2B104 unknown choice 'Looping'")
    assert said["mended"] == "0"
    assert said["completion"] == "live looping sweeping timeline"
    assert "playback.mode" in said["hover"]
    assert spec.read_text() == SPEC


# The spec of the tutorial is written with what the server offers, from an empty file.
#
# Only names that are the user's own, and numbers, are typed.


TYPED = [
    *("stereo_brightness", "recorded/left", "recorded/right", "10", "brightness", "brightness"),
    *("20", "1500", "4", "keeps_up", "200", "5"),
]
"""Every word that a user types: names, and numbers."""


@pytest.mark.asyncio(loop_scope="session")
async def test_the_spec_of_the_tutorial(client: VersionedClient, tmp_path: Path) -> None:
    write_robot(tmp_path)
    document = OpenDocument(client, tmp_path / "stereo.r2b.yaml")

    async def complete(text: str, offset: int) -> list[types.CompletionItem]:
        return list((await document.labels(f"{text[:offset]}¦{text[offset:]}")).values())

    editor = TypingEditor(complete)
    for kind, text in steps():
        match kind:
            case "accept":
                await editor.accept(text)
            case "next_stop":
                editor.next_stop()
            case "line":
                editor.line(text)
            case _:
                editor.type(text)
    assert yaml.safe_load(editor.text) == yaml.safe_load(page_files()["stereo.r2b.yaml"])
    assert editor.typed == TYPED
    assert not re.search(r"[ \t]+$", editor.text, re.MULTILINE), editor.text
    await document.write(editor.text + "\n")
    assert document.worse() == []
    document.close()
