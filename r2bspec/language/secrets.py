"""Which variables and keys hold secrets, and what stands in their place.

A reference ``$(env NAME)`` to a secret is not replaced when a spec is loaded: the tree, the plan
and everything that is printed contain the reference itself. The value is read when a process is
started, for that process alone (`r2bspec.execute.processes.environment`). So no message, no
file and no comparison of values can show it, or a part of it. The lists of words in this module are
the only ones: what a run redacts, and what counts as a secret in plain text, is decided by them.
"""

from __future__ import annotations

import re

SECRET_WORDS = ("AUTH", "COOKIE", "CREDENTIAL", "KEY", "PASS", "PRIVATE", "SECRET", "TOKEN")
"""A variable whose name contains one of these, in any case, holds a secret."""

SECRET_PARTS = ("BEARER", "DSN", "JWT", "PAT", "PSK", "PWD", "SIGNATURE", "WEBHOOK")
"""The same for names of which one of these is a whole part between underscores."""

QUOTED_OPENING = "$(quoted_env "
"""Begins a reference inside of JSON quotes, on a command line: its value is escaped as they ask."""

REDACTED = "***"
"""What is shown in place of the value of a secret."""

_WORKING_FOLDERS = frozenset({"PWD", "OLDPWD"})

_SECRET_NAME = re.compile(
    "|".join((*SECRET_WORDS, rf"(?:^|_)(?:{'|'.join(SECRET_PARTS)})(?:_|$)")), re.IGNORECASE
)

_SECRET_VALUE = re.compile(
    r"""
      \b[a-z][a-z0-9+.-]{0,20}://[^\s/@:]{0,200}:[^\s/@]{1,800}@    # a URL with a password
    | -----BEGIN\ [A-Z ]{0,40}PRIVATE\ KEY-----
    | \b(?: gh[oprsu]_ | github_pat_ | gl(?:pat|dt|rt|cbt|ptt|ft|soat|imt|agent)- )[\w-]{12}
    | \b(?: sk- | xox[abeoprs]- )[\w-]{12}
    | \b(?: AKIA | ASIA )[A-Z0-9]{12}
    | \beyJ[\w-]{8,400}\.eyJ                                        # a JSON web token
    """,
    re.VERBOSE,
)
"""Values that are secrets whatever their variable is called."""

_PLAIN_TEXT_KEY = re.compile(
    r"(?:^|[_.\-])(?:passw(?:or)?d|passphrase|secret|token|api_?key|access_?key|private_?key"
    r"|credentials?)$",
    re.IGNORECASE,
)
"""Keys of a spec. Fewer than names of variables: a parameter `key` or `passthrough` is common."""


def is_secret_variable(name: str, value: str = "") -> bool:
    """Whether an environment variable holds a secret, by its name or by its value."""
    by_name = _SECRET_NAME.search(name) is not None and name not in _WORKING_FOLDERS
    return by_name or (bool(value) and _SECRET_VALUE.search(value) is not None)


def is_secret_key(key: str) -> bool:
    """Whether the key of a parameter, a label or a variable of a spec names a secret."""
    return _PLAIN_TEXT_KEY.search(key) is not None


def secret_reference(name: str) -> str:
    """What a document has in place of the value of a secret."""
    return f"$(env {name})"


def shown_value(name: str, value: str) -> str:
    """The value of an environment variable as it may be shown or recorded."""
    return REDACTED if value and is_secret_variable(name, value) else value


def quoted_secret_references(text: str) -> str:
    """A text inside of JSON quotes, with its references marked, so that values fit in there."""
    return text.replace("$(env ", QUOTED_OPENING)
