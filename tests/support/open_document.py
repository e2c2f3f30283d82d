"""A document that is open in a client of the language server; `¦` in a text is the cursor."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

from lsprotocol import types
from pygls.protocol import default_converter
from pytest_lsp import LanguageClient
from pytest_lsp.client import DEFAULT_CLIENT_FEATURES, register_lsp_features

SPEC = Path(__file__).with_name("robot.r2b.yaml").read_text(encoding="utf-8")
"""A spec without findings, whose node is that of `NODES` in the same folder."""

UNKNOWN = """\
    other:
      package: cell_vision
      plugin: cell_vision::Detector
      remappings: {found: copied}
monitors:
"""
"""In place of ``monitors:``: a further node, of which nothing is known."""

NODES = """\
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image


class Relay(Node):
    def __init__(self, **kwargs):
        super().__init__("relay", **kwargs)
        self.declare_parameter("gain", 1.5)
        self.publisher = self.create_publisher(Image, "output", 7)
        self.create_subscription(Image, "input", self.publisher.publish, qos_profile_sensor_data)
"""


def changed(old: str, new: str) -> str:
    """The spec with the only place of a text replaced."""
    assert SPEC.count(old) == 1
    return SPEC.replace(old, new)


class VersionedClient(LanguageClient):
    """A client that knows of which version of a text the published diagnostics are."""

    def __init__(self) -> None:
        super().__init__(converter_factory=default_converter)
        self.published_versions: dict[str, int | None] = {}
        register_lsp_features(
            self,
            {
                **DEFAULT_CLIENT_FEATURES,
                types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS: keep_diagnostics,
            },
        )


def path_of(uri: str) -> Path:
    """The file of a URI."""
    return Path(unquote(urlparse(uri).path))


def keep_diagnostics(client: VersionedClient, params: types.PublishDiagnosticsParams) -> None:
    client.diagnostics[params.uri] = params.diagnostics
    client.published_versions[params.uri] = params.version


class OpenDocument:
    """A spec that is open in the editor; `¦` in a text is the cursor."""

    def __init__(self, client: VersionedClient, path: Path) -> None:
        self.client = client
        self.path = path
        self.uri = path.as_uri()
        self.id = types.TextDocumentIdentifier(self.uri)
        self.version = 0
        self.text = ""

    async def write(self, text: str) -> types.Position:
        """Open or change the document, wait for findings of a spec, and return the cursor."""
        position = self.change(text)
        if re.search(r"^r2bspec:", text, re.MULTILINE):
            await self.published()
        return position

    def change(self, text: str) -> types.Position:
        """Open or change the document, and return the cursor."""
        cursor = text.find("¦")
        self.text = text.replace("¦", "")
        self.version += 1
        self.forget_diagnostics()
        if self.version == 1:
            item = types.TextDocumentItem(self.uri, "yaml", self.version, self.text)
            self.client.text_document_did_open(types.DidOpenTextDocumentParams(item))
        else:
            document = types.VersionedTextDocumentIdentifier(self.version, self.uri)
            change = types.TextDocumentContentChangeWholeDocument(self.text)
            self.client.text_document_did_change(
                types.DidChangeTextDocumentParams(document, [change])
            )
        before = text[: max(cursor, 0)]
        return types.Position(before.count("\n"), len(before) - before.rfind("\n") - 1)

    def forget_diagnostics(self) -> None:
        """What is published from now on counts."""
        self.client.diagnostics.pop(self.uri, None)
        self.client.published_versions.pop(self.uri, None)

    async def published(self) -> None:
        """Wait for diagnostics of the newest text: those of an earlier one may still arrive."""
        while self.client.published_versions.get(self.uri) != self.version:
            await self.client.wait_for_notification(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)

    def close(self) -> None:
        self.client.text_document_did_close(types.DidCloseTextDocumentParams(self.id))

    def found(self) -> dict[str, types.Diagnostic]:
        return {str(each.code): each for each in self.client.diagnostics[self.uri]}

    def worse(self) -> list[str]:
        """The messages of errors and warnings."""
        return [each.message for each in self.found().values() if (each.severity or 1) <= 2]

    def line_of(self, where: types.Range) -> str:
        return self.text.split("\n")[where.start.line].strip()

    def range_text(self, where: types.Range) -> str:
        lines = self.text.split("\n")
        assert where.start.line == where.end.line
        return lines[where.start.line][where.start.character : where.end.character]

    async def labels(self, text: str) -> dict[str, types.CompletionItem]:
        position = await self.write(text)
        answer = await self.client.text_document_completion_async(
            types.CompletionParams(self.id, position)
        )
        assert isinstance(answer, types.CompletionList)
        return {item.label: item for item in answer.items}

    async def hover(self, text: str) -> str:
        position = await self.write(text)
        answer = await self.client.text_document_hover_async(types.HoverParams(self.id, position))
        assert answer is not None
        assert isinstance(answer.contents, types.MarkupContent)
        return answer.contents.value

    async def definitions(self, text: str) -> list[types.Location]:
        position = await self.write(text)
        answer = await self.client.text_document_definition_async(
            types.DefinitionParams(self.id, position)
        )
        assert isinstance(answer, list | tuple)
        return [each for each in answer if isinstance(each, types.Location)]

    async def rename(self, position: types.Position, name: str) -> types.WorkspaceEdit | None:
        return await self.client.text_document_rename_async(
            types.RenameParams(self.id, position, name)
        )

    async def actions(self, where: types.Range) -> dict[str, Any]:
        """What can be done about a range, by titles."""
        answer = await self.client.text_document_code_action_async(
            types.CodeActionParams(self.id, where, types.CodeActionContext([]))
        )
        return {each.title: each for each in answer or ()}

    async def apply(self, edit: types.WorkspaceEdit | None) -> int:
        """Write what is edited here; returns the number of edits."""
        assert edit is not None
        assert edit.changes is not None
        edits = edit.changes[self.uri]
        await self.write(edited(self.text, edits))
        return len(edits)


def edited(text: str, edits: Sequence[types.TextEdit | object]) -> str:
    """The text after the edits of one document."""
    lines = text.split("\n")
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line) + 1)
    changes = [edit for edit in edits if isinstance(edit, types.TextEdit)]
    for change in sorted(changes, key=lambda one: one.range.start.line, reverse=True):
        first = starts[change.range.start.line] + change.range.start.character
        last = starts[change.range.end.line] + change.range.end.character
        text = text[:first] + change.new_text + text[last:]
    return text
