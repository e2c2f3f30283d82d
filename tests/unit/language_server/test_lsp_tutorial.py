"""The spec of the tutorial is written with what the server offers, from an empty file.

Only names that are the user's own, and numbers, are typed.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml
from lsprotocol import types

from open_document import OpenDocument, VersionedClient
from tutorial_page import page_files, steps, write_robot
from typing_editor import TypingEditor

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
