"""Did-you-mean: the known name most similar to an unknown one."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from itertools import islice

_MAX_CANDIDATES = 1000
_MAX_NAME_LENGTH = 100


def did_you_mean(wrong: str, known: Iterable[str]) -> str:
    """The known name most similar to `wrong`, or an empty string if none is similar.

    Case is ignored. 0.6 is a ratio of `difflib`, at which one typing error in a word of three
    letters is still found. Only the first thousand names are compared, so that a large file with
    many mistakes does not take long.
    """
    if len(wrong) > _MAX_NAME_LENGTH:
        return ""
    return _closest(wrong, tuple(islice(known, _MAX_CANDIDATES)))


@lru_cache(maxsize=200)  # many specs name the same thing that is not installed
def _closest(wrong: str, known: tuple[str, ...]) -> str:
    import difflib

    by_fold = {name.casefold(): name for name in known}
    close = difflib.get_close_matches(wrong.casefold(), by_fold, n=1, cutoff=0.6)
    return by_fold[close[0]] if close else ""
