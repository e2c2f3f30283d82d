"""A document that is open in a client of the language server; `¦` in a text is the cursor."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from lsprotocol import types
from pygls.protocol import default_converter
from pytest_lsp import LanguageClient
from pytest_lsp.client import DEFAULT_CLIENT_FEATURES, register_lsp_features


class VersionedClient(LanguageClient):
    """A client that knows of which version of a text the published diagnostics are."""

    def __init__(self) -> None:
        super().__init__(converter_factory=default_converter)
        self.published_versions: dict[str, int | None] = {}
        register_lsp_features(
            self,
            {**DEFAULT_CLIENT_FEATURES, types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS: keep_diagnostics},
        )


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
        return {each.label: each for each in answer.items}


def edited(text: str, edits: Sequence[types.TextEdit | object]) -> str:
    """The text after the edits of one document."""
    lines = text.split("\n")
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line) + 1)
    changes = [each for each in edits if isinstance(each, types.TextEdit)]
    for each in sorted(changes, key=lambda one: one.range.start.line, reverse=True):
        first = starts[each.range.start.line] + each.range.start.character
        last = starts[each.range.end.line] + each.range.end.character
        text = text[:first] + each.new_text + text[last:]
    return text
