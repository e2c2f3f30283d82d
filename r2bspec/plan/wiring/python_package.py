"""The package that a Python file is part of.

A node named by its file, such as ``../src/pkg/pkg/node.py:Node``, is imported as a module of its
package, so that it may import the others of it: ``from pkg.helper import …``, ``from . import …``.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

_INIT = "__init__.py"


class PackageModule(NamedTuple):
    """A file as a module.

    Attributes:
        folder: what has to be searched for modules, so that it is found under its name.
        name: dotted.
        package: the dotted name of its package; empty if it is in none.
    """

    folder: Path
    name: str
    package: str


def module_of(file: Path) -> PackageModule:
    """The name of a file as a module; its folders up to the first without ``__init__.py`` count.

    Args:
        file: absolute, without links. A ``__init__.py`` is the module of its folder's name.
    """
    folder = file.parent
    parts: list[str] = []
    while folder.name.isidentifier() and (folder / _INIT).is_file():
        parts.insert(0, folder.name)
        folder = folder.parent
    package = ".".join(parts)
    if not parts or file.name == _INIT:
        return PackageModule(folder, package or file.stem, package)
    return PackageModule(folder, f"{package}.{file.stem}", package)
