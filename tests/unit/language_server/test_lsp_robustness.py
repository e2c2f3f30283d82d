"""Promise: the language server answers everything as its protocol says, and nothing ends it."""

from __future__ import annotations

import asyncio
import io
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from editor_messages import EXIT, INITIALIZE, SHUTDOWN, URI, changed, framed, notice, request
from editor_messages import opened as opened_text
from r2bspec.cli.lsp import defects_in_files
from r2bspec.language_server.positions import edited
from r2bspec.language_server.protocol import Change, Connection, Message, Position, Range, decoded
from r2bspec.language_server.server import create_server
from r2bspec.safe_io.limits import (
    MAX_EDITOR_HEADER_BYTES,
    MAX_EDITOR_MESSAGE_BYTES,
    MAX_EDITOR_TEXT_CHARACTERS,
)

_WAIT_S = 60.0
SPEC = "r2bspec: 1\nname: 5\n"

PARSE, REQUEST, METHOD, PARAMS = -32700, -32600, -32601, -32602
NOT_INITIALIZED, CANCELLED, INTERNAL = -32002, -32800, -32603
RESULT = 0
"""In place of the code of an error."""


def opened(text: str = SPEC, uri: str = URI) -> bytes:
    return opened_text(text, uri)


def about(number: int, method: str, line: object = 0, uri: str = URI, **more: Any) -> bytes:
    place = {"line": line, "character": 3}
    document = {"uri": uri}
    return request(number, f"textDocument/{method}", textDocument=document, position=place, **more)


LAST = request("last", "unknown")


class PatientInput(io.BufferedReader):
    """What an editor writes, which ends when all requests are answered."""

    def __init__(self, data: bytes, connection: Connection) -> None:
        super().__init__(io.BytesIO(data))
        self._connection = connection

    def readline(self, size: int | None = -1) -> bytes:
        line = super().readline(size)
        deadline = time.monotonic() + _WAIT_S
        while not line and not self._is_answered() and time.monotonic() < deadline:
            time.sleep(0.001)
        return line

    def _is_answered(self) -> bool:
        incoming = self._connection._incoming
        return incoming is not None and incoming.is_idle and not self._connection._requests


def session(*parts: bytes) -> list[dict[str, Any]]:
    """All that a server in this process says; a defect is a failure."""

    def fail(error: BaseException) -> str:
        raise AssertionError from error

    said = io.BytesIO()
    server = create_server(fail)
    incoming = PatientInput(b"".join(parts), server.connection)
    asyncio.run(server.connection.serve(incoming, said))
    assert b"Traceback" not in said.getvalue()
    *messages, rest = messages_of(said.getvalue())
    assert not rest
    return messages


def messages_of(data: bytes) -> Iterator[Any]:
    """The messages at the beginning of some bytes, and what is left of these."""
    while b"\r\n\r\n" in data:
        head, _, rest = data.partition(b"\r\n\r\n")
        size = int(head.split(b"Content-Length: ")[1].split(b"\r\n")[0])
        if len(rest) < size:
            break
        yield json.loads(rest[:size])
        data = rest[size:]
    yield data


def codes_of(messages: list[dict[str, Any]]) -> list[tuple[Any, int]]:
    """The id and the code of every answer, in their order."""
    return [
        (message["id"], message["error"]["code"] if "error" in message else RESULT)
        for message in messages
        if "method" not in message
    ]


def answers(*parts: bytes) -> list[tuple[Any, int]]:
    return codes_of(session(*parts))


def in_session(*parts: bytes) -> list[tuple[Any, int]]:
    """The answers after 'initialize'; the last message is always answered."""
    first, *others = answers(INITIALIZE, *parts, LAST)
    assert first == ("initialize", RESULT)
    others.remove(("last", METHOD))
    return others


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        (
            (about(1, "hover"), SHUTDOWN, LAST),
            [(each, NOT_INITIALIZED) for each in (1, "shutdown", "last")],
        ),
        ((opened(), INITIALIZE, about(1, "documentSymbol")), [("initialize", 0), (1, 0)]),
        ((INITIALIZE, INITIALIZE), [("initialize", 0), ("initialize", REQUEST)]),
        (
            (INITIALIZE, SHUTDOWN, about(1, "hover"), SHUTDOWN, INITIALIZE, opened(), EXIT, LAST),
            [("initialize", 0), ("shutdown", 0)]
            + [(each, REQUEST) for each in (1, "shutdown", "initialize")],
        ),
        (
            (request(1, "initialize"), request(2, "initialize", capabilities=5), INITIALIZE),
            [(1, PARAMS), (2, PARAMS), ("initialize", 0)],
        ),
        ((EXIT, INITIALIZE), []),
    ],
)
def test_orders(parts: tuple[bytes, ...], expected: list[tuple[Any, int]]) -> None:
    assert answers(*parts) == expected


@pytest.mark.parametrize(
    ("parts", "status"),
    [
        ((INITIALIZE, SHUTDOWN, EXIT), 0),
        ((INITIALIZE, EXIT), 1),
        ((INITIALIZE,), 1),
        ((b"Content-Length: 9\r\n\r\n{",), 1),
        ((framed(b"{") * 1000, framed([]) * 1000, INITIALIZE, SHUTDOWN, EXIT), 0),
    ],
)
def test_the_exit_status_is_that_of_the_protocol(parts: tuple[bytes, ...], status: int) -> None:
    command = [sys.executable, "-m", "r2bspec", "lsp"]
    done = subprocess.run(command, input=b"".join(parts), capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (status, b"")


IDS = ("{}", "[]", "null", "true", "1.5", "9" * 30, "9" * 5000, f'"{"x" * 2000}"', "[[1]]")


@pytest.mark.parametrize("number", IDS)
def test_an_id_that_is_none_is_not_sent_back(number: str) -> None:
    body = f'{{"jsonrpc":"2.0","id":{number},"method":"textDocument/hover"}}'
    assert in_session(framed(body.encode())) == [(None, REQUEST)]


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ({"jsonrpc": "2.0", "id": 7}, [(7, REQUEST)]),
        ({"id": 7, "method": "shutdown"}, [(7, REQUEST)]),
        ({"jsonrpc": "1.0", "id": 7, "method": "shutdown"}, [(7, REQUEST)]),
        ({"jsonrpc": "2.0", "id": 7, "method": ["shutdown"]}, [(7, REQUEST)]),
        ({"jsonrpc": "2.0", "id": 7, "method": "$/unknown"}, [(7, METHOD)]),
        ({"jsonrpc": "2.0", "method": "$/unknown"}, []),
        ({"jsonrpc": "2.0", "id": 7, "result": None}, []),
        ({"jsonrpc": "2.0", "id": {}, "error": 5}, []),
        ([{"jsonrpc": "2.0", "id": 7, "method": "shutdown"}] * 3, [(None, REQUEST)]),
        ("shutdown", [(None, REQUEST)]),
        ({}, [(None, REQUEST)]),
        (b"", [(None, PARSE)]),
        (b"{", [(None, PARSE)]),
        (b'{"id": NaN}', [(None, PARSE)]),
        (b'{"id": "\xff"}', [(None, PARSE)]),
        (b'{"id": "\xed\xa0\x80"}', [(None, PARSE)]),
        (json.dumps({"id": 7}).encode("utf-16"), [(None, PARSE)]),
        (b'{"x": ' + b"[" * 100_000, [(None, PARSE)]),
    ],
)
def test_what_is_no_request_gets_the_error_of_the_protocol(
    message: Any, expected: list[tuple[Any, int]]
) -> None:
    assert in_session(framed(message)) == expected


@pytest.mark.parametrize("method", ["hover", "completion", "definition", "rename"])
@pytest.mark.parametrize(
    "number", ["-1", "2147483648", "9" * 30, "9" * 5000, "1.5", "1e400", "null", '"3"', "true"]
)
def test_a_position_that_is_none_gets_the_error_of_the_protocol(method: str, number: str) -> None:
    for line in (number, "0"):
        asked = about(1, method, line="LINE").replace(b'"LINE"', line.encode())
        asked = asked if line != "0" else asked.replace(b": 3}", f": {number}}}".encode())
        _, body = asked.split(b"\r\n\r\n")
        (answer,) = (each for each in session(INITIALIZE, framed(body)) if each.get("id") == 1)
        assert answer["error"]["code"] == PARAMS
        assert "digits" not in answer["error"]["message"]


@pytest.mark.parametrize("method", ["hover", "completion", "definition", "documentHighlight"])
def test_a_position_beyond_the_text_is_at_its_end(method: str) -> None:
    assert in_session(opened(), about(1, method, line=2**31 - 1)) == [(1, RESULT)]


URIS = ("http://[::1", "file://[::1", "", "file:", "file:///", "//", "%00", "file:///a%00b")


@pytest.mark.parametrize("uri", URIS)
def test_a_uri_that_names_no_document_gets_the_error_of_the_protocol(uri: str) -> None:
    asked = (about(1, "hover", uri=uri), about(2, "completion", uri=uri))
    cases = request(3, "r2bspec/cases", uri=uri)
    expected = [(number, PARAMS) for number in (1, 2, 3)]
    if uri == "%00":  # a name like any other: only those of files are decoded
        expected = [(number, RESULT) for number in (1, 2, 3)]
    assert sorted(in_session(opened(uri=uri), changed(uri=uri), *asked, cases)) == expected


@pytest.mark.parametrize(
    "text",
    [
        "\ud800",
        "r2bspec: 1\nname: \ud83d\n",
        "r2bspec: 1\nextends: http://[::1\n",
        "r2bspec: 1\ndata_loader: {bag: 'http://[::1'}\n",
        "r2bspec: 1\nname: \0",
        f"r2bspec: 1\nname: {'9' * 5000}\n",
        *("", "\ufeff", "a: [", "- x\n- y", "🤖", "x: &a [*a]", "\t", "r2bspec: 1\n%"),
    ],
)
def test_every_text_is_answered_about(text: str) -> None:
    of_places = ("hover", "completion", "definition", "documentHighlight", "prepareRename")
    methods = (*of_places, "documentSymbol", "codeLens")
    asked = [about(number, method, line=1) for number, method in enumerate(methods)]
    assert {code for _, code in in_session(opened(text), *asked)} <= {RESULT, PARAMS}


def test_half_a_character_is_replaced_by_one_of_the_same_length() -> None:
    """Positions behind it stay right."""
    text = "a\ud83d b\ude00 \ude00\ud83d \U0001f600 \\ud800 \\"
    body = json.dumps({"jsonrpc": "2.0", "method": "x", "params": text}).encode()
    message = Message.of(body)
    assert message is not None
    assert decoded(message.params, str) == re.sub("[\ud800-\udfff]", "\ufffd", text)


@pytest.mark.parametrize(
    "message",
    [
        notice("textDocument/didOpen"),
        notice("textDocument/didOpen", textDocument={"uri": URI, "version": 2**40, "text": "x"}),
        notice("textDocument/didClose", textDocument={"uri": URI}) * 3,
        changed({"text": "x"}),
        changed(uri="file:///dev/zero"),
        opened() * 2 + changed({"text": 5}),
        notice("textDocument/didSave", textDocument={"uri": "http://[::1"}),
        notice("workspace/didChangeWatchedFiles", changes=5),
        notice("workspace/didChangeWorkspaceFolders", event={"added": [{"uri": "http://[::1"}]}),
        notice("$/cancelRequest", id=5) + notice("$/cancelRequest", id={}),
        notice("initialized") * 2,
    ],
)
def test_a_notification_that_is_wrong_is_never_answered_and_ends_nothing(message: bytes) -> None:
    assert in_session(message) == []


def test_what_is_wrong_with_a_notification_is_a_line_of_the_log() -> None:
    wrong = notice("textDocument/didOpen", textDocument={"x" * 1000: "y" * 1000})
    (logged,) = (each for each in session(INITIALIZE, wrong) if "method" in each)
    assert logged["method"] == "window/logMessage"
    said = logged["params"]["message"]
    assert said == "textDocument/didOpen: Object missing required field `uri` - at `$.textDocument`"


@pytest.mark.parametrize("method", ["textDocument/completion", "r2bspec/cases"])
@pytest.mark.parametrize("end", [notice("$/cancelRequest", id=1), SHUTDOWN])
def test_what_still_runs_is_answered_when_it_is_cancelled(method: str, end: bytes) -> None:
    place = {"line": 0, "character": 0}
    asked = request(1, method, textDocument={"uri": URI}, position=place, uri=URI)
    codes = dict(answers(INITIALIZE, opened(), asked, end))
    assert codes[1] in {CANCELLED, RESULT}


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        [{}],
        [{"file": 5}],
        [{"file": "relative.yaml"}],
        ["/" + "x" * 5000],
        ["/\0"],
        [{"file": "/a"}, {}],
    ],
)
@pytest.mark.parametrize("command", ["r2bspec.run", "r2bspec.showResult", "rm", "\0"])
def test_a_command_that_is_none_is_refused(command: str, arguments: Any) -> None:
    asked = request(1, "workspace/executeCommand", command=command, arguments=arguments)
    assert in_session(asked) == [(1, PARAMS)]


def test_a_command_in_a_folder_that_has_gone_ends_nothing(tmp_path: Path) -> None:
    event = {"added": [{"uri": (tmp_path / "gone").as_uri(), "name": "x"}], "removed": []}
    moved = notice("workspace/didChangeWorkspaceFolders", event=event)
    file = {"file": str(tmp_path / "a.r2b.yaml")}
    asked = request(1, "workspace/executeCommand", command="r2bspec.plan", arguments=[file])
    assert in_session(moved, asked, about(2, "hover")) == [(1, RESULT), (2, RESULT)]


LENGTHS = ("-5", "+5", "5x", "", "99999999999999", "9" * 5000, str(MAX_EDITOR_MESSAGE_BYTES + 1))


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("body", [b"", b'{"jsonrpc": "2.0"}', b"x\n\nx: y\n\n" * 1000])
def test_a_wrong_length_is_answered_once_and_ends_nothing(length: str, body: bytes) -> None:
    header = f"Content-Length: {length}\r\n\r\n".encode()
    assert in_session(header + body) == [(None, PARSE)]


@pytest.mark.parametrize(
    ("before", "expected"),
    [
        (b"Content-Type: x\r\n\r\n{}", [(None, PARSE)]),
        (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", [(None, PARSE)]),
        (b"X: y\r\n" * MAX_EDITOR_HEADER_BYTES, [(None, PARSE)]),
        (b"X: " + b"y" * MAX_EDITOR_HEADER_BYTES + b"\r\n", [(None, PARSE)]),
        (b"X: y\r\n" * 9, []),
        (b"\r\n\n" * 9, []),
        (b"Content-Length: 0\r\n\r\n", [(None, PARSE)]),
        (framed(b"[]trailing").replace(b"10", b"2"), [(None, REQUEST)]),
        (
            b"Content-Length: 99999999\r\n\r\n" + b"x" * (MAX_EDITOR_HEADER_BYTES - 9),
            [(None, PARSE)],
        ),
    ],
)
def test_what_is_no_message_is_passed_over(before: bytes, expected: list[Any]) -> None:
    assert in_session(before) == expected


@pytest.mark.parametrize("line_break", [b"\n", b"\r\n"])
@pytest.mark.parametrize("name", [b"Content-Length", b"content-length"])
def test_headers_may_end_with_a_line_feed_only(line_break: bytes, name: bytes) -> None:
    message = about(1, "hover").replace(b"\r\n", line_break).replace(b"Content-Length", name)
    assert in_session(message) == [(1, RESULT)]


def test_what_no_code_foresaw_is_a_line_and_its_traceback_is_in_one_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    server = create_server(defects_in_files())

    @server.connection.on("defect")
    def fail(_: None) -> None:
        raise KeyError("a\nsecret")

    said = io.BytesIO()
    asked = (INITIALIZE, request(1, "defect"), request(2, "defect"), LAST)
    asyncio.run(server.connection.serve(io.BufferedReader(io.BytesIO(b"".join(asked))), said))
    _, *failed, last, _ = messages_of(said.getvalue())
    (file,) = tmp_path.iterdir()
    assert "secret" in file.read_text()
    assert last["id"] == "last"
    for answer in failed:
        assert answer["error"].keys() == {"code", "message"}
        assert answer["error"]["code"] == INTERNAL
        assert str(file) in answer["error"]["message"]
        assert "secret" not in answer["error"]["message"]


@pytest.mark.parametrize(
    ("text", "places", "expected"),
    [
        ("a\n😀b\r\nc", (1, 2, 1, 3), "a\n😀x\r\nc"),
        ("a\nb", (1, 9, 7, 9), "a\nbx"),
        ("a\nb", (9, 0, 9, 9), "a\nbx"),
        ("abc", (0, 2, 0, 1), "abxc"),
        ("a\u2028b\rc", (1, 0, 1, 1), "a\u2028b\rx"),
        ("", (0, 0, 0, 0), "x"),
    ],
)
def test_a_range_is_that_of_the_protocol(
    text: str, places: tuple[int, int, int, int], expected: str
) -> None:
    """A range that ends before it begins is empty; what is beyond the text is at its end."""
    where = Range(Position(*places[:2]), Position(*places[2:]))
    twice = [Change("y", Range(Position(0, 0), Position(0, 0))), Change(text), Change("x", where)]
    assert edited("before", twice, "utf-16") == expected


def published(messages: list[dict[str, Any]], uri: str) -> list[dict[str, Any]]:
    """The diagnostics of a document that were published last."""
    params = [each["params"] for each in messages if each.get("method") == PUBLISHED]
    found: list[dict[str, Any]] = [each for each in params if each["uri"] == uri][-1]["diagnostics"]
    return found


PUBLISHED = "textDocument/publishDiagnostics"


@pytest.mark.parametrize("name", ["a%00b.yaml", "%00", "loop/a.yaml", "x" * 5000, "%FF%FE.yaml"])
def test_a_document_that_can_be_no_file_leaves_the_others_alone(tmp_path: Path, name: str) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    strange, other = f"{tmp_path.as_uri()}/{name}", (tmp_path / "other.r2b.yaml").as_uri()
    asked = [about(1, method, uri=strange) for method in ("hover", "completion", "definition")]
    last = about(2, "documentSymbol", uri=other)
    messages = session(INITIALIZE, opened(uri=strange), opened(uri=other), *asked, last)
    assert published(messages, other)
    assert {code for number, code in codes_of(messages) if number == 1} <= {RESULT, PARAMS}


def too_long(uri: str) -> bytes:
    """A spec is opened that is too long with any other."""
    return opened(SPEC + "# x\n" * (MAX_EDITOR_TEXT_CHARACTERS // 4), uri)


def test_a_document_that_is_too_long_has_one_finding_and_no_answers(tmp_path: Path) -> None:
    long, other = ((tmp_path / f"{name}.r2b.yaml").as_uri() for name in ("long", "other"))
    asked = [about(1, each, 9, long) for each in ("hover", "completion", "documentSymbol")]
    last = about(2, "documentSymbol", uri=other)
    messages = session(INITIALIZE, too_long(long), opened(uri=other), *asked, last)
    (found,) = published(messages, long)
    assert found["code"] == "R2B002"
    assert f"{MAX_EDITOR_TEXT_CHARACTERS:,} characters" in found["message"]
    assert "open it again" in found["message"]
    assert "R2B002" not in {each["code"] for each in published(messages, other)}
    empty = (None, {"isIncomplete": False, "items": []})
    assert [each["result"] in empty for each in messages if each.get("id") == 1] == [True] * 3


def test_all_of_a_document_that_was_too_long_can_be_changed_and_no_part(tmp_path: Path) -> None:
    long = (tmp_path / "long.r2b.yaml").as_uri()
    start = {"line": 0, "character": 0}
    part = changed({"range": {"start": start, "end": start}, "text": "x"}, uri=long)
    asked = about(1, "documentSymbol", uri=long)
    messages = session(INITIALIZE, too_long(long), part, changed({"text": SPEC}, uri=long), asked)
    found = {each["code"] for each in published(messages, long)}
    assert found
    assert "R2B002" not in found


def test_the_length_of_all_open_documents_together_is_limited(tmp_path: Path) -> None:
    text = SPEC + "# x\n" * (MAX_EDITOR_TEXT_CHARACTERS // 6)
    uris = [(tmp_path / f"{number}.r2b.yaml").as_uri() for number in range(4)]
    opens = [opened(text, uri) for uri in uris[:3]]
    asked = about(1, "documentSymbol", uri=uris[3])
    messages = session(INITIALIZE, *opens, opened(uri=uris[3]), asked)
    is_too_long = [
        "R2B002" in {each["code"] for each in published(messages, uri)} for uri in uris[:3]
    ]
    assert is_too_long == [False, True, True]
    closed = notice("textDocument/didClose", textDocument={"uri": uris[0]})
    asked = about(1, "documentSymbol", uri=uris[1])
    messages = session(INITIALIZE, *opens, closed, opens[1], asked)
    assert "R2B002" not in {each["code"] for each in published(messages, uris[1])}
