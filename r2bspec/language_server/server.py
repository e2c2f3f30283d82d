"""The server: connects the requests of the protocol with the modules that answer them."""

from __future__ import annotations

import asyncio
import contextlib
import math
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote, urlsplit

from lsprotocol import types

from r2bspec._version import __version__
from r2bspec.diagnostics import Span
from r2bspec.language_server import actions, document_views, protocol
from r2bspec.language_server.actions import (
    SpecCase,
    SpecCommand,
    code_actions,
    code_lenses,
    diagnostics_by_file,
    spec_cases,
    uri,
)
from r2bspec.language_server.analysis import Analysis, OpenSpecs
from r2bspec.language_server.completion import TRIGGERS, ClientCapabilities, complete
from r2bspec.language_server.positions import ENCODINGS, TextPositions, edited
from r2bspec.language_server.protocol import Connection, RequestError, decoded, invalid_params
from r2bspec.language_server.symbols import definitions, references_at, renamable, rename
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES
from r2bspec.safe_io.private_files import process_folder
from r2bspec.safe_io.safe_file import RefusedFileError, read_text

DEBOUNCE_S: Final = 0.005
"""Time without a change after which a text is analysed: editors may send what belongs together in
several notifications. Between two key presses is more, so that every one of them is shown."""

MAX_WAIT_S: Final = 0.5
"""Time that a completion waits for the analysis of the text; then an older one must do."""

_SUFFIXES: Final = {
    actions.PLAN: "json",
    actions.DRAW_GRAPH: "mmd",
    actions.SHOW_RESULT: "md",
}
"""The commands whose output is shown as a document, and the kind of it."""


class SpecLanguageServer:
    """The server of one editor.

    Args:
        connection: to the editor.

    Attributes:
        abilities: of the editor.
        encoding: in which it counts characters.
        folders: of its workspace, the first one first.
    """

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.specs = OpenSpecs()
        self.abilities = protocol.Abilities()
        self.encoding = "utf-16"
        self.folders: list[Path] = []
        self._positions = TextPositions("")
        self._task: asyncio.Task[None] | None = None
        self._waiting: set[Path] = set()
        self._published: dict[str, frozenset[str]] = {}

    def initialize(self, params: protocol.InitializeParams) -> types.InitializeResult:
        """Take over what the editor is, and say what is answered."""
        self.abilities = params.capabilities
        general = params.capabilities.general
        encodings = general.position_encodings if general is not None else None
        self.encoding = next(
            (encoding for encoding in encodings or () if encoding in ENCODINGS), "utf-16"
        )
        root = [protocol.Named(params.root_uri)] if params.root_uri else []
        self._positions = TextPositions("", self.encoding)
        self.change_folders(params.workspace_folders or root)
        return types.InitializeResult(
            _capabilities(self.encoding, self.abilities),
            types.ServerInfo("r2bspec", __version__),
        )

    def change_folders(
        self, added: Sequence[protocol.Named], removed: Sequence[protocol.Named] = ()
    ) -> None:
        """Take over which folders of this machine the workspace has."""
        gone = {path_of(folder.uri) for folder in removed}
        folders_known = [folder for folder in self.folders if folder not in gone]
        folders_known += [path for folder in added if (path := path_of(folder.uri)).is_absolute()]
        self.folders = list(dict.fromkeys(folders_known))

    def text_of(self, path: Path) -> str:
        """The text of a file: as it is open, or what is on disk; empty if there is none."""
        text = self.specs.text(path)
        if text is None:
            with contextlib.suppress(OSError, RefusedFileError):
                text = read_text(path, max_bytes=MAX_DOCUMENT_BYTES)
        return text or ""

    def positions_of(self, file: str) -> TextPositions:
        """The positions in a file: of its open text, or of what is on disk."""
        text = self.text_of(Path(file))
        # A long text has many findings, each with its positions.
        if self._positions.text is not text:
            self._positions = TextPositions(text, self.encoding)
        return self._positions

    def location(self, span: Span) -> types.Location:
        """The location of a span."""
        return types.Location(uri(span.file), self.positions_of(span.file).range(span))

    @property
    def folder(self) -> Path:
        """The folder in which runs are started: that of the workspace."""
        return self.folders[0] if self.folders else Path.cwd()

    def change(self, path: Path, text: str, version: int | None = None, uri: str = "") -> None:
        """Analyse a text soon, unless it changes again before."""
        try:
            self.specs.change(path, text, version, uri)
        finally:
            self.analyse_soon(path)

    def edit(self, params: protocol.ChangeParams) -> None:
        """Change an open document; one whose changes cannot be made counts as closed.

        Of a text that is too long nothing is known that a part of it could be changed of.
        """
        document = params.text_document
        path = document_path(document.uri)
        before = self.specs.document(path)
        if before is None:
            raise invalid_params("a document that is not open cannot be changed")
        if before.is_too_long and all(
            content_change.range for content_change in params.content_changes
        ):
            return
        try:
            text = edited(before.text, params.content_changes, self.encoding)
        except RequestError:
            self.close(path)
            raise
        self.change(path, text, document.version, document.uri)

    def close(self, path: Path) -> None:
        """Forget a document; what is on disk counts again."""
        self.specs.close(path)
        self.analyse_soon()

    def files_changed(self) -> None:
        """Take notice that files on disk have changed."""
        self.specs.touch()
        self.analyse_soon()

    def analyse_soon(self, path: Path | None = None) -> None:
        """Analyse the specs that a document belongs to, or all of them."""
        self._waiting.update(self.specs.specs() if path is None else self.specs.affected_by(path))
        if self._task is None or self._task.done():
            self._task = self.connection.start("analysis", self._analyse_waiting())

    async def settled(self, path: Path, limit_s: float = math.inf) -> None:
        """Wait until the newest text of a spec is analysed, or nothing is left to analyse.

        What has just been accepted, such as a recording, decides what is proposed next.
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
            except Exception as error:  # a defect of one must not end the analyses of all others
                self._waiting.discard(path)
                self.connection.report(str(path), error)
                continue
            if generation != self.specs.generation:
                # Something has changed since: what is true now is shown.
                await self._quiet()
                continue
            self._waiting.discard(path)
            self.specs.keep(analysis)
            try:
                self._publish(analysis)
            except Exception as error:  # such as a name that no message can have
                self.connection.report(str(path), error)
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
                finding
                for root, files in self._published.items()
                if root != str(analysis.path) and file in files
                for finding in self._of_other(root, file)
            ]
            self._send(
                file, [*diagnostics, *(other for other in others if other not in diagnostics)]
            )
        self._published[str(analysis.path)] = frozenset(found)

    def _of_other(self, root: str, file: str) -> list[types.Diagnostic]:
        """What another open spec that extends the same file says of it."""
        other = self.specs.latest(Path(root))
        return diagnostics_by_file(other, self.positions_of).get(file, []) if other else []

    def _clear_others(self) -> None:
        """Remove the diagnostics of specs that were closed, or are none any more."""
        open_now = {str(spec) for spec in self.specs.specs()}
        for root in self._published.keys() - open_now:
            for file in self._published.pop(root):
                if not any(file in files for files in self._published.values()):
                    self._send(file, [])

    def _send(self, file: str, diagnostics: list[types.Diagnostic]) -> None:
        """The version is of the text that was analysed: a newer one is analysed first."""
        document = self.specs.document(Path(file))
        name, version = (document.uri, document.version) if document is not None else ("", None)
        self.connection.notify(
            types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS,
            types.PublishDiagnosticsParams(name or uri(file), diagnostics, version),
        )

    def start_command(self, name: str, argv: list[str]) -> None:
        """Start a command line; its end is shown in the editor."""
        self.connection.start(name, self._run_command(name, argv))

    async def _run_command(self, name: str, argv: list[str]) -> None:
        log = partial(self.connection.log, types.MessageType.Log)
        status, output = await actions.run_command(argv, self.folder, log)
        if name in _SUFFIXES and status == 0:
            self._show_text(name, output)
        else:
            lines = [output_line for output_line in output.splitlines() if output_line.strip()]
            for line in lines:
                log(line)
            kind = types.MessageType.Info if status == 0 else types.MessageType.Warning
            verdict = lines[0] if lines else f"exit status {status}"
            self.connection.notify(
                types.WINDOW_SHOW_MESSAGE, types.ShowMessageParams(kind, f"r2bspec: {verdict}")
            )
        self.files_changed()
        self.refresh_lenses()

    def refresh_lenses(self) -> None:
        """Let an editor that can do so ask for the lenses again: there may be a newer result."""
        workspace = self.abilities.workspace
        lens = workspace.code_lens if workspace is not None else None
        if lens is not None and lens.refresh_support:
            self.connection.ask(types.WORKSPACE_CODE_LENS_REFRESH)

    def _show_text(self, name: str, text: str) -> None:
        """Show a text in the editor, or, without that ability, in its log."""
        window = self.abilities.window
        shows = window.show_document if window is not None else None
        if shows is not None and shows.support:
            folder = tempfile.mkdtemp(dir=process_folder("shown"))
            file = Path(folder) / f"r2bspec.{_SUFFIXES[name]}"
            file.write_text(text, encoding="utf-8")
            self.connection.ask(
                types.WINDOW_SHOW_DOCUMENT,
                types.ShowDocumentParams(file.as_uri(), take_focus=True),
            )
        else:
            self.connection.log(types.MessageType.Info, text)


def create_server(defect: Callable[[BaseException], str]) -> SpecLanguageServer:
    """A server with all its features, whose connection serves an editor.

    Args:
        defect: says in a line what no code foresaw.
    """
    server = SpecLanguageServer(Connection(defect))
    _add_documents(server)
    _add_completion(server)
    _add_answers(server)
    _add_commands(server)
    return server


def path_of(document_uri: str) -> Path:
    """The path of a folder or a document; of one that is none of this machine, its URI.

    Raises:
        RequestError: no file can have this name.
    """
    try:
        parts = urlsplit(document_uri)
        path = unquote(parts.path, errors="surrogateescape")
    except ValueError as error:
        raise invalid_params(f"this is no URI: {error}") from None
    if parts.scheme != "file" or parts.netloc not in {"", "localhost"}:
        path = document_uri
    if "\0" in path:
        raise invalid_params("no file can have a name with a zero byte")
    return Path(path)


def document_path(document_uri: str) -> Path:
    """The path of a document, which has a name.

    Raises:
        RequestError: as `path_of`.
    """
    path = path_of(document_uri)
    if not path.name:
        raise invalid_params("a document has a name")
    return path


def _capabilities(encoding: str, abilities: protocol.Abilities) -> types.ServerCapabilities:
    """What is answered, for an editor with these abilities."""
    document = abilities.text_document
    renames = document.rename if document is not None else None
    return types.ServerCapabilities(
        position_encoding=encoding,
        text_document_sync=types.TextDocumentSyncOptions(
            open_close=True, change=types.TextDocumentSyncKind.Incremental, save=True
        ),
        completion_provider=types.CompletionOptions(trigger_characters=list(TRIGGERS)),
        hover_provider=True,
        definition_provider=True,
        references_provider=True,
        document_highlight_provider=True,
        document_symbol_provider=True,
        code_action_provider=types.CodeActionOptions(
            [
                types.CodeActionKind.QuickFix,
                types.CodeActionKind.RefactorRewrite,
                types.CodeActionKind.SourceFixAll,
            ]
        ),
        code_lens_provider=types.CodeLensOptions(),
        rename_provider=types.RenameOptions(prepare_provider=True)
        if renames is not None and renames.prepare_support
        else True,
        folding_range_provider=True,
        selection_range_provider=True,
        inlay_hint_provider=True,
        execute_command_provider=types.ExecuteCommandOptions(
            [*actions.COMMANDS, actions.SHOW_RESULT]
        ),
        workspace=types.WorkspaceOptions(
            types.WorkspaceFoldersServerCapabilities(supported=True, change_notifications=True)
        ),
    )


def _add_documents(server: SpecLanguageServer) -> None:
    on = server.connection.on
    on(types.INITIALIZE, protocol.InitializeParams)(server.initialize)
    on(types.TEXT_DOCUMENT_DID_CHANGE, protocol.ChangeParams)(server.edit)

    @on(types.TEXT_DOCUMENT_DID_OPEN, protocol.OpenParams)
    def opened(params: protocol.OpenParams) -> None:
        document = params.text_document
        server.change(document_path(document.uri), document.text, document.version, document.uri)

    @on(types.TEXT_DOCUMENT_DID_SAVE)
    def saved(_: None) -> None:
        server.files_changed()

    @on(types.TEXT_DOCUMENT_DID_CLOSE, protocol.DocumentParams)
    def closed(params: protocol.DocumentParams) -> None:
        server.close(document_path(params.text_document.uri))

    @on(types.WORKSPACE_DID_CHANGE_WATCHED_FILES, protocol.FileParams)
    def files_changed(params: protocol.FileParams) -> None:
        server.files_changed()
        if any(change.uri.endswith("/result.json") for change in params.changes):
            server.refresh_lenses()

    @on(types.WORKSPACE_DID_CHANGE_WORKSPACE_FOLDERS, protocol.FolderParams)
    def folders_changed(params: protocol.FolderParams) -> None:
        server.change_folders(params.event.added, params.event.removed)


def _add_completion(server: SpecLanguageServer) -> None:
    @server.connection.on(types.TEXT_DOCUMENT_COMPLETION, protocol.PositionParams)
    async def completed(params: protocol.PositionParams) -> types.CompletionList:
        path = document_path(params.text_document.uri)
        document = server.specs.document(path)
        if document is not None and document.is_too_long:
            return types.CompletionList(is_incomplete=False, items=[])
        await server.settled(path, MAX_WAIT_S)
        items = complete(
            server.specs.latest_known(path),
            server.positions_of(str(path)),
            params.position,
            _completion_capabilities(server.abilities),
        )
        return types.CompletionList(is_incomplete=False, items=items)


def _completion_capabilities(abilities: protocol.Abilities) -> ClientCapabilities:
    document = abilities.text_document
    completion = document.completion if document is not None else None
    item = completion.completion_item if completion is not None else None
    return ClientCapabilities(
        snippets=item is not None and item.snippet_support,
        # Editors whose snippets are not adjusted say so; most do it without a word.
        adjusts=completion is None or completion.insert_text_mode != types.InsertTextMode.AsIs,
    )


Answer = Callable[[Analysis, TextPositions, Any], Any]
"""What is said of a spec: its analysis, the positions in its text, the parameters of a request."""


def _add_answers(server: SpecLanguageServer) -> None:
    """Requests about the text of a spec as it is now; about any other document nothing is said."""

    def answers(feature: str, kind: Any = protocol.PositionParams) -> Callable[[Answer], None]:
        def register(answer: Answer) -> None:
            @server.connection.on(feature, kind)
            async def answered(params: Any) -> Any:
                path = document_path(params.text_document.uri)
                document = server.specs.document(path)
                if document is None or not document.is_spec or document.is_too_long:
                    return None
                await server.settled(path)
                if server.specs.document(path) is not document:
                    raise RequestError(types.LSPErrorCodes.ContentModified, "the text has changed")
                return answer(server.specs.current(path), server.positions_of(str(path)), params)

        return register

    @answers(types.TEXT_DOCUMENT_HOVER)
    def hovered(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        return document_views.hover(analysis, positions, params.position)

    @answers(types.TEXT_DOCUMENT_INLAY_HINT, protocol.RangeParams)
    def hinted(analysis: Analysis, positions: TextPositions, _: Any) -> Any:
        return list(document_views.inlay_hints(analysis, positions))

    @answers(types.TEXT_DOCUMENT_DEFINITION)
    def defined(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        spans = definitions(analysis, positions.place(params.position))
        return [server.location(span) for span in spans]

    @answers(types.TEXT_DOCUMENT_REFERENCES, protocol.ReferenceParams)
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
        return positions.range(renamable(analysis, positions.place(params.position)).span)

    @answers(types.TEXT_DOCUMENT_RENAME, protocol.RenameParams)
    def renamed(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        changes: dict[str, list[types.TextEdit]] = {}
        texts = rename(analysis, positions.place(params.position), params.new_name)
        for span, text in texts.items():
            location = server.location(span)
            changes.setdefault(location.uri, []).append(types.TextEdit(location.range, text))
        return types.WorkspaceEdit(changes=changes)

    @answers(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL, protocol.DocumentParams)
    def listed(analysis: Analysis, positions: TextPositions, _: Any) -> Any:
        return document_views.document_symbols(analysis, positions)

    @answers(types.TEXT_DOCUMENT_FOLDING_RANGE, protocol.DocumentParams)
    def folded(analysis: Analysis, positions: TextPositions, _: Any) -> Any:
        return document_views.folding_ranges(analysis, positions)

    @answers(types.TEXT_DOCUMENT_SELECTION_RANGE, protocol.SelectionParams)
    def selected(analysis: Analysis, positions: TextPositions, params: Any) -> Any:
        return [
            document_views.selection_range(analysis, positions, position)
            for position in params.positions
        ]

    @answers(types.TEXT_DOCUMENT_CODE_ACTION, protocol.ActionParams)
    def acted(analysis: Analysis, _: TextPositions, params: Any) -> Any:
        kinds = params.context.only
        offered = code_actions(analysis, server.positions_of, params.range)
        return [action for action in offered if not kinds or action.kind in kinds]

    @answers(types.TEXT_DOCUMENT_CODE_LENS, protocol.DocumentParams)
    def lensed(analysis: Analysis, positions: TextPositions, _: Any) -> Any:
        return list(code_lenses(analysis, positions, server.folder))


def _add_commands(server: SpecLanguageServer) -> None:
    @server.connection.on(actions.REQUEST, protocol.Named)
    async def listed_cases(params: protocol.Named) -> list[SpecCase]:
        path = document_path(params.uri)
        text, unsaved = server.text_of(path), server.specs.unsaved()
        return await asyncio.to_thread(spec_cases, path, text, unsaved)

    @server.connection.on(types.WORKSPACE_EXECUTE_COMMAND, protocol.CommandParams)
    def started(params: protocol.CommandParams) -> None:
        if len(params.arguments) != 1:
            raise invalid_params("a command has one argument")
        if params.command == actions.SHOW_RESULT:
            argv = actions.report_argv(decoded(params.arguments[0], str))
        elif params.command in actions.COMMANDS:
            argv = decoded(params.arguments[0], SpecCommand).argv(params.command)
        else:
            raise invalid_params("there is no such command")
        server.start_command(params.command, argv)
