"""The class or function that ``python:`` of a node names."""

from __future__ import annotations

from pathlib import Path

import msgspec

from r2bspec.safe_io.safe_file import real_path


class PythonTarget(msgspec.Struct, frozen=True):
    """A class or function in a module or a file.

    Attributes:
        text: as in the spec.
        module: the dotted name; empty for a file.
        file: the path of the file; unused for a module.
        name: the class or function.
        readable: whether the file is in the folder of the spec, so that it may be read.
    """

    text: str
    module: str
    file: Path
    name: str
    readable: bool


def python_target(text: str, base_dir: Path) -> PythonTarget:
    """Parse ``module.Class`` or ``./file.py:Class``."""
    place, colon, name = text.rpartition(":")
    if not colon:
        module, _, name = text.rpartition(".")
        return PythonTarget(text, module, Path(), name, readable=False)
    file = base_dir / place
    inside = real_path(file).is_relative_to(real_path(base_dir))
    return PythonTarget(text, "", file, name, readable=inside)
