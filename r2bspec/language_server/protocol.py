"""The connection to an editor: JSON-RPC, so that whatever arrives is answered as the protocol says.

`MessageInput` finds the messages in what arrives, `Message.of` sees whether one can be carried out
at all, and `Connection` carries it out: there every error becomes an answer. What is no message is
answered once, and passed over until the next one begins.

What an editor sends, as far as it is read, and what is wrong with it. Shapes, ranges and counts
are checked by decoding. Only what is named here is made in memory: everything else of a message is
passed over. What the server sends has the types of lsprotocol.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import json
import re
import threading
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from enum import Enum
from io import BufferedReader
from typing import Annotated, Any, BinaryIO, Final, Literal, TypeVar

import msgspec
from lsprotocol import types
from lsprotocol.converters import get_converter
from msgspec import Meta

from r2bspec.diagnostics.plain_text import plain
from r2bspec.errors import R2bspecError
from r2bspec.safe_io import limits

Integer = Annotated[int, Meta(ge=-(2**31), le=2**31 - 1)]
Unsigned = Annotated[int, Meta(ge=0, le=2**31 - 1)]
# Wider than the protocol's: it is only sent back.
Identifier = (
    Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)]
    | Annotated[str, Meta(max_length=limits.MAX_NAME_CHARACTERS)]
)
Id = int | str
T = TypeVar("T")
_SOME = Meta(max_length=limits.MAX_EDITOR_ITEMS)


class RequestError(Exception):
    """What is wrong with a message, as the answer says it.

    Attributes:
        code: of the protocol.
        id: of the message, where it is known.
    """

    def __init__(self, code: int, message: str, identifier: Id | None = None) -> None:
        super().__init__(message)
        self.code = int(code)
        self.id = identifier


def invalid_params(message: str) -> RequestError:
    """What a request is about cannot be."""
    return RequestError(types.ErrorCodes.InvalidParams, message)


class Received(msgspec.Struct, rename="camel"):
    """A part of a message."""


class Position(Received):
    """A place in a text: of a line, and of a character in units of the negotiated encoding."""

    line: Unsigned
    character: Unsigned


class Range(Received):
    """From one place to another."""

    start: Position
    end: Position


class Named(Received):
    """A document, or a folder of the workspace, by its URI."""

    uri: str


class DocumentParams(Received):
    """A request about a document."""

    text_document: Named


class PositionParams(DocumentParams):
    """A request about a place in a document."""

    position: Position


class ReferenceContext(Received):
    """Which places of a name are wanted."""

    include_declaration: bool


class ReferenceParams(PositionParams):
    """A request for the places of the name at a place."""

    context: ReferenceContext


class RenameParams(PositionParams):
    """A request to rename what is at a place."""

    new_name: str


class RangeParams(DocumentParams):
    """A request about a part of a document."""

    range: Range


class ActionContext(Received):
    """Which kinds of actions are wanted; None for all."""

    only: Annotated[list[str], _SOME] | None = None


class ActionParams(RangeParams):
    """A request for what can be done about a part of a document."""

    context: ActionContext


class SelectionParams(DocumentParams):
    """A request for the selections around places."""

    positions: Annotated[list[Position], Meta(max_length=limits.MAX_EDITOR_CURSORS)]


class OpenedDocument(Named):
    """A document with its text."""

    version: Integer
    text: str


class OpenParams(Received):
    """A document is opened."""

    text_document: OpenedDocument


class Change(Received):
    """A new text in a range, or, without one, of the whole document."""

    text: str
    range: Range | None = None


class ChangedDocument(Named):
    """The version of a document after its changes."""

    version: Integer | None = None


class ChangeParams(Received):
    """A document is changed, by one change after the other."""

    text_document: ChangedDocument
    content_changes: Annotated[list[Change], _SOME]


class FileParams(Received):
    """Files on disk have changed."""

    changes: Annotated[list[Named], _SOME]


class FolderChanges(Received):
    """Folders that the workspace has now, and that it no longer has."""

    added: Annotated[list[Named], _SOME]
    removed: Annotated[list[Named], _SOME]


class FolderParams(Received):
    """The folders of the workspace have changed."""

    event: FolderChanges


class CancelParams(Received):
    """A request is not wanted any more."""

    id: Identifier


class CommandParams(Received):
    """A command, and its arguments as they were sent."""

    command: str
    arguments: Annotated[list[msgspec.Raw], _SOME] = []


class ShowDocument(Received):
    """Whether the editor opens documents that the server names."""

    support: bool = False


class WindowAbilities(Received):
    """What the window of the editor can do."""

    show_document: ShowDocument | None = None


class CompletionItemAbilities(Received):
    """Whether the editor understands placeholders."""

    snippet_support: bool = False


class CompletionAbilities(Received):
    """What the editor does with a proposal.

    Attributes:
        insert_text_mode: 1 if it leaves the lines of a text as they are; it indents them otherwise.
    """

    completion_item: CompletionItemAbilities | None = None
    insert_text_mode: Integer | None = None


class RenameAbilities(Received):
    """Whether the editor asks what can be renamed before it does so."""

    prepare_support: bool = False


class DocumentAbilities(Received):
    """What the editor can do in a document."""

    rename: RenameAbilities | None = None
    completion: CompletionAbilities | None = None


class LensAbilities(Received):
    """Whether the editor asks again for lenses when it is told to."""

    refresh_support: bool = False


class WorkspaceAbilities(Received):
    """What the editor can do in a workspace."""

    code_lens: LensAbilities | None = None


class GeneralAbilities(Received):
    """The units in which the editor can count characters, the best first."""

    position_encodings: Annotated[list[str], _SOME] | None = None


class Abilities(Received):
    """What the editor can do."""

    general: GeneralAbilities | None = None
    window: WindowAbilities | None = None
    text_document: DocumentAbilities | None = None
    workspace: WorkspaceAbilities | None = None


class InitializeParams(Received):
    """What the editor is, and the folders that it has open."""

    capabilities: Abilities
    workspace_folders: Annotated[list[Named], _SOME] | None = None
    root_uri: str | None = None


def decoded(value: msgspec.Raw, kind: type[T]) -> T:
    """A part of a message, of a type.

    Raises:
        RequestError: it is not of this type.
    """
    try:
        return msgspec.json.decode(value, type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise invalid_params(str(error)) from None


_MAX_SHOWN: Final = 300
"""Characters of what is said about an error: parts of a message may be in it."""

_NAME: Final = re.compile(rb"Content-Length", re.IGNORECASE)
_NAME_BYTES: Final = len(b"Content-Length")
_LENGTH: Final = re.compile(
    rb"Content-Length[ \t]*:[ \t]*(?:0*([0-9]{1,9})|[^\r\n]*?)[ \t]*\r?\n\Z", re.IGNORECASE
)
_MAX_FIELD_BYTES: Final = 64
"""With a length that is possible."""
_FIELD: Final = re.compile(rb"[!-9;-~]++[ \t]*:")
# Escapes up to half of a pair of surrogates, and that half, if there is one.
_LONE_SURROGATE: Final = re.compile(
    rb"((?:[^\\]++|\\[^u]|\\u(?![dD][89a-fA-F])|\\u[dD][89abAB]..\\u[dD][c-fC-F]..)*+)(\\u....)?"
)

Handler = Callable[[Any], Any]


class MessageInput:
    """The messages in a stream of bytes; lines of headers may also end with a line feed only.

    Args:
        stream: what the editor writes.
    """

    def __init__(self, stream: BufferedReader) -> None:
        self._stream = stream
        self._is_lost = False

    def read(self) -> bytes | None:
        """The body of the next message; None at the end.

        A header is found, too, on the line of a body that is longer than was said: JSON has no line
        break inside its texts, so that it cannot be a part of one.

        Raises:
            RequestError: what arrives is no message; once, until the next message.
        """
        size, header_bytes, beginning = -1, 0, b""
        while line := self._next_line(size < 0, is_first=not header_bytes):
            length = _LENGTH.search((beginning + line)[-_MAX_FIELD_BYTES:])
            beginning = b"" if line.endswith(b"\n") else line[-_MAX_FIELD_BYTES:]
            if length is not None:
                size = int(length[1] or -1)
                header_bytes = 0 if self._is_lost else header_bytes
            if line in {b"\n", b"\r\n"}:
                if size >= 0:
                    body = self._stream.read(size)
                    self._is_lost = False
                    return body if len(body) == size else None
                is_wrong = header_bytes > 0
            else:
                header_bytes += len(line)
                is_possible = 0 <= size <= limits.MAX_EDITOR_MESSAGE_BYTES
                is_field = is_possible if length is not None else _FIELD.match(line)
                is_wrong = not is_field or header_bytes > limits.MAX_EDITOR_HEADER_BYTES
            if is_wrong:
                size, header_bytes = -1, 0
                if not self._is_lost:
                    self._is_lost = True
                    raise RequestError(
                        types.ErrorCodes.ParseError,
                        "this is no message, and passed over: a header has at most "
                        f"{limits.MAX_EDITOR_HEADER_BYTES:,} bytes, among them a Content-Length of "
                        f"at most {limits.MAX_EDITOR_MESSAGE_BYTES:,}",
                    )
        return None

    def _next_line(self, needs_length: bool, *, is_first: bool) -> bytes:
        """The next line; after what was no message, one that may have the length it needs."""
        while needs_length and (self._is_lost or is_first):
            waiting = self._stream.peek()
            if not self._is_lost:
                # Empty lines between two messages: each by itself would take a microsecond.
                if empty := len(waiting) - len(waiting.lstrip(b"\r\n")):
                    self._stream.read(empty)
                    continue
                break
            found = _NAME.search(waiting)
            # The name may have arrived in part.
            passed = found.start() if found is not None else len(waiting) - _NAME_BYTES
            if passed <= 0:
                break
            self._stream.read(passed)
        return self._stream.readline(limits.MAX_EDITOR_HEADER_BYTES)


class _ReadAhead:
    """What arrives, read in a thread that nobody waits for: a signal ends the server meanwhile."""

    def __init__(self, incoming: MessageInput) -> None:
        self._incoming = incoming
        self._arrived: deque[bytes | Exception | None] = deque()
        self._waiting_bytes = 0
        self._room = threading.Condition()
        self._some = asyncio.Event()
        self._is_waiting = False
        loop = asyncio.get_running_loop()
        threading.Thread(target=self._read_all, args=(loop,), daemon=True).start()

    @property
    def is_idle(self) -> bool:
        """Whether everything that has arrived is begun."""
        return self._is_waiting and not self._arrived

    def _read_all(self, loop: asyncio.AbstractEventLoop) -> None:
        item: bytes | Exception | None = b""
        while isinstance(item, bytes | RequestError):
            try:
                item = self._incoming.read()
            except Exception as error:
                item = error
            with self._room:
                self._room.wait_for(lambda: self._waiting_bytes <= _MAX_WAITING_BYTES)
                self._arrived.append(item)
                self._waiting_bytes += _size(item)
            if not self._some.is_set():
                with contextlib.suppress(RuntimeError):  # the server has ended
                    loop.call_soon_threadsafe(self._some.set)

    async def next(self) -> bytes | None:
        """The body of the next message; None at the end.

        Raises:
            RequestError: as `MessageInput.read`.
        """
        while not self._arrived:
            self._some.clear()
            if not self._arrived:
                self._is_waiting = True
                await self._some.wait()
                self._is_waiting = False
        with self._room:
            item = self._arrived.popleft()
            self._waiting_bytes -= _size(item)
            self._room.notify()
        if isinstance(item, Exception):
            raise item
        return item


_MAX_WAITING_BYTES: Final = 1_000_000


def _size(item: bytes | Exception | None) -> int:
    return 1_000 + len(item) if isinstance(item, bytes) else 1_000


class _Fields(msgspec.Struct, frozen=True):
    """What a message has, not decoded."""

    jsonrpc: msgspec.Raw = msgspec.Raw(b"null")
    id: msgspec.Raw = msgspec.Raw(b"")
    method: msgspec.Raw = msgspec.Raw(b"null")
    params: msgspec.Raw = msgspec.Raw(b"{}")
    result: msgspec.Raw = msgspec.Raw(b"")
    error: msgspec.Raw = msgspec.Raw(b"")


class Message(msgspec.Struct, frozen=True):
    """A request, or, without an id, a notification.

    Attributes:
        params: as they were sent; of UTF-8, and well-formed.
    """

    method: str
    params: msgspec.Raw
    id: Id | None

    @classmethod
    def of(cls, body: bytes) -> Message | None:
        """The message with a body; None for the answer to a request of the server.

        Half a pair of surrogates, which editors send of a character that is cut in two, is replaced
        by a character of the same length.

        Raises:
            RequestError: it is none.
        """
        try:
            body.decode()
            if b"\\u" in body:
                body = _LONE_SURROGATE.sub(
                    lambda found: found[1] + (b"\\ufffd" if found[2] else b""), body
                )
            fields = msgspec.json.decode(body, type=_Fields)
        except UnicodeDecodeError as error:
            wrong = f"the message is not UTF-8 (byte {error.start})"
            raise RequestError(types.ErrorCodes.ParseError, wrong) from None
        except msgspec.ValidationError as error:
            raise RequestError(types.ErrorCodes.InvalidRequest, str(error)) from None
        except msgspec.DecodeError as error:
            raise RequestError(types.ErrorCodes.ParseError, str(error)) from None
        except RecursionError:
            wrong = "the message is nested too deeply"
            raise RequestError(types.ErrorCodes.ParseError, wrong) from None
        has_id = bool(bytes(fields.id))
        if has_id and (bytes(fields.result) or bytes(fields.error)):
            return None
        identifier: Id | None = None
        try:
            if has_id:
                identifier = msgspec.json.decode(fields.id, type=Identifier)
            msgspec.json.decode(fields.jsonrpc, type=Literal["2.0"])
            method = msgspec.json.decode(fields.method, type=str)
        except msgspec.DecodeError:
            wrong = "a request has 'jsonrpc' \"2.0\", a 'method', and a text or an integer as 'id'"
            raise RequestError(types.ErrorCodes.InvalidRequest, wrong, identifier) from None
        return cls(method, fields.params, identifier)


class _Phase(Enum):
    """What the editor has asked for: each value is why something else is not done in it."""

    NEW = (types.ErrorCodes.ServerNotInitialized, "the first request is 'initialize'")
    INITIALIZED = (types.ErrorCodes.InvalidRequest, "the server is initialized already")
    SHUT_DOWN = (types.ErrorCodes.InvalidRequest, "the server is shut down")


class Connection:
    """One editor: its messages are carried out in their order, and each request is answered.

    Args:
        defect: says in a line what no code foresaw.
    """

    def __init__(self, defect: Callable[[BaseException], str]) -> None:
        self._defect = defect
        self._handlers: dict[str, tuple[Any, Handler]] = {}
        self._phase = _Phase.NEW
        self._tasks: set[asyncio.Task[None]] = set()
        self._requests: dict[Id, asyncio.Task[None]] = {}
        self._incoming: _ReadAhead | None = None
        self._output: BinaryIO | None = None
        self._last_id = 0
        self._converter = get_converter()
        self.on(types.CANCEL_REQUEST, CancelParams)(self._cancel)
        self.on(types.SHUTDOWN)(lambda _: None)

    def on(self, method: str, kind: Any = None) -> Callable[[Handler], Handler]:
        """Register what answers a method: a function, or a coroutine function, of its parameters.

        What it raises is the answer: a `RequestError`, or, of what the user did wrong, any
        `R2bspecError`.

        Args:
            method: of the protocol.
            kind: the type of the parameters; without one they are None, whatever was sent.
        """

        def register(handler: Handler) -> Handler:
            self._handlers[method] = kind, handler
            return handler

        return register

    async def serve(self, stdin: BufferedReader, stdout: BinaryIO) -> bool:
        """Carry out what arrives, up to 'exit' or the end; whether 'shutdown' came before."""
        self._output = stdout
        self._incoming = _ReadAhead(MessageInput(stdin))
        while True:
            try:
                body = await self._incoming.next()
                message = Message.of(body) if body is not None else None
            except RequestError as error:
                self._send_error(error.id, error)
                continue
            if body is None or (message is not None and message.method == types.EXIT):
                break
            if message is not None:
                self._begin(message)
                await asyncio.sleep(0)  # what has begun goes as far as it needs not wait
        await self._end()
        return self._phase is _Phase.SHUT_DOWN

    def _begin(self, message: Message) -> None:
        """Carry out a message, or begin what waits for something."""
        try:
            result = self._call(message)
            if inspect.isawaitable(result):
                task = self.start(message.method, self._finish(message, result))
                if message.id is not None:
                    self._requests[message.id] = task
            elif message.id is not None:
                self._send(id=message.id, result=result)
        except Exception as error:  # a defect of one answer must not end all others
            self._fail(message, error)

    def start(self, about: str, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Start what goes on beside the messages: cancelled at the end, its error is logged."""
        task = asyncio.ensure_future(self._watched(about, work))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def _watched(self, about: str, work: Coroutine[Any, Any, None]) -> None:
        try:
            await work
        except Exception as error:
            self.report(about, error)

    async def _end(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _finish(self, message: Message, work: Awaitable[Any]) -> None:
        try:
            result = await work
            if message.id is not None:
                self._send(id=message.id, result=result)
        except asyncio.CancelledError:
            self._fail(message, RequestError(types.LSPErrorCodes.RequestCancelled, "cancelled"))
        except Exception as error:
            self._fail(message, error)
        finally:
            if message.id is not None:
                self._requests.pop(message.id, None)

    def _fail(self, message: Message, error: Exception) -> None:
        if message.id is not None:
            self._send_error(message.id, error)
        elif message.method in self._handlers:  # what is not known may be left out
            self.report(message.method, error)

    def _call(self, message: Message) -> Any:
        is_first = message.method == types.INITIALIZE
        if self._phase is not (_Phase.NEW if is_first else _Phase.INITIALIZED):
            raise RequestError(*self._phase.value)
        if message.method not in self._handlers:
            wrong = f"there is no method {message.method[:_MAX_SHOWN]!r}"
            raise RequestError(types.ErrorCodes.MethodNotFound, wrong)
        kind, handler = self._handlers[message.method]
        result = handler(decoded(message.params, kind) if kind is not None else None)
        if is_first:
            self._phase = _Phase.INITIALIZED
        elif message.method == types.SHUTDOWN:
            self._phase = _Phase.SHUT_DOWN
            for task in self._tasks:
                task.cancel()
        return result

    def _cancel(self, params: CancelParams) -> None:
        if (task := self._requests.get(params.id)) is not None:
            task.cancel()

    def _described(self, error: BaseException) -> tuple[int, str]:
        """The code of an error, and what is said about it in one line."""
        if isinstance(error, RequestError):
            code, text = error.code, str(error)
        elif isinstance(error, R2bspecError):
            code = types.ErrorCodes.InvalidParams.value
            text = f"{error}; {error.hint}" if error.hint else str(error)
        else:
            code, text = types.ErrorCodes.InternalError.value, self._defect(error)
        return code, " ".join(plain(text).split())[:_MAX_SHOWN]

    def report(self, about: str, error: BaseException) -> None:
        """Log an error that belongs to no request, in one line."""
        self.log(types.MessageType.Error, f"{about[:_MAX_SHOWN]}: {self._described(error)[1]}")

    def log(self, kind: types.MessageType, text: str) -> None:
        """Write a text to the log that the editor keeps."""
        self.notify(types.WINDOW_LOG_MESSAGE, types.LogMessageParams(kind, text))

    def notify(self, method: str, params: Any) -> None:
        """Send a notification; none before the editor has said what it is, as the protocol says."""
        if self._phase is not _Phase.NEW:
            self._send(method=method, params=params)

    def ask(self, method: str, params: Any = None) -> None:
        """Send a request whose answer does not matter."""
        self._last_id += 1
        self._send(id=self._last_id, method=method, **({"params": params} if params else {}))

    def _send_error(self, identifier: Id | None, error: BaseException) -> None:
        code, text = self._described(error)
        self._send(id=identifier, error={"code": code, "message": text})

    def _send(self, **fields: Any) -> None:
        """Send a message; to an editor that has ended, nothing."""
        if self._output is None:
            return
        body = json.dumps(
            {"jsonrpc": "2.0", **fields},
            default=self._converter.unstructure,
            ensure_ascii=False,
            separators=(",", ":"),
        ).encode("utf-8", "replace")
        try:
            self._output.write(b"Content-Length: %d\r\n\r\n" % len(body) + body)
            self._output.flush()
        except BrokenPipeError:
            self._output = None
