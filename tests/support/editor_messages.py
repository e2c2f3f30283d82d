"""What an editor sends to a language server: JSON-RPC messages with their headers."""

from __future__ import annotations

import json
from typing import Any

URI = "file:///a.r2b.yaml"


def framed(message: Any) -> bytes:
    """A message with its header; bytes are the body as it is."""
    body = message if isinstance(message, bytes) else json.dumps(message).encode()
    return b"Content-Length: %d\r\n\r\n" % len(body) + body


def request(number: Any, method: str, **params: Any) -> bytes:
    return framed({"jsonrpc": "2.0", "id": number, "method": method, "params": params})


def notice(method: str, **params: Any) -> bytes:
    return framed({"jsonrpc": "2.0", "method": method, "params": params})


def opened(text: str, uri: str = URI) -> bytes:
    item = {"uri": uri, "languageId": "yaml", "version": 1, "text": text}
    return notice("textDocument/didOpen", textDocument=item)


def changed(*changes: Any, uri: str = URI) -> bytes:
    document = {"uri": uri, "version": 2}
    return notice("textDocument/didChange", textDocument=document, contentChanges=changes)


INITIALIZE = request("initialize", "initialize", capabilities={})
SHUTDOWN = request("shutdown", "shutdown")
EXIT = notice("exit")
