"""Did-you-mean: the known name that a wrong one most resembles."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(wrong: str, known: Iterable[str]) -> str:
    """The known name closest to `wrong`, or an empty string if none is close.

    Case is ignored; 0.6 is the ratio of `difflib`, at which one typing error in a word of
    three letters is still found.
    """
    by_fold = {name.casefold(): name for name in known}
    close = difflib.get_close_matches(wrong.casefold(), by_fold, n=1, cutoff=0.6)
    return by_fold[close[0]] if close else ""
