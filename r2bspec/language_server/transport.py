"""The connection to an editor: whatever arrives is answered or passed over, and never the end.

pygls reads headers that end with CRLF only, takes any length for true, and leaves a request without
an answer that does not fit the types of the protocol. `MessageInput` mends the headers,
`AnsweringProtocol` the answers.
"""

from __future__ import annotations

import re
from typing import Any, BinaryIO, Final

from pygls.exceptions import JsonRpcException, JsonRpcInvalidRequest
from pygls.protocol import LanguageServerProtocol

from r2bspec.report.output import echo
from r2bspec.safe_io.limits import MAX_EDITOR_LINE_BYTES, MAX_EDITOR_MESSAGE_BYTES

_LENGTH: Final = re.compile(rb"Content-Length[ \t]*:[ \t]*0*([0-9]+)[ \t]*\r?\n\Z", re.IGNORECASE)


class MessageInput:
    """Standard input with headers as pygls reads them; lines may also end with LF only.

    The header of a message that is too long is left out, so that its body, if it comes, is passed
    over like anything that is no header. The next header is then found even if it follows the body
    on the same line.

    Args:
        stream: what the editor writes.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def readline(self) -> bytes:
        """The next line, or a part of a long one; empty at the end."""
        line = self._stream.readline(MAX_EDITOR_LINE_BYTES)
        length = _LENGTH.search(line)
        if length is None:
            return line
        digits = length[1]
        if (
            len(digits) > len(str(MAX_EDITOR_MESSAGE_BYTES))
            or int(digits) > MAX_EDITOR_MESSAGE_BYTES
        ):
            echo(
                f"r2bspec lsp: a message of {digits[:20].decode()}"
                f"{'...' if len(digits) > 20 else ''} bytes is passed over; "
                f"at most {MAX_EDITOR_MESSAGE_BYTES} are read",
                err=True,
            )
            return b"Passed-Over: 1\r\n"
        return b"Content-Length: %s\r\n" % digits

    def read(self, size: int) -> bytes:
        """The body of a message."""
        return self._stream.read(size)


class AnsweringProtocol(LanguageServerProtocol):
    """Answers also requests that are none: with the error of the protocol that they have."""

    def structure_message(self, data: dict[str, Any]) -> Any:
        """The message of a JSON object; None for a request that was answered with its error."""
        try:
            return super().structure_message(data)
        except JsonRpcException as error:
            if "id" not in data or "method" not in data:
                raise
            self._send_response(data["id"], None, error.to_response_error())
            return None

    def handle_message(self, message: Any) -> None:
        """Carry a message out; a request without a version gets its error."""
        if message is None:
            return
        if not hasattr(message, "jsonrpc"):
            identifier = message.get("id") if isinstance(message, dict) else None
            if isinstance(identifier, int | str):
                error = JsonRpcInvalidRequest().to_response_error()
                self._send_response(identifier, None, error)
            return
        super().handle_message(message)
