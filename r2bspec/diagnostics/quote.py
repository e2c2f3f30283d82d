"""Names, values and times in messages.

Values are quoted: short, on one line, without control characters. For an unknown name the most
similar known name is proposed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import islice

_MAX_CANDIDATES = 1000
_MAX_NAME_LENGTH = 100

MAX_LISTED_NAMES = 8
"""The maximum number of names in a message."""

_MAX_KNOWN_NAMES = 16

MAX_SUGGESTIONS = 50
"""The maximum number of findings of a rule for which close names are searched. A search takes time,
and many errors of one kind usually have one cause."""

MAX_SHOWN_CHARS = 60
"""The most characters of a value that a message shows."""


def printable(text: str) -> str:
    """Return the text with every control character replaced by U+FFFD."""
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() else "\ufffd" for char in text)


def printable_lines(text: str) -> str:
    """Return the text like `printable`, but with its line breaks."""
    return "\n".join(map(printable, text.splitlines()))


def clip(text: str, max_length: int = MAX_SHOWN_CHARS) -> str:
    """Return the text on one line, truncated to `max_length` characters."""
    short = text[: max_length + 1]
    line = printable(short.replace("\n", "⏎").replace("\t", " "))
    return line if len(line) <= max_length else line[: max_length - 1] + "…"


def quote(text: str) -> str:
    """Return the text in single quotes, truncated."""
    return f"'{clip(text)}'"


def did_you_mean(wrong: str, known: Iterable[str]) -> str:
    """Return the known name most similar to `wrong`, or an empty string if none is similar.

    Case is ignored. 0.6 is a ratio of `difflib` that still matches one typing error in a word of
    three letters. Only the first thousand names are compared, so that a large file with many
    mistakes does not take long.
    """
    if len(wrong) > _MAX_NAME_LENGTH:
        return ""
    return _closest(wrong, tuple(islice(known, _MAX_CANDIDATES)))


def unknown_name_help(wrong: str, known: Iterable[str], what: str, if_none: str = "") -> str:
    """Return help for an unknown name: the most similar known name, if any, and all names.

    Args:
        wrong: the unknown name.
        known: the known names.
        what: what they are, such as ``known keys``.
        if_none: what is said where there are none.
    """
    names = list(known)
    if not names:
        return if_none
    close = did_you_mean(wrong, names)
    listed = f"{what}: {first_words([clip(name) for name in names], _MAX_KNOWN_NAMES)}"
    return f"did you mean '{close}'? {listed}" if close else listed


@lru_cache(maxsize=200)  # many specs name the same thing that is not installed
def _closest(wrong: str, known: tuple[str, ...]) -> str:
    import difflib

    by_fold = {name.casefold(): name for name in known}
    close = difflib.get_close_matches(wrong.casefold(), by_fold, n=1, cutoff=0.6)
    return by_fold[close[0]] if close else ""


def quoted_list(names: Iterable[str]) -> str:
    """Return ``'a', 'b' and 'c'``; a long list ends with the number of omitted names."""
    quoted = [quote(name) for name in dict.fromkeys(names)]
    if len(quoted) > MAX_LISTED_NAMES:
        return first_words(quoted, MAX_LISTED_NAMES)
    return join_words(quoted, "and")


def join_words(words: Sequence[str], joint: str = "or") -> str:
    """Return ``a``, ``a or b``, or ``a, b or c``."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {joint} {words[-1]}"


def first_words(words: Sequence[str], most: int) -> str:
    """Return at most `most` words of a list: ``a, b and 3 more``."""
    more = len(words) - most
    return ", ".join(words[:most]) + (f" and {more} more" if more > 0 else "")


def suggestion(wrong: str, known: Iterable[str], what: str) -> str:
    """Return help for an unknown name: the known name that is close, or else all known names.

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
    """Return a number with its noun: ``1 message``, ``3,000 messages``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def time_text(seconds: float) -> str:
    """Return a time for people, rounded up: ``40 s``, ``2 min 30 s``, ``1 h 20 min``."""
    if seconds < 10:
        return f"{math.ceil(seconds)} s"
    if seconds <= 115:
        return f"{math.ceil(seconds / 5) * 5} s"
    if seconds <= 270:
        minutes, half = divmod(math.ceil(seconds / 30), 2)
        return f"{minutes} min 30 s" if half else f"{minutes} min"
    minutes = math.ceil(seconds / 60)
    if minutes < 60:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min" if minutes % 60 else f"{minutes // 60} h"
