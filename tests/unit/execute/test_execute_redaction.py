"""Promise: the values of secrets that a spec names do not get into what a run reports."""

from __future__ import annotations

import pytest

from r2bspec.execute.processes.redaction import make_redactor

ENVIRON = {
    "API_TOKEN": "abc.+(123",
    "DB_PASSWORD": "abc.+(123-and-more",
    "SSH_KEY": "line 1\nline 2",
    "SHORT_KEY": "on",
    "EMPTY_KEY": "",
    "DATA_DIR": "/data",
    "NOT_NAMED_TOKEN": "other",
}
NAMED = [name for name in ENVIRON if name != "NOT_NAMED_TOKEN"]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("with abc.+(123 in it, twice: abc.+(123", "with *** in it, twice: ***"),
        ("the longer one: abc.+(123-and-more.", "the longer one: ***."),
        ("over lines: line 1\nline 2\n", "over lines: ***\n"),
        ("paths stay: /data; so does what is short: on", None),
        ("abc  123", None),
        ("", None),
    ],
)
def test_values_of_secrets_are_replaced_and_all_else_stays(text: str, shown: str | None) -> None:
    assert make_redactor(NAMED, ENVIRON)(text) == (text if shown is None else shown)


def test_without_secrets_nothing_is_replaced() -> None:
    assert make_redactor(["DATA_DIR", "UNSET_TOKEN"], ENVIRON)("/data other") == "/data other"
