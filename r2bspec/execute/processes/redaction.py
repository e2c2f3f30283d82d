"""Keeping secrets that a run's processes are given out of what the run reports.

A spec can name environment variables that its processes inherit. What a dying process printed last
becomes part of the error, the record and the reports, and may show the value of one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping

_SECRET = re.compile(r"AUTH|COOKIE|CREDENTIAL|KEY|PASS|PRIVATE|SECRET|TOKEN", re.IGNORECASE)
"""Names of variables that hold secrets. Others, such as a path, are worth more than hiding them."""

_MIN_SECRET_LENGTH = 4
"""What is shorter occurs everywhere, and is no secret."""

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
