"""Console scripts of Python packages: the function that an executable of a ROS package calls.

An installed package has it in its metadata; the source of a package, as colcon builds it, in
``setup.py``, ``setup.cfg`` or ``pyproject.toml``. All of them are read, and none is executed.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from r2bspec.safe_io.limits import MAX_MANIFEST_BYTES
from r2bspec.safe_io.safe_file import names_if_any, read_bytes
from r2bspec.safe_io.shared_lookups import shared_lookup

_SCRIPTS: Final = "console_scripts"
_MAX_FOLDERS: Final = 2_000
_MAX_DEPTH: Final = 6
_NOT_SOURCES: Final = frozenset({"build", "install", "log", "node_modules", "runs"})
_ENTRY: Final = re.compile(r"^\s*([\w.-]+)\s*=\s*([\w.]+)\s*:\s*([\w.]+)\s*$")
_NAME: Final = re.compile(r"<name>\s*([\w.-]+)\s*</name>")


@shared_lookup
def installed_script(package: str, executable: str) -> str:
    """Return the function that a script of an installed package calls; empty if unknown."""
    import importlib.metadata

    try:
        entries = importlib.metadata.distribution(package).entry_points
    except (importlib.metadata.PackageNotFoundError, ValueError, OSError):
        return ""
    for entry in entries:
        if entry.group == _SCRIPTS and entry.name == executable and entry.attr:
            return f"{entry.module}.{entry.attr}"
    return ""


@shared_lookup
def source_script(folder: Path, package: str, executable: str) -> tuple[Path, str] | None:
    """Return the file and function of a console script of a package in source form.

    Args:
        folder: in which packages are looked for, to a limited depth.
        package: the name in its ``package.xml``.
        executable: the name of the script.
    """
    for place in _folders(folder):
        manifest = _text(place, "package.xml")
        match = _NAME.search(manifest)
        if match is None or match[1] != package:
            continue
        for line in _script_lines(place, package):
            entry = _ENTRY.match(line)
            if entry is not None and entry[1] == executable:
                file = place.joinpath(*entry[2].split(".")).with_suffix(".py")
                return (file, entry[3]) if file.is_file() else None
    return None


def _folders(top: Path) -> Iterator[Path]:
    """Yield the folders below one that may hold packages, in order, the nearest first."""
    waiting = [(top, 0)]
    for visited, (folder, depth) in enumerate(waiting):
        if visited > _MAX_FOLDERS:
            return
        yield folder
        if depth < _MAX_DEPTH:
            waiting += [
                (folder / name, depth + 1)
                for name in sorted(names_if_any(folder))
                if not name.startswith(".")
                and name not in _NOT_SOURCES
                and (folder / name).is_dir()
                and not (folder / name).is_symlink()
            ]


def _text(folder: Path, name: str) -> str:
    try:
        content = read_bytes(folder / name, max_bytes=MAX_MANIFEST_BYTES, folders=(folder,))
        return content.decode("utf-8", "replace")
    except (OSError, ValueError):
        return ""


def _script_lines(folder: Path, package: str) -> Iterator[str]:
    """Yield the lines ``name = module:function`` of the source of a package."""
    import configparser
    import tomllib

    yield from _lines_of_setup(_text(folder, "setup.py"), package)
    reader = configparser.ConfigParser(interpolation=None)
    try:
        reader.read_string(_text(folder, "setup.cfg"))
        yield from reader.get("options.entry_points", _SCRIPTS, fallback="").splitlines()
    except configparser.Error:
        pass
    try:
        project = tomllib.loads(_text(folder, "pyproject.toml")).get("project", {})
        yield from (f"{name} = {target}" for name, target in project.get("scripts", {}).items())
    except (tomllib.TOMLDecodeError, AttributeError, RecursionError):
        pass


def _lines_of_setup(text: str, package: str) -> Iterator[str]:
    """Yield the literal console scripts of a ``setup.py``.

    A name in an f-string is the package's.
    """
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and key.value == _SCRIPTS:
                    yield from (_line(element, package) for element in getattr(value, "elts", ()))


def _line(node: ast.expr, package: str, depth: int = 0) -> str:
    match node:
        case ast.Constant(value=str(line)):
            return line
        case ast.JoinedStr(values=values):
            parts = (part.value if isinstance(part, ast.Constant) else package for part in values)
            return "".join(map(str, parts))
        case ast.BinOp(left=left, op=ast.Add(), right=right) if depth < _MAX_DEPTH:
            return _line(left, package, depth + 1) + _line(right, package, depth + 1)
        case ast.Name():
            return package
    return ""
