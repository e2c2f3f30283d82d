"""The server: connects the requests of an editor with the modules that answer them."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote, urlsplit

from lsprotocol import types
from pygls.exceptions import JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer

from r2bspec._version import __version__
from r2bspec.diagnostics import Span
from r2bspec.errors import R2bspecError
from r2bspec.language_server.actions import CASES_REQUEST, code_actions, spec_cases
from r2bspec.language_server.analysis import Analysis, OpenSpecs
from r2bspec.language_server.completion import TRIGGERS, complete
from r2bspec.language_server.findings import diagnostics_by_file, uri
from r2bspec.language_server.hover import hover
from r2bspec.language_server.positions import TextPositions
from r2bspec.language_server.symbols import definitions, references_at, renamable, rename
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES
from r2bspec.safe_io.safe_file import RefusedFileError, read_text

DEBOUNCE_S: Final = 0.005
"""Time without a change after which a text is analysed: editors may send what belongs together in
several notifications. Between two key presses is more, so that every one of them is shown."""

MAX_WAIT_S: Final = 0.5
"""Time that a completion waits for the analysis of the text; then an older one must do."""


class SpecLanguageServer(LanguageServer):
    """The server of an editor: open documents, their analyses, and the published findings."""

    def __init__(self) -> None:
        super().__init__("r2bspec", __version__)
        self.specs = OpenSpecs()
        self._positions = TextPositions("")
        self._task: asyncio.Task[None] | None = None
        self._waiting: set[Path] = set()
        self._shown: dict[str, Mapping[str, list[types.Diagnostic]]] = {}

    def text_of(self, path: Path) -> str:
        """Return the text of a file: the open text, or that on disk; empty if there is none."""
        text = self.specs.text(path)
        if text is None:
            with contextlib.suppress(OSError, RefusedFileError):
                text = read_text(path, max_bytes=MAX_DOCUMENT_BYTES)
        return text or ""

    def positions_of(self, file: str) -> TextPositions:
        """Return the positions in a file: in its open text, or in that on disk."""
        text = self.text_of(Path(file))
        # A long text has many findings, each with its positions.
        if self._positions.text is not text:
            encoding = self.workspace.position_encoding or types.PositionEncodingKind.Utf16
            self._positions = TextPositions(text, types.PositionEncodingKind(encoding).value)
        return self._positions

    def location(self, span: Span) -> types.Location:
        """Return the location of a span."""
        return types.Location(uri(span.file), self.positions_of(span.file).range(span))

    def update(self, document_uri: str) -> None:
        """Store the text of an open document, and analyse the specs that it belongs to."""
        document = self.workspace.get_text_document(document_uri)
        self.change(path_of(document_uri), document.source, document.version, document_uri)

    def change(self, path: Path, text: str, version: int | None = None, uri: str = "") -> None:
        """Analyse a text soon, unless it changes again before."""
        self.specs.change(path, text, version, uri)
        self.analyse_soon(path)

    def close(self, path: Path) -> None:
        """Forget a document; the file on disk counts again."""
        self.specs.close(path)
        self.analyse_soon()

    def files_changed(self) -> None:
        """Note that files on disk have changed."""
        self.specs.touch()
        self.analyse_soon()

    def analyse_soon(self, path: Path | None = None) -> None:
        """Analyse the specs that a document belongs to, or all of them."""
        self._waiting.update(self.specs.specs() if path is None else self.specs.affected_by(path))
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._analyse_waiting())

    async def settled(self, path: Path, limit_s: float = math.inf) -> None:
        """Wait until the newest text of a spec is analysed, or nothing is left to analyse.

        What the user has just accepted, such as a recording, determines the next proposals.
        """
        deadline = asyncio.get_running_loop().time() + limit_s
        while not self.specs.is_analysed(path) and self._task is not None:
            left = deadline - asyncio.get_running_loop().time()
            if left <= 0 or self._task.done():
                return
            # Not awaited: what cancels this does not cancel that.
            await asyncio.wait({self._task}, timeout=min(left, DEBOUNCE_S))

    async def _analyse_waiting(self) -> None:
        """Analyse one document after the other, as long as there is one to analyse.

        A thread cannot be stopped: two analyses at a time would only slow each other down.
        """
        await self._quiet()
        while path := next((spec for spec in self.specs.specs() if spec in self._waiting), None):
            generation = self.specs.generation
            try:
                analysis = await asyncio.to_thread(self.specs.analyse, path)
                if generation != self.specs.generation:
                    # Something has changed since: what is true now is shown.
                    await self._quiet()
                    continue
                self.specs.keep(analysis)
                self._publish(analysis)
            except Exception as error:  # a defect of one must not end the analyses of all others
                self.log(types.MessageType.Error, f"{path}: {type(error).__name__}: {error}")
            self._waiting.discard(path)
        self._waiting.clear()
        self._clear_others()

    async def _quiet(self) -> None:
        """Wait until nothing has changed for a moment."""
        generation = None
        while generation != self.specs.generation:
            generation = self.specs.generation
            await asyncio.sleep(DEBOUNCE_S)

    def log(self, kind: types.MessageType, message: str) -> None:
        """Write a line into the log of the editor."""
        self.window_log_message(types.LogMessageParams(kind, message))

    def _publish(self, analysis: Analysis) -> None:
        root = str(analysis.path)
        before = self._shown.get(root, {})
        self._shown[root] = diagnostics_by_file(analysis, self.positions_of)
        for file in {**before, **self._shown[root]}:
            self._send(file)

    def _clear_others(self) -> None:
        """Remove the diagnostics of specs that were closed, or are none any more."""
        for root in self._shown.keys() - {str(spec) for spec in self.specs.specs()}:
            for file in self._shown.pop(root):
                self._send(file)

    def _send(self, file: str) -> None:
        """Show what all open specs say of a file: several may extend it.

        The version is of the text that was analysed: a newer one is analysed first.
        """
        diagnostics: list[types.Diagnostic] = []
        for shown in self._shown.values():
            diagnostics += [each for each in shown.get(file, ()) if each not in diagnostics]
        document = self.specs.document(Path(file))
        name, version = (document.uri, document.version) if document is not None else ("", None)
        self.text_document_publish_diagnostics(
            types.PublishDiagnosticsParams(name or uri(file), diagnostics, version)
        )


def create_server() -> SpecLanguageServer:
    """Return a server with all its features."""
    server = SpecLanguageServer()
    _add_documents(server)
    _add_completion(server)
    _add_answers(server)
    return server


def path_of(document_uri: str) -> Path:
    """Return the path of a document; its URI if it is not on this machine."""
    parts = urlsplit(document_uri)
    is_local = parts.scheme == "file" and parts.netloc in {"", "localhost"}
    return Path(unquote(parts.path, errors="surrogateescape") if is_local else document_uri)


def _add_documents(server: SpecLanguageServer) -> None:
    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    def opened(params: types.DidOpenTextDocumentParams) -> None:
        server.update(params.text_document.uri)

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    def changed(params: types.DidChangeTextDocumentParams) -> None:
        server.update(params.text_document.uri)

    @server.feature(types.TEXT_DOCUMENT_DID_SAVE)
    def saved(_: types.DidSaveTextDocumentParams) -> None:
        server.files_changed()

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def closed(params: types.DidCloseTextDocumentParams) -> None:
        server.close(path_of(params.text_document.uri))

    @server.feature(types.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    def files_changed(_: types.DidChangeWatchedFilesParams) -> None:
        server.files_changed()


def _add_completion(server: SpecLanguageServer) -> None:
    options = types.CompletionOptions(trigger_characters=list(TRIGGERS))

    @server.feature(types.TEXT_DOCUMENT_COMPLETION, options)
    async def completed(params: types.CompletionParams) -> types.CompletionList:
        path = path_of(params.text_document.uri)
        await server.settled(path, MAX_WAIT_S)
        items = complete(
            server.specs.readable(path),
            server.positions_of(str(path)),
            params.position,
            _supports_snippets(server.client_capabilities),
        )
        return types.CompletionList(is_incomplete=False, items=items)


def _supports_snippets(client: types.ClientCapabilities) -> bool:
    document = client.text_document
    completion = document.completion if document is not None else None
    item = completion.completion_item if completion is not None else None
    return item is not None and bool(item.snippet_support)


Answer = Callable[[Analysis, TextPositions, Any], Any]
"""What is said of a spec: its analysis, the positions in its text, the parameters of a request."""


def _add_answers(server: SpecLanguageServer) -> None:
    """Requests about the text of a spec as it is now; about any other document nothing is said."""

    def answers(feature: str, options: Any = None) -> Callable[[Answer], None]:
        def register(answer: Answer) -> None:
            @server.feature(feature, options)
            async def answered(params: Any) -> Any:
                path = path_of(params.text_document.uri)
                document = server.specs.document(path)
                if document is None or not document.is_spec:
                    return None
                await server.settled(path)
                if server.specs.document(path) is not document:
                    return None  # the text has changed, and the editor asks again
                positions = server.positions_of(str(path))
                try:
                    return answer(server.specs.current(path), positions, params)
                except R2bspecError as error:
                    raise JsonRpcInvalidParams(message=str(error)) from error

        return register

    @answers(types.TEXT_DOCUMENT_HOVER)
    def hovered(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        return hover(analysis, positions, params.position)

    @answers(types.TEXT_DOCUMENT_DEFINITION)
    def defined(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        spans = definitions(analysis, positions.place(params.position))
        return [server.location(span) for span in spans]

    @answers(types.TEXT_DOCUMENT_REFERENCES)
    def referred(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        return [
            server.location(occurrence.span)
            for occurrence in references_at(analysis, positions.place(params.position))
            if params.context.include_declaration or not occurrence.is_definition
        ]

    @answers(types.TEXT_DOCUMENT_PREPARE_RENAME)
    def prepared(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        return positions.range(renamable(analysis, positions.place(params.position)).span)

    @answers(types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))
    def renamed(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        changes: dict[str, list[types.TextEdit]] = {}
        texts = rename(analysis, positions.place(params.position), params.new_name)
        for span, text in texts.items():
            location = server.location(span)
            changes.setdefault(location.uri, []).append(types.TextEdit(location.range, text))
        return types.WorkspaceEdit(changes=changes)

    kinds = types.CodeActionKind
    offered = types.CodeActionOptions([kinds.QuickFix, kinds.SourceFixAll])

    @answers(types.TEXT_DOCUMENT_CODE_ACTION, offered)
    def acted(analysis: Analysis, _: TextPositions, params: Any) -> Any:
        wanted = params.context.only
        possible = code_actions(analysis, server.positions_of, params.range)
        return [action for action in possible if not wanted or action.kind in wanted]

    @server.feature(CASES_REQUEST)
    async def listed_cases(params: Any) -> list[dict[str, Any]]:
        path = path_of(params.uri)
        text, unsaved = server.text_of(path), server.specs.unsaved()
        return await asyncio.to_thread(spec_cases, path, text, unsaved)
