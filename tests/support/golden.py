"""Outputs that are compared with files, word for word."""

from __future__ import annotations

import os
from pathlib import Path


def compare(written: str | bytes, file: Path) -> None:
    """See that an output is what the file has; with ``R2BSPEC_REWRITE=1`` it is written there."""
    text = written if isinstance(written, str) else written.decode()
    if os.environ.get("R2BSPEC_REWRITE"):
        file.write_bytes(text.encode())
    assert text == file.read_bytes().decode()
