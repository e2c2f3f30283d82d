"""Installed Python distributions: which one a module is from, and its version.

Only the names of metadata folders, and in some cases their lists of files, are read; nothing is
imported. Folders are those that a process of the graph searches: of ``PYTHONPATH`` as it is now,
which another side of a comparison has otherwise than this process when it started, and then those
of this interpreter.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Final

from r2bspec.safe_io.safe_file import names_in, read_bytes

_MAX_METADATA_BYTES: Final = 16_000_000
_MAX_DISTRIBUTIONS: Final = 1_000
_METADATA: Final = re.compile(
    r"(?P<name>[A-Za-z0-9._]+)-(?P<version>[^-]+)(?:-py[0-9.]+)?\.(?P<kind>dist-info|egg-info)"
)
_EGG_WITHOUT_VERSION: Final = re.compile(r"(?P<name>[A-Za-z0-9._-]+)\.(?P<kind>egg-info)")
_REQUIREMENT: Final = re.compile(rb"(?m)^Requires-Dist: *([A-Za-z0-9._-]+)([^\r\n]*)")
_VERSION_FIELD: Final = re.compile(rb"(?m)^Version: *([^\r\n]+)")
_SEPARATORS: Final = str.maketrans("", "", "-_.")
_INSTALLED_FOLDERS: Final = frozenset({"site-packages", "dist-packages"})


@dataclass(frozen=True)
class Distribution:
    """An installed distribution.

    Attributes:
        name: as its metadata folder has it, with hyphens.
        plain: its name without what may be written differently.
        folder: where it is installed.
        metadata: the name of the folder, or the file, of its metadata.
        kind: ``dist-info``, or ``egg-info`` for one that setuptools, and so colcon, has installed.
    """

    name: str
    plain: str
    version: str
    folder: str
    metadata: str
    kind: str

    def read(self, name: str) -> bytes:
        """A file of its metadata; empty if there is none."""
        try:
            return read_bytes(Path(self.folder, self.metadata, name), max_bytes=_MAX_METADATA_BYTES)
        except (OSError, ValueError):
            return b""

    @property
    def is_from_folder(self) -> bool:
        """Whether it was installed from a folder, so that its version says little of its code."""
        return self.kind == "dist-info" and b'"file://' in self.read("direct_url.json")

    @property
    def is_of_system(self) -> bool:
        """Whether it belongs to the system or to the interpreter, and so changes with a version."""
        roots = ("/usr/", "/opt/ros/", f"{sys.prefix}/", f"{sys.base_prefix}/")
        return self.folder.startswith(roots)

    @property
    def requirements(self) -> Iterator[str]:
        """The names of what it requires, extras left out."""
        text = self.read("METADATA") or self.read("PKG-INFO")
        for name, condition in _REQUIREMENT.findall(text.partition(b"\n\n")[0]):
            if b"extra" not in condition.partition(b";")[2]:
                yield name.decode()

    def entry_module(self, group: str, name: str) -> str:
        """The module of an entry point; empty if it has none of that name."""
        inside = False
        for line in self.read("entry_points.txt").decode(errors="replace").splitlines():
            if line.startswith("["):
                inside = line.strip() == f"[{group}]"
            elif inside and line.partition("=")[0].strip() == name:
                return line.partition("=")[2].strip().partition(":")[0].strip()
        return ""


class ModuleSearch:
    """Where the processes of the graph find modules, and what is installed there."""

    def __init__(self) -> None:
        started_with = _python_path(_variable_at_start("PYTHONPATH"))
        self._current = _python_path(os.environ.get("PYTHONPATH", ""))
        self._gone = frozenset(started_with) - frozenset(self._current)
        inherited = [path for path in sys.path if path and path not in self._gone]
        self.folders = tuple(dict.fromkeys([*self._current, *inherited]))
        self._found: dict[tuple[str, str], ModuleSpec | None] = {}
        self._records: dict[Distribution, bytes] = {}
        self._names: dict[str, list[str] | None] = {}
        self._first_parts: dict[str, frozenset[str] | None] = {}

    def find(self, name: str, folder: str = "") -> ModuleSpec | None:
        """A module by its dotted name; no parent package is imported.

        Args:
            name: of the module.
            folder: where modules are looked for first; empty for nowhere else.
        """
        key = (name, folder)
        if key not in self._found:
            self._found[key] = self._find(name, folder)
        return self._found[key]

    def _find(self, name: str, folder: str) -> ModuleSpec | None:
        parent, _, last = name.rpartition(".")
        if not parent:
            return self._find_top(last, folder)
        package = self.find(parent, folder)
        if package is None or package.submodule_search_locations is None:
            return None
        return _path_spec(name, [*package.submodule_search_locations])

    def _find_top(self, name: str, folder: str) -> ModuleSpec | None:
        if name in sys.stdlib_module_names:
            # Nothing but the folder of a program comes before the standard library.
            return _path_spec(name, [folder]) if folder else None
        folders = [folder, *self.folders] if folder else self.folders
        # A workspace of colcon has a folder for each package.
        found = _path_spec(name, [each for each in folders if self._may_have(each, name)])
        if found is None:
            # An editable installation has a finder of its own.
            with contextlib.suppress(ImportError, ValueError, AttributeError):
                found = importlib.util.find_spec(name)
        if found is not None and found.origin and str(_root(found)) in self._gone:
            return None
        return found

    def owner(self, spec: ModuleSpec) -> Distribution | None:
        """The distribution that a top-level module is from; None if it is from none."""
        folder = _root(spec)
        if folder is None or folder.name not in _INSTALLED_FOLDERS:
            return None
        plain = _plain(spec.name)
        inside = os.path.relpath(_place(spec), folder)
        # By name at first: few need their lists of files to be read.
        installed = sorted(
            self._by_folder.get(str(folder), ()),
            key=lambda each: (each.plain != plain, plain not in each.plain),
        )
        return next((each for each in installed if self._owns(each, spec.name, inside)), None)

    def _owns(self, distribution: Distribution, module: str, inside: str) -> bool:
        """Whether a distribution has installed a file or a folder, by its path below the folder."""
        if distribution.kind == "dist-info" and distribution not in self._records:
            self._records[distribution] = distribution.read("RECORD")
        record = self._records.get(distribution, b"")
        if not record:
            named = distribution.read("top_level.txt").decode(errors="replace").split()
            return module in named or (not named and _plain(module) == distribution.plain)
        needle = inside.encode()
        return any(
            record.startswith(needle + end) or b"\n" + needle + end in record
            for end in (b",", b"/")
        )

    def distribution(self, name: str) -> Distribution | None:
        """An installed distribution by its name."""
        return self._installed.get(_plain(name))

    def with_requirements(self, distributions: set[str]) -> dict[str, str]:
        """The versions of distributions and of everything that they require, by name."""
        versions: dict[str, str] = {}
        waiting = [*distributions]
        while waiting and len(versions) < _MAX_DISTRIBUTIONS:
            found = self.distribution(waiting.pop())
            if found is not None and found.name not in versions:
                versions[found.name] = found.version
                waiting += found.requirements
        return versions

    def _may_have(self, folder: str, module: str) -> bool:
        """Whether a folder has anything of the name of a top-level module, or cannot be listed."""
        if folder not in self._first_parts:
            names = self._names_in(folder)
            self._first_parts[folder] = (
                None if names is None else frozenset(name.partition(".")[0] for name in names)
            )
        parts = self._first_parts[folder]
        return parts is None or module in parts

    def _names_in(self, folder: str) -> list[str] | None:
        """What is in a folder; None if it cannot be listed, such as an archive."""
        if folder not in self._names:
            try:
                self._names[folder] = names_in(Path(folder))
            except OSError:
                self._names[folder] = None
        return self._names[folder]

    @cached_property
    def _by_folder(self) -> dict[str, list[Distribution]]:
        """What is installed, by folders in the order in which they are searched."""
        return {
            folder: [*_distributions_in(folder, self._names_in(folder) or ())]
            for folder in self.folders
        }

    @cached_property
    def _installed(self) -> dict[str, Distribution]:
        """What is installed, by plain names; what is found first counts."""
        installed: dict[str, Distribution] = {}
        for distributions in self._by_folder.values():
            for distribution in distributions:
                installed.setdefault(distribution.plain, distribution)
        return installed


def _distributions_in(folder: str, names: Iterable[str]) -> Iterator[Distribution]:
    for name in names:
        match = name.endswith("-info") and (
            _METADATA.fullmatch(name) or _EGG_WITHOUT_VERSION.fullmatch(name)
        )
        if match:
            parts = match.groupdict()
            yield Distribution(
                name=parts["name"].replace("_", "-"),
                plain=_plain(parts["name"]),
                version=parts.get("version") or _version_inside(Path(folder, name)),
                folder=folder,
                metadata=name,
                kind=parts["kind"],
            )


def _python_path(text: str) -> list[str]:
    return [str(Path(path).absolute()) for path in text.split(os.pathsep) if path]


def _variable_at_start(name: str) -> str:
    """A variable as it was when this process started."""
    try:
        variables = Path("/proc/self/environ").read_bytes().split(b"\0")
    except OSError:
        return ""
    start = f"{name}=".encode()
    return next(
        (os.fsdecode(each[len(start) :]) for each in variables if each.startswith(start)), ""
    )


def _path_spec(name: str, folders: list[str]) -> ModuleSpec | None:
    try:
        return PathFinder.find_spec(name, folders)
    except (ImportError, ValueError, OSError):
        return None


def _place(spec: ModuleSpec) -> Path:
    """The file of a module, or the first folder of a package without one."""
    if spec.has_location and spec.origin:
        return Path(spec.origin)
    return Path(next(iter(spec.submodule_search_locations or ("",))))


def _root(spec: ModuleSpec) -> Path | None:
    """The folder that contains a top-level module or package."""
    place = _place(spec)
    if spec.submodule_search_locations is not None and spec.has_location:
        place = place.parent
    return place.parent if place.name else None


def _plain(name: str) -> str:
    return name.translate(_SEPARATORS).lower()


def _version_inside(metadata: Path) -> str:
    for name in ("PKG-INFO", "METADATA"):
        with contextlib.suppress(OSError, ValueError):
            match = _VERSION_FIELD.search(
                read_bytes(metadata / name, max_bytes=_MAX_METADATA_BYTES)
            )
            if match is not None:
                return match[1].decode(errors="replace").strip()
    return ""
