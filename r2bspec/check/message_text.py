"""Parts of messages that many rules use."""

from __future__ import annotations

from collections.abc import Iterable

from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.quote import quote

MAX_LISTED_NAMES = 8
"""The maximum number of names in a message."""

MAX_SUGGESTIONS = 50
"""The maximum number of findings of a rule for which close names are searched. A search takes time,
and many errors of one kind usually have one cause."""


def quoted_list(names: Iterable[str], last: str = "and") -> str:
    """``'a', 'b' and 'c'``; a long list is cut and ends with the number of omitted names."""
    quoted = [quote(name) for name in dict.fromkeys(names)]
    if len(quoted) > MAX_LISTED_NAMES:
        return (
            f"{', '.join(quoted[:MAX_LISTED_NAMES])} {last} {len(quoted) - MAX_LISTED_NAMES} more"
        )
    return f" {last} ".join([", ".join(quoted[:-1]), quoted[-1]]) if quoted[1:] else "".join(quoted)


def suggestion(wrong: str, known: Iterable[str], what: str) -> str:
    """The help for an unknown name: the known name that is close, or else all known names.

    Args:
        wrong: the unknown name.
        known: the known names.
        what: what they are, such as ``published topics``.
    """
    names = sorted(set(known))
    close = did_you_mean(wrong, names)
    if close:
        return f"did you mean {quote(close)}?"
    return f"{what}: {quoted_list(names)}" if names else ""


def pluralize(number: int, noun: str) -> str:
    """``1 message``, ``3,000 messages``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
