"""Python files that a spec names, read without importing them."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Final

from r2bspec.untrusted.errors import RefusedFileError
from r2bspec.untrusted.safe_file import read_text

_MAX_BYTES: Final = 2_000_000


def definitions_in(file: Path) -> tuple[ast.ClassDef | ast.FunctionDef, ...] | None:
    """The classes and functions at the top of a file; None if it cannot be read or parsed."""
    try:
        module = ast.parse(read_text(file, max_bytes=_MAX_BYTES))
    except (OSError, RefusedFileError, SyntaxError, ValueError, RecursionError, MemoryError):
        return None
    return tuple(each for each in module.body if isinstance(each, ast.ClassDef | ast.FunctionDef))
