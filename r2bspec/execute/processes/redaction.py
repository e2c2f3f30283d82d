"""Redaction of secrets in the output of processes.

A spec can name environment variables that its processes inherit, and a program can find those of
r2bspec itself. The last output of a failed process is part of the error, the record and the
reports, and may contain the value of one.
"""

from __future__ import annotations

import fnmatch
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from urllib.parse import quote_plus

from r2bspec.language.secret_variables import REDACTED, is_secret_variable

_MIN_SECRET_LENGTH = 4
"""Shorter values occur everywhere in ordinary text."""

_MIN_UNNAMED_LENGTH = 8
"""The same for variables that the spec does not name, and for the lines of a value: there are many,
and a word such as 'true' is worth more than hiding it."""


def make_redactor(names: Iterable[str], environ: Mapping[str, str]) -> Callable[[str], str]:
    """A function that replaces, in a text, the values of secret variables.

    Args:
        names: the variables, or patterns of variables, that the spec names.
        environ: where their values are, and those of all others.
    """
    patterns = tuple(names)
    found: set[str] = set()
    for name, value in environ.items():
        named = any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)
        length = _MIN_SECRET_LENGTH if named else _MIN_UNNAMED_LENGTH
        if len(value) >= length and is_secret_variable(name, value):
            found.update(_forms(value))
    if not found:
        return str
    # A secret may contain another one.
    pattern = re.compile("|".join(map(re.escape, sorted(found, key=len, reverse=True))))
    return lambda text: pattern.sub(REDACTED, text)


def _forms(value: str) -> Iterator[str]:
    """A value as programs print it: as it is, in quotes, in a URL, and by its lines."""
    yield value
    yield repr(value)[1:-1]
    yield json.dumps(value)[1:-1]
    yield quote_plus(value)
    if "\n" in value:
        yield from (line for line in value.splitlines() if len(line) >= _MIN_UNNAMED_LENGTH)
