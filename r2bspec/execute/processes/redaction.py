"""Redaction of secrets in the output of processes.

A spec can name environment variables that its processes inherit. The last output of a failed
process is part of the error, the record and the reports, and may contain the value of one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping

_SECRET = re.compile(r"AUTH|COOKIE|CREDENTIAL|KEY|PASS|PRIVATE|SECRET|TOKEN", re.IGNORECASE)
"""Names of variables with secrets. Other values, such as paths, are useful in errors."""

_MIN_SECRET_LENGTH = 4
"""Shorter values occur everywhere in ordinary text."""

_REDACTED = "***"


def make_redactor(names: Iterable[str], environ: Mapping[str, str]) -> Callable[[str], str]:
    """A function that replaces, in a text, the values of secret variables.

    Args:
        names: the variables that the spec names.
        environ: where their values are.
    """
    values = sorted(
        {
            value
            for name in names
            if _SECRET.search(name) and len(value := environ.get(name, "")) >= _MIN_SECRET_LENGTH
        },
        # A secret may contain another one.
        key=len,
        reverse=True,
    )
    if not values:
        return str
    pattern = re.compile("|".join(map(re.escape, values)))
    return lambda text: pattern.sub(_REDACTED, text)
