"""The server: connects the requests of the protocol with the modules that answer them."""

from __future__ import annotations

import asyncio
import contextlib
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Final, cast

from lsprotocol import types
from pygls.exceptions import JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer
from pygls.uris import to_fs_path

from r2bspec._version import __version__
from r2bspec.diagnostics import Span
from r2bspec.language_server import actions
from r2bspec.language_server.actions import REQUEST as CASES
from r2bspec.language_server.actions import (
    SpecCase,
    code_actions,
    code_lenses,
    diagnostics_by_file,
    spec_cases,
    uri,
)
from r2bspec.language_server.analysis import Analysis, OpenSpecs
from r2bspec.language_server.completion import TRIGGERS, ClientCapabilities, complete
from r2bspec.language_server.document_views import (
    document_symbols,
    folding_ranges,
    hover,
    inlay_hints,
    selection_range,
)
from r2bspec.language_server.positions import TextPositions
from r2bspec.language_server.symbols import (
    RenameError,
    definitions,
    references_at,
    renamable,
    rename,
)
from r2bspec.language_server.transport import AnsweringProtocol, MessageInput
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES
from r2bspec.safe_io.safe_file import RefusedFileError, read_text

DEBOUNCE_S: Final = 0.005
"""Time without a change after which a text is analysed: editors may send what belongs together in
several notifications. Between two key presses is more, so that every one of them is shown."""

MAX_WAIT_S: Final = 0.5
"""Time that a completion waits for the analysis of the text; then an older one must do."""


_MAX_SHOWN: Final = 200
"""Characters of a URI that a message shows."""

_SUFFIXES: Final = {
    actions.PLAN: "json",
    actions.DRAW_GRAPH: "mmd",
    actions.SHOW_RESULT: "md",
}
"""The commands whose output is shown as a document, and the kind of it."""


class SpecLanguageServer(LanguageServer):
    """The server of one editor."""

    def __init__(self) -> None:
        super().__init__("r2bspec", __version__, protocol_cls=AnsweringProtocol)
        self.specs = OpenSpecs()
        self._task: asyncio.Task[None] | None = None
        self._waiting: set[Path] = set()
        self._published: dict[str, frozenset[str]] = {}
        self._running: set[asyncio.Task[None]] = set()

    def start_io(self, stdin: BinaryIO | None = None, stdout: BinaryIO | None = None) -> None:
        """Serve the editor that is at the other end of standard input and output."""
        super().start_io(cast("BinaryIO", MessageInput(stdin or sys.stdin.buffer)), stdout)

    def text_of(self, path: Path) -> str:
        """The text of a file: as it is open, or what is on disk; empty if there is none."""
        text = self.specs.text(path)
        if text is None:
            with contextlib.suppress(OSError, RefusedFileError):
                text = read_text(path, max_bytes=MAX_DOCUMENT_BYTES)
        return text or ""

    def positions_of(self, file: str) -> TextPositions:
        """The positions in a file: of its open text, or of what is on disk."""
        encoding = self.workspace.position_encoding
        name = str(getattr(encoding, "value", encoding) or "utf-16")
        return TextPositions(self.text_of(Path(file)), name)

    def location(self, span: Span) -> types.Location:
        """The location of a span."""
        return types.Location(uri(span.file), self.positions_of(span.file).range(span))

    @property
    def folder(self) -> Path:
        """The folder in which runs are started: that of the workspace."""
        folders = self.workspace.folders
        first = next(iter(folders.values()), None)
        root = to_fs_path(first.uri) if first is not None else self.workspace.root_path
        return Path(root) if root else Path.cwd()

    def change(self, path: Path, text: str) -> None:
        """Analyse a text soon, unless it changes again before."""
        self.specs.change(path, text)
        self.analyse_soon(path)

    def analyse_soon(self, path: Path | None = None) -> None:
        """Analyse the specs that a document belongs to, or all of them."""
        self._waiting.update(self.specs.specs() if path is None else self.specs.affected_by(path))
        if self._task is None or self._task.done():
            self._task = asyncio.ensure_future(self._analyse_waiting())

    async def settled(self, path: Path) -> None:
        """Wait until the newest text of a spec is analysed, but not longer than a user would.

        What has just been accepted, such as a recording, decides what is proposed next.
        """
        deadline = asyncio.get_running_loop().time() + MAX_WAIT_S
        while self._task is not None and not self.specs.is_analysed(path):
            left = deadline - asyncio.get_running_loop().time()
            if left <= 0 or self._task.done():
                return
            # Not awaited: a newer change cancels it.
            await asyncio.wait({self._task}, timeout=left)

    async def _analyse_waiting(self) -> None:
        """Analyse one document after the other, as long as there is one to analyse.

        A thread cannot be stopped: two analyses at a time would only slow each other down.
        """
        await self._quiet()
        while path := next((each for each in self.specs.specs() if each in self._waiting), None):
            generation = self.specs.generation
            try:
                analysis = await asyncio.to_thread(self.specs.analyse, path)
            except Exception:  # a defect of one analysis must not end those of all other texts
                self._waiting.discard(path)
                self._log(types.MessageType.Error, f"{path}: {traceback.format_exc()}")
                continue
            if generation != self.specs.generation:
                # Something has changed since: what is true now is shown.
                await self._quiet()
                continue
            self._waiting.discard(path)
            self.specs.keep(analysis)
            try:
                self._publish(analysis)
            except Exception:  # such as a name that no message can have
                self._log(types.MessageType.Error, f"{path}: {traceback.format_exc()}")
        self._waiting.clear()
        self._clear_others()

    async def _quiet(self) -> None:
        """Wait until nothing has changed for a moment."""
        generation = None
        while generation != self.specs.generation:
            generation = self.specs.generation
            await asyncio.sleep(DEBOUNCE_S)

    def _publish(self, analysis: Analysis) -> None:
        found = diagnostics_by_file(analysis, self.positions_of)
        before = self._published.get(str(analysis.path), frozenset())
        for file in before - found.keys():
            self._send(file, [])
        for file, diagnostics in found.items():
            others = [
                each
                for root, files in self._published.items()
                if root != str(analysis.path) and file in files
                for each in self._of_other(root, file)
            ]
            self._send(file, [*diagnostics, *(each for each in others if each not in diagnostics)])
        self._published[str(analysis.path)] = frozenset(found)

    def _of_other(self, root: str, file: str) -> list[types.Diagnostic]:
        """What another open spec that extends the same file says of it."""
        other = self.specs.latest(Path(root))
        return diagnostics_by_file(other, self.positions_of).get(file, []) if other else []

    def _clear_others(self) -> None:
        """Remove the diagnostics of specs that were closed, or are none any more."""
        open_now = {str(each) for each in self.specs.specs()}
        for root in self._published.keys() - open_now:
            for file in self._published.pop(root):
                if not any(file in files for files in self._published.values()):
                    self._send(file, [])

    def _send(self, file: str, diagnostics: list[types.Diagnostic]) -> None:
        """The version is of the text that was analysed: a newer one is analysed first."""
        document = self.workspace.text_documents.get(uri(file))
        self.text_document_publish_diagnostics(
            types.PublishDiagnosticsParams(
                uri(file), diagnostics, document.version if document else None
            )
        )

    def start_command(self, name: str, argv: list[str]) -> None:
        """Start a command line; its end is shown in the editor."""
        task = asyncio.ensure_future(self._run_command(name, argv))
        self._running.add(task)
        task.add_done_callback(self._running.discard)

    async def _run_command(self, name: str, argv: list[str]) -> None:
        log = partial(self._log, types.MessageType.Log)
        status, output = await actions.run_command(argv, self.folder, log)
        if name in _SUFFIXES and status == 0:
            self._show_text(name, output)
        else:
            lines = [each for each in output.splitlines() if each.strip()]
            for line in lines:
                log(line)
            kind = types.MessageType.Info if status == 0 else types.MessageType.Warning
            verdict = lines[0] if lines else f"exit status {status}"
            self.window_show_message(types.ShowMessageParams(kind, f"r2bspec: {verdict}"))
        self.specs.touch()
        self.analyse_soon()
        self.refresh_lenses()

    def refresh_lenses(self) -> None:
        """Let an editor that can do so ask for the lenses again: there may be a newer result."""
        workspace = self.client_capabilities.workspace
        lens = workspace.code_lens if workspace is not None else None
        if lens is not None and lens.refresh_support:
            self.workspace_code_lens_refresh(None)

    def _log(self, kind: types.MessageType, text: str) -> None:
        self.window_log_message(types.LogMessageParams(kind, text))

    def _show_text(self, name: str, text: str) -> None:
        """Show a text in the editor, or, without that ability, in its log."""
        window = self.client_capabilities.window
        if window is not None and window.show_document is not None:
            folder = tempfile.mkdtemp(prefix="r2bspec-plan-")
            file = Path(folder) / f"r2bspec.{_SUFFIXES[name]}"
            file.write_text(text, encoding="utf-8")
            self.window_show_document(types.ShowDocumentParams(file.as_uri(), take_focus=True))
        else:
            self._log(types.MessageType.Info, text)

    def stop_commands(self) -> None:
        """End the commands that still run."""
        for task in self._running:
            task.cancel()


def create_server() -> SpecLanguageServer:
    """A server with all its features; start it with ``start_io``."""
    server = SpecLanguageServer()
    _add_documents(server)
    _add_completion(server)
    _add_answers(server)
    _add_commands(server)
    return server


def _path(document_uri: str) -> Path:
    """The path of a document.

    Raises:
        JsonRpcInvalidParams: no file can have this name.
    """
    path = to_fs_path(document_uri) or document_uri
    if "\0" in path:
        raise JsonRpcInvalidParams(f"no file can have this name: {document_uri[:_MAX_SHOWN]}")
    return Path(path)


def _add_documents(server: SpecLanguageServer) -> None:
    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    def opened(params: types.DidOpenTextDocumentParams) -> None:
        server.change(_path(params.text_document.uri), params.text_document.text)

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    def changed(params: types.DidChangeTextDocumentParams) -> None:
        document = server.workspace.get_text_document(params.text_document.uri)
        server.change(_path(params.text_document.uri), document.source)

    @server.feature(types.TEXT_DOCUMENT_DID_SAVE)
    def saved(params: types.DidSaveTextDocumentParams) -> None:
        del params
        server.specs.touch()
        server.analyse_soon()

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def closed(params: types.DidCloseTextDocumentParams) -> None:
        server.specs.close(_path(params.text_document.uri))
        server.analyse_soon()

    @server.feature(types.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    def files_changed(params: types.DidChangeWatchedFilesParams) -> None:
        server.specs.touch()
        server.analyse_soon()
        if any(each.uri.endswith("/result.json") for each in params.changes):
            server.refresh_lenses()

    @server.feature(types.SHUTDOWN)
    def shut_down(params: None) -> None:
        del params
        server.stop_commands()


@contextlib.contextmanager
def _invalid_params() -> Iterator[None]:
    """What the user did wrong is an error of the request."""
    try:
        yield
    except ValueError as error:
        raise JsonRpcInvalidParams(str(error)) from error
    except RenameError as error:
        raise JsonRpcInvalidParams(
            f"{error}; {error.hint}" if error.hint else str(error)
        ) from error


def _add_completion(server: SpecLanguageServer) -> None:
    @server.feature(
        types.TEXT_DOCUMENT_COMPLETION,
        types.CompletionOptions(trigger_characters=list(TRIGGERS)),
    )
    async def completed(params: types.CompletionParams) -> types.CompletionList:
        path = _path(params.text_document.uri)
        await server.settled(path)
        items = complete(
            server.specs.latest_known(path),
            server.positions_of(str(path)),
            params.position,
            _completion_capabilities(server),
        )
        return types.CompletionList(is_incomplete=False, items=items)


def _completion_capabilities(server: SpecLanguageServer) -> ClientCapabilities:
    document = server.client_capabilities.text_document
    completion = document.completion if document is not None else None
    item = completion.completion_item if completion is not None else None
    return ClientCapabilities(
        snippets=bool(item is not None and item.snippet_support),
        # Editors whose snippets are not adjusted say so; most do it without a word.
        adjusts=completion is None or completion.insert_text_mode is not types.InsertTextMode.AsIs,
    )


Answer = Callable[[Analysis, TextPositions, Any], Any]
"""What is said of a spec: its analysis, the positions in its text, the parameters of a request."""

_CODE_ACTIONS: Final = types.CodeActionOptions(
    [
        types.CodeActionKind.QuickFix,
        types.CodeActionKind.RefactorRewrite,
        types.CodeActionKind.SourceFixAll,
    ]
)


def _add_answers(server: SpecLanguageServer) -> None:
    """Requests about the text of a spec as it is now; about any other document nothing is said."""

    def answers(feature: str, options: Any = None) -> Callable[[Answer], None]:
        def register(answer: Answer) -> None:
            @server.feature(feature, options)
            def answered(params: Any) -> Any:
                path = _path(params.text_document.uri)
                if path not in server.specs.specs():
                    return None
                return answer(server.specs.current(path), server.positions_of(str(path)), params)

        return register

    @answers(types.TEXT_DOCUMENT_HOVER)
    def hovered(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        return hover(analysis, positions, params.position)

    @answers(types.TEXT_DOCUMENT_INLAY_HINT)
    def hinted(analysis: Analysis, positions: TextPositions, _: Any) -> Any:
        return list(inlay_hints(analysis, positions))

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

    @answers(types.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
    def highlighted(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        return [
            types.DocumentHighlight(positions.range(occurrence.span))
            for occurrence in references_at(analysis, positions.place(params.position))
            if occurrence.span.file == str(analysis.path)
        ]

    @answers(types.TEXT_DOCUMENT_PREPARE_RENAME)
    def prepared(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        with _invalid_params():
            return positions.range(renamable(analysis, positions.place(params.position)).span)

    @answers(types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))
    def renamed(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        changes: dict[str, list[types.TextEdit]] = {}
        with _invalid_params():
            texts = rename(analysis, positions.place(params.position), params.new_name)
        for span, text in texts.items():
            location = server.location(span)
            changes.setdefault(location.uri, []).append(types.TextEdit(location.range, text))
        return types.WorkspaceEdit(changes=changes)

    @answers(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    def listed(analysis: Analysis, positions: TextPositions, _: Any) -> Any:
        return document_symbols(analysis, positions)

    @answers(types.TEXT_DOCUMENT_FOLDING_RANGE)
    def folded(analysis: Analysis, positions: TextPositions, _: Any) -> Any:
        return folding_ranges(analysis, positions)

    @answers(types.TEXT_DOCUMENT_SELECTION_RANGE)
    def selected(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        return [selection_range(analysis, positions, position) for position in params.positions]

    @answers(types.TEXT_DOCUMENT_CODE_ACTION, _CODE_ACTIONS)
    def acted(analysis: Analysis, _: TextPositions, params: Any) -> Any:
        kinds = [str(kind) for kind in params.context.only or ()]
        offered = code_actions(analysis, server.positions_of, params.range)
        return [action for action in offered if not kinds or str(action.kind) in kinds]

    @answers(types.TEXT_DOCUMENT_CODE_LENS)
    def lensed(analysis: Analysis, positions: TextPositions, _: Any) -> Any:
        return list(code_lenses(analysis, positions, server.folder))


def _add_commands(server: SpecLanguageServer) -> None:
    @server.feature(CASES)
    async def listed_cases(params: Any) -> list[SpecCase]:
        path = _path(str(params.uri))
        text, unsaved = server.text_of(path), server.specs.unsaved()
        return await asyncio.to_thread(spec_cases, path, text, unsaved)

    for name in actions.COMMANDS:
        server.command(name)(_starter(server, name))

    @server.command(actions.SHOW_RESULT)
    def show(folder: str) -> None:
        with _invalid_params():
            server.start_command(actions.SHOW_RESULT, actions.report_argv(folder))


def _starter(server: SpecLanguageServer, name: str) -> Callable[[Mapping[str, Any]], None]:
    def start(argument: Mapping[str, Any]) -> None:
        with _invalid_params():
            argv = actions.SpecCommand.from_argument(argument).argv(name)
            server.start_command(name, argv)

    return start
