"""JSON from outside: every problem is one kind of error."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from r2bspec.safe_io.safe_json import decode_json, decode_python_json


@pytest.mark.parametrize("decode", [lambda text: decode_json(text, Any), decode_python_json])
@pytest.mark.parametrize(
    "text",
    [b'{"a":' * 100_000, b"[" * 100_000, b'{"a": "\xff"}', b"{", b"", b"9" * 5000 + b"x"],
)
def test_what_is_not_json_or_too_deep_is_one_kind_of_error(decode: Any, text: bytes) -> None:
    with pytest.raises(msgspec.DecodeError):
        decode(text)


def test_a_type_is_checked_and_unknown_keys_may_be_deep() -> None:
    class One(msgspec.Struct):
        a: int

    assert decode_json(b'{"a": 1}', One).a == 1
    with pytest.raises(msgspec.ValidationError):
        decode_json(b'{"a": "x"}', One)
    with pytest.raises(msgspec.DecodeError):
        decode_json(b'{"b":' * 100_000, One)
