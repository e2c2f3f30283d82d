"""Files that an editor has changed and not saved: their texts take the place of those on disk."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Final

_TEXTS: Final[ContextVar[Mapping[Path, str]]] = ContextVar("unsaved_files")


@contextlib.contextmanager
def unsaved_files(texts: Mapping[Path, str]) -> Iterator[None]:
    """Within this context, these files are read with these texts.

    Args:
        texts: by the resolved path of the file, which must exist on disk.
    """
    token = _TEXTS.set(texts)
    try:
        yield
    finally:
        _TEXTS.reset(token)


def unsaved_content(path: Path) -> bytes | None:
    """The content of a file that is open and not saved; None for all others."""
    texts = _TEXTS.get({})
    text = texts.get(path.resolve()) if texts else None
    return None if text is None else text.encode("utf-8", "surrogatepass")
