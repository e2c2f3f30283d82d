"""Promise: the language server answers everything, and nothing that it reads ends it."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

_WAIT_S = 60.0
SPEC = "r2bspec: 1\nname: 5\n"


class Editor:
    """A server, and what an editor writes to it byte by byte."""

    def __init__(self) -> None:
        # A pipe that nobody reads would fill up with the log of the server.
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  closed by `close`
        self.process = subprocess.Popen(
            [sys.executable, "-m", "r2bspec", "lsp"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
        )
        self._pending = b""
        self._last_id = 0

    def write(self, data: bytes) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(data)
        self.process.stdin.flush()

    def send(self, message: Any) -> None:
        body = json.dumps(message).encode()
        self.write(f"Content-Length: {len(body)}\r\n\r\n".encode() + body)

    def notify(self, method: str, **params: Any) -> None:
        self.send({"jsonrpc": "2.0", "method": method, "params": params})

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        """The answer to a request: with a result or an error."""
        self._last_id += 1
        self.send({"jsonrpc": "2.0", "id": self._last_id, "method": method, "params": params})
        return self.next_message(lambda message: message.get("id") == self._last_id)

    def open(self, uri: str, text: str = SPEC) -> None:
        item = {"uri": uri, "languageId": "yaml", "version": 1, "text": text}
        self.notify("textDocument/didOpen", textDocument=item)

    def diagnostics(self, uri: str) -> list[Any]:
        """The next diagnostics of a document."""
        message = self.next_message(
            lambda message: (
                message.get("method") == "textDocument/publishDiagnostics"
                and message["params"]["uri"] == uri
            )
        )
        found: list[Any] = message["params"]["diagnostics"]
        return found

    def next_message(self, fits: Any) -> dict[str, Any]:
        while True:
            message = self._read()
            if fits(message):
                return message

    def _read(self) -> dict[str, Any]:
        while b"\r\n\r\n" not in self._pending:
            self._receive()
        head, _, rest = self._pending.partition(b"\r\n\r\n")
        size = int(head.split(b"Content-Length: ")[1].split(b"\r\n")[0])
        self._pending = rest
        while len(self._pending) < size:
            self._receive()
        body, self._pending = self._pending[:size], self._pending[size:]
        message: dict[str, Any] = json.loads(body)
        return message

    def _receive(self) -> None:
        assert self.process.stdout is not None
        number = self.process.stdout.fileno()
        assert select.select([number], [], [], _WAIT_S)[0], "the server says nothing"
        data = os.read(number, 1 << 16)
        assert data, "the server has ended"
        self._pending += data

    def said(self) -> bytes:
        """What the server wrote on standard error, whose file has the same place for both."""
        return os.pread(self._log.fileno(), 1 << 24, 0)

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()
        self._log.close()


@pytest.fixture(scope="module")
def editor() -> Iterator[Editor]:
    """An editor whose server gets all that is here: none of it may end the server."""
    editor = Editor()
    answer = editor.ask("initialize", processId=None, rootUri=None, capabilities={})
    assert "result" in answer
    editor.notify("initialized")
    yield editor
    editor.close()


def codes(diagnostics: list[Any]) -> set[str]:
    return {each["code"] for each in diagnostics}


@pytest.mark.parametrize("name", ["a%00b.yaml", "%00", "loop/a.yaml", "x" * 5000, "%FF%FE.yaml"])
def test_a_document_that_can_be_no_file_leaves_the_others_alone(
    editor: Editor, tmp_path: Path, name: str
) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    strange = f"{tmp_path.as_uri()}/{name}"
    editor.open(strange)
    other = (tmp_path / "other.r2b.yaml").as_uri()
    editor.open(other)
    assert codes(editor.diagnostics(other))
    for method in ("hover", "completion", "definition"):
        answer = editor.ask(
            f"textDocument/{method}",
            textDocument={"uri": strange},
            position={"line": 0, "character": 0},
        )
        assert "result" in answer or answer["error"]["code"] == -32602


@pytest.mark.parametrize("method", ["hover", "completion", "definition", "prepareRename"])
@pytest.mark.parametrize("number", [-1, 2**31, 2**63, None])
def test_a_position_that_is_none_gets_the_error_of_the_protocol(
    editor: Editor, method: str, number: object
) -> None:
    for position in ({"line": number, "character": 0}, {"line": 0, "character": number}):
        answer = editor.ask(
            f"textDocument/{method}", textDocument={"uri": "file:///a.yaml"}, position=position
        )
        assert answer["error"]["code"] == -32602


@pytest.mark.parametrize("method", ["hover", "completion", "definition"])
def test_a_position_beyond_the_text_is_at_its_end(editor: Editor, method: str) -> None:
    editor.open("file:///beyond.r2b.yaml")
    answer = editor.ask(
        f"textDocument/{method}",
        textDocument={"uri": "file:///beyond.r2b.yaml"},
        position={"line": 2**31 - 1, "character": 2**31 - 1},
    )
    assert "result" in answer


@pytest.mark.parametrize("message", [{"id": 7}, {"id": 7, "method": "shutdown"}])
def test_what_is_no_request_gets_an_error(editor: Editor, message: dict[str, Any]) -> None:
    editor.send(message)
    answer = editor.next_message(lambda answer: answer.get("id") == 7)
    assert answer["error"]["code"] == -32600


@pytest.mark.parametrize("length", ["99999999999999", "9" * 5000, str((1 << 27) + 1), "0", "-5"])
@pytest.mark.parametrize("body", [b"", b'{"jsonrpc": "2.0"}'])
def test_a_wrong_length_ends_nothing(editor: Editor, length: str, body: bytes) -> None:
    before = editor.said().count(b"is passed over")
    editor.write(f"Content-Length: {length}\r\n\r\n".encode() + body)
    assert editor.ask("unknown")["error"]["code"] == -32601
    assert editor.said().count(b"is passed over") - before == (len(length) > 2)


@pytest.mark.parametrize("line_break", ["\n", "\r\n"])
@pytest.mark.parametrize("name", ["Content-Length", "content-length"])
def test_headers_may_end_with_a_line_feed_only(editor: Editor, line_break: str, name: str) -> None:
    body = json.dumps({"jsonrpc": "2.0", "id": 9, "method": "unknown", "params": {}}).encode()
    editor.write(f"{name}: {len(body)}{line_break * 2}".encode() + body)
    answer = editor.next_message(lambda message: message.get("id") == 9)
    assert answer["error"]["code"] == -32601
