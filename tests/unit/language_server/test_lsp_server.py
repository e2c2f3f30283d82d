"""The language server through a real client, over standard input and output."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_lsp
from lsprotocol import types
from pytest_lsp import ClientServerConfig, LanguageClient, client_capabilities

SPEC = """\
r2bspec: 1
name: relay
variables:
  rate: 10 Hz
  unused: 3
playback:
  inputs:
    image: {from: camera/image, format: sensor_msgs/msg/Image}
data_loader:
  bag: r2b_storage
  window: {start: 0.0 s, end: 0.5 s}
  topics:
    /d455_1_rgb_image: camera/image
graph:
  nodes:
    relay:
      python: r2bspec.nodes.RelayNode
      parameters: {type: sensor_msgs/msg/Image}
      remappings:
        input: image
        output: copied
monitors:
  copies: {topic: copied, format: sensor_msgs/msg/Image}
benchmark:
  duration: 2 s
  rates: [$(var rate)]
slos:
  fast:
    at: $(var rate)
    require:
      - latency.p90 < 250 ms
      - copies.drop_rate <= 5 %
"""


@pytest_lsp.fixture(
    config=ClientServerConfig(server_command=[sys.executable, "-m", "r2bspec", "lsp"])
)
async def client(lsp_client: LanguageClient, tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[None]:
    folder = tmp_path_factory.mktemp("workspace")
    await lsp_client.initialize_session(
        types.InitializeParams(
            capabilities=client_capabilities("visual-studio-code"),
            workspace_folders=[types.WorkspaceFolder(folder.as_uri(), "robot")],
        )
    )
    yield
    await lsp_client.shutdown_session()


async def opened(client: LanguageClient, path: Path, text: str) -> list[types.Diagnostic]:
    """The diagnostics of a text that is opened as a file."""
    uri = path.as_uri()
    client.text_document_did_open(
        types.DidOpenTextDocumentParams(types.TextDocumentItem(uri, "yaml", 1, text))
    )
    await client.wait_for_notification(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
    return list(client.diagnostics[uri])


@pytest.mark.asyncio
async def test_diagnostics(client: LanguageClient, tmp_path: Path) -> None:
    found = await opened(client, tmp_path / "a.r2b.yaml", SPEC)
    for each in found: print(each.code, each.message, each.range, each.tags, each.code_description)
    assert False
