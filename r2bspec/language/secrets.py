"""The environment variables that hold secrets: their values are not written into any record."""

from __future__ import annotations

import re

_WORDS = ("AUTH", "COOKIE", "CREDENTIAL", "KEY", "PASS", "PRIVATE", "SECRET", "TOKEN")
"""A variable whose name contains one of these, in any case, holds a secret."""

_PARTS = ("BEARER", "DSN", "JWT", "PAT", "PSK", "PWD", "SIGNATURE", "WEBHOOK")
"""The same for names of which one of these is a whole part between underscores."""

_SECRET_NAME = re.compile(
    "|".join((*_WORDS, rf"(?:^|_)(?:{'|'.join(_PARTS)})(?:_|$)")), re.IGNORECASE
)
_WORKING_FOLDERS = frozenset({"PWD", "OLDPWD"})

REDACTED = "***"
"""What is shown in place of the value of a secret."""


def is_secret_variable(name: str) -> bool:
    """Return True if an environment variable of this name holds a secret."""
    return _SECRET_NAME.search(name) is not None and name not in _WORKING_FOLDERS


def shown_value(name: str, value: str) -> str:
    """Return the value of an environment variable as it may be shown or recorded."""
    return REDACTED if value and is_secret_variable(name) else value
