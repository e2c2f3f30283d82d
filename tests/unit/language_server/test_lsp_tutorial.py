"""The spec of the tutorial is written with what the server offers, from an empty file.

Only names that are the user's own, and numbers, are typed.
"""

from __future__ import annotations

import re
import runpy
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_lsp
import yaml
from lsprotocol import types
from pytest_lsp import ClientServerConfig, client_capabilities

import patient_language_server
from open_document import OpenDocument, VersionedClient
from tutorial_page import page_files
from typing_editor import TypingEditor

TYPED = [
    *("stereo_brightness", "recorded/left", "recorded/right", "10", "brightness", "brightness"),
    *("20", "1500", "4", "keeps_up", "200", "5"),
]
"""Every word that a user types: names, and numbers."""


@pytest_lsp.fixture(  # type: ignore[untyped-decorator]
    config=ClientServerConfig(
        client_factory=VersionedClient, server_command=patient_language_server.COMMAND
    ),
)
async def client(lsp_client: VersionedClient, tmp_path: Path) -> AsyncIterator[None]:
    await lsp_client.initialize_session(
        types.InitializeParams(
            capabilities=client_capabilities("visual-studio-code"),
            workspace_folders=[types.WorkspaceFolder(tmp_path.as_uri(), "robot")],
        )
    )
    yield
    await lsp_client.shutdown_session()


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What the user of the tutorial has: the node, and the recording."""
    monkeypatch.chdir(tmp_path)
    for name in ("stereo_brightness.py", "make_drive.py"):
        (tmp_path / name).write_text(page_files()[name])
    runpy.run_path("make_drive.py")
    return tmp_path


@pytest.mark.asyncio
async def test_the_spec_of_the_tutorial(client: VersionedClient, robot: Path) -> None:
    document = OpenDocument(client, robot / "stereo.r2b.yaml")

    async def complete(text: str, offset: int) -> list[types.CompletionItem]:
        position = await document.write(f"{text[:offset]}¦{text[offset:]}")
        answer = await client.text_document_completion_async(
            types.CompletionParams(document.id, position)
        )
        assert isinstance(answer, types.CompletionList)
        return list(answer.items)

    editor = TypingEditor(complete)
    await write_tutorial(editor)
    wanted = page_files()["stereo.r2b.yaml"]
    assert yaml.safe_load(editor.text) == yaml.safe_load(wanted)
    assert editor.typed == TYPED
    assert not re.search(r"[ \t]+$", editor.text, re.MULTILINE), editor.text
    await document.write(editor.text + "\n")
    worse = types.DiagnosticSeverity.Warning
    messages = [
        diagnostic.message
        for diagnostic in client.diagnostics[document.uri]
        if (diagnostic.severity or 1) <= worse
    ]
    assert messages == []


async def write_tutorial(editor: TypingEditor) -> None:
    await editor.accept("r2bspec")
    await editor.accept("1")
    editor.enter(0)
    await editor.accept("name")
    editor.type("stereo_brightness")

    editor.enter(0)
    await editor.accept("data_loader")
    await editor.accept("bag")
    await editor.accept("./drive")
    editor.enter(2)
    await editor.accept("topics")
    for side in ("left", "right"):
        await editor.accept(f"/{side}/image_raw")
        editor.type(f"recorded/{side}")
        editor.enter(4)

    editor.backspace(4)
    await editor.accept("playback")
    await editor.accept("pairing")
    await editor.accept("slop")
    editor.type("10 ")
    await editor.accept("ms")
    editor.enter(2)
    await editor.accept("inputs")
    for side in ("left", "right"):
        await editor.accept(f"{side}/image_raw")
        await editor.accept(f"recorded/{side}")
        editor.next_stop()
        await editor.accept("sensor_msgs/msg/Image")
        editor.enter(4)

    editor.backspace(4)
    await editor.accept("graph")
    await editor.accept("nodes")
    editor.type("brightness:")
    editor.enter(6)
    await editor.accept("python")
    await editor.accept("./stereo_brightness.py:StereoBrightness")

    editor.enter(0)
    await editor.accept("monitors")
    await editor.accept("a monitor")
    editor.type("brightness")
    editor.next_stop()
    await editor.accept("brightness")
    editor.next_stop()
    await editor.accept("geometry_msgs/msg/PointStamped")

    editor.enter(0)
    await editor.accept("benchmark")
    await editor.accept("rates")
    editor.type("[20 ")
    await editor.accept("Hz")
    editor.type("]")
    editor.enter(2)
    await editor.accept("duration")
    editor.type("1500 ")
    await editor.accept("ms")
    editor.enter(2)
    await editor.accept("iterations")
    editor.type("4")

    editor.enter(0)
    await editor.accept("slos")
    await editor.accept("an objective")
    editor.type("keeps_up")
    editor.next_stop()
    await editor.accept("20 Hz")
    editor.next_stop()
    await editor.accept("latency.p90")
    editor.type(" ")
    await editor.accept("<")
    editor.type(" 200 ")
    await editor.accept("ms")
    editor.enter(6, "- ")
    await editor.accept("drop_rate")
    editor.type(" ")
    await editor.accept("<=")
    editor.type(" 5 ")
    await editor.accept("%")
