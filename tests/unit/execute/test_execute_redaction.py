"""Promise: the values of secrets that a spec names do not get into what a run reports."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from r2bspec.execute.processes.environment import make_redactor
from r2bspec.execute.processes.process import ManagedProcess
from r2bspec.ipc.process_cleanup import SessionLeader

ENVIRON = {
    "API_TOKEN": "abc.+(123",
    "DB_PASSWORD": "abc.+(123-and-more",
    "SSH_KEY": "line 1\nline 2",
    "SHORT_KEY": "on",
    "EMPTY_KEY": "",
    "DATA_DIR": "/data",
    "NOT_NAMED_TOKEN": "other",
    "NOT_NAMED_LONG_TOKEN": "of-another-program",
    "MIRROR": "https://user:pass-word@mirror",
    "CERTIFICATE_KEY": 'first "line"\nthe second line\n',
}
NAMED = [name for name in ENVIRON if not name.startswith("NOT_NAMED")]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("with abc.+(123 in it, twice: abc.+(123", "with *** in it, twice: ***"),
        ("the longer one: abc.+(123-and-more.", "the longer one: ***."),
        ("over lines: line 1\nline 2\n", "over lines: ***\n"),
        ("paths stay: /data; so does what is short: on", None),
        ("abc  123", None),
        ("a program found of-another-program", "a program found ***"),
        ("from https://user:pass-word@mirror", "from ***"),
        ("as 'first \"line\"\\nthe second line\\n'", "as '***'"),
        ('as "first \\"line\\"\\nthe second line\\n"', 'as "***"'),
        ("?key=first+%22line%22%0Athe+second+line%0A&x=1", "?key=***&x=1"),
        ("the end of it: the second line", "the end of it: ***"),
        ("", None),
    ],
)
def test_values_of_secrets_are_replaced_and_all_else_stays(text: str, shown: str | None) -> None:
    assert make_redactor(NAMED, ENVIRON)(text) == (text if shown is None else shown)


def test_without_secrets_nothing_is_replaced() -> None:
    assert make_redactor(["DATA_DIR", "UNSET_TOKEN"], ENVIRON)("/data other") == "/data other"


def test_patterns_of_names_are_names() -> None:
    assert make_redactor(["API_*"], {"API_KEY": "12345"})("12345") == "***"


def test_a_log_is_redacted_before_it_is_cut(tmp_path: Path) -> None:
    """A secret of which the cut would leave the end is gone, too."""
    secret = "".join(f"{number:04d}," for number in range(4000))
    log = tmp_path / "node.log"
    log.write_text(f"{secret}\nended\n")
    redact = make_redactor(["A_KEY"], {"A_KEY": secret})
    with SessionLeader([sys.executable, "-c", ""]) as ended:
        process = ManagedProcess("node", "host", ended, log, None, redact)
    assert process.log_tail() == "***\nended"
