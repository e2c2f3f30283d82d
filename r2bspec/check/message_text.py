"""Pieces of sentences that many rules need."""

from __future__ import annotations

from collections.abc import Iterable

from r2bspec.diagnostics import did_you_mean
from r2bspec.diagnostics.quote import quote

MAX_LISTED_NAMES = 8
"""Names that a message lists at most."""

MAX_SUGGESTIONS = 50
"""Findings of a rule for which close names are looked for. Each search takes time, and a document
with more mistakes of one kind has one cause, which the first ones show."""


def quoted_list(names: Iterable[str], last: str = "and") -> str:
    """``'a', 'b' and 'c'``; a long list is cut and says how many more there are."""
    quoted = [quote(name) for name in dict.fromkeys(names)]
    if len(quoted) > MAX_LISTED_NAMES:
        return (
            f"{', '.join(quoted[:MAX_LISTED_NAMES])} {last} {len(quoted) - MAX_LISTED_NAMES} more"
        )
    return f" {last} ".join([", ".join(quoted[:-1]), quoted[-1]]) if quoted[1:] else "".join(quoted)


def suggestion(wrong: str, known: Iterable[str], what: str) -> str:
    """What to write instead: the known name that is close, or else all of them.

    Args:
        wrong: the name as written.
        known: the names that would be right.
        what: what they are, as in ``topics that are published``.
    """
    names = sorted(set(known))
    close = did_you_mean(wrong, names)
    if close:
        return f"did you mean {quote(close)}?"
    return f"{what}: {quoted_list(names)}" if names else ""


def pluralize(number: int, noun: str) -> str:
    """``1 message``, ``3,000 messages``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
