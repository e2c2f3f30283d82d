"""Did-you-mean: the known name that a wrong one most resembles."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice

_MAX_CANDIDATES = 1000
_MAX_NAME_LENGTH = 100


def did_you_mean(wrong: str, known: Iterable[str]) -> str:
    """The known name closest to `wrong`, or an empty string if none is close.

    Case is ignored; 0.6 is the ratio of `difflib`, at which one typing error in a word of
    three letters is still found. Of very many known names only the first thousand are looked at,
    so that a large file with many mistakes is still answered at once.
    """
    if len(wrong) > _MAX_NAME_LENGTH:
        return ""
    by_fold = {name.casefold(): name for name in islice(known, _MAX_CANDIDATES)}
    close = difflib.get_close_matches(wrong.casefold(), by_fold, n=1, cutoff=0.6)
    return by_fold[close[0]] if close else ""
