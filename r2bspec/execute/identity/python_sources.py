"""The Python sources of a node, followed from import to import without executing any.

What is imported from files of the user is a source, and is followed. What is imported from an
installed distribution is known by its version; the standard library by that of Python. A source
that imports by computed names, or that this Python cannot parse, may load anything beside it: then
every module of its package, or of its folder, is a source.

Of installed distributions, only the names of metadata folders, and in some cases their lists of
files, are read; nothing is imported. Folders are those that a process of the graph searches: of
``PYTHONPATH`` as it is now, which another side of a comparison has otherwise than this process when
it started, and then those of this interpreter.
"""

from __future__ import annotations

import ast
import contextlib
import importlib.util
import os
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from importlib.machinery import ModuleSpec, PathFinder
from itertools import chain
from pathlib import Path
from typing import Final

from r2bspec.plan.wiring.python_files import module_of
from r2bspec.safe_io.limits import MAX_DISTRIBUTION_BYTES, MAX_IMPORTED_PYTHON_BYTES
from r2bspec.safe_io.safe_file import is_folder, is_regular, names_in, read_bytes

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
class InstalledDistribution:
    """An installed distribution.

    Attributes:
        name: as its metadata folder has it, with hyphens.
        folder: where it is installed.
        metadata: the name of the folder, or the file, of its metadata.
        kind: ``dist-info``, or ``egg-info`` for one that setuptools, and so colcon, has installed.
    """

    name: str
    version: str
    folder: str
    metadata: str
    kind: str

    @cached_property
    def plain(self) -> str:
        """Its name without what may be written differently."""
        return _plain(self.name)

    def read(self, name: str) -> bytes:
        """A file of its metadata; empty if there is none."""
        try:
            return read_bytes(
                Path(self.folder, self.metadata, name), max_bytes=MAX_DISTRIBUTION_BYTES
            )
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

    def _description(self) -> bytes:
        """The fields of its metadata."""
        return (self.read("METADATA") or self.read("PKG-INFO")).partition(b"\n\n")[0]

    @property
    def stated_version(self) -> str:
        """Its version as its metadata has it; empty without one."""
        match = _VERSION_FIELD.search(self._description())
        return match[1].decode(errors="replace").strip() if match is not None else ""

    @property
    def requirements(self) -> Iterator[str]:
        """The names of what it requires, extras left out."""
        for name, condition in _REQUIREMENT.findall(self._description()):
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
    """Where the processes of the graph find modules, and what is installed there.

    Attributes:
        folders: in the order in which they are searched.
        find: a module by its dotted name, and by folders in which it is looked for first; no parent
            package is imported.
        imports_of: what a file imports.
    """

    def __init__(self) -> None:
        started_with = _python_path(_path_at_start())
        self._current = _python_path(os.environ.get("PYTHONPATH", ""))
        self._gone = frozenset(started_with) - frozenset(self._current)
        inherited = [path for path in sys.path if path and path not in self._gone]
        self.folders = tuple(dict.fromkeys([*self._current, *inherited]))
        self.find = cache(self._find)
        self.imports_of = cache(imports_of)
        self._record = cache(partial(InstalledDistribution.read, name="RECORD"))
        self._names_in = cache(_listed_names)
        self._first_parts = cache(self._first_parts_in)

    def _find(self, name: str, first: tuple[str, ...] = ()) -> ModuleSpec | None:
        parent, _, last = name.rpartition(".")
        if not parent:
            return self._find_top(last, first)
        package = self.find(parent, first)
        if package is None or package.submodule_search_locations is None:
            return None
        return _path_spec(name, [*package.submodule_search_locations])

    def _find_top(self, name: str, first: tuple[str, ...]) -> ModuleSpec | None:
        if name in sys.stdlib_module_names:
            # Nothing but the folders of a program come before the standard library.
            return _path_spec(name, [*first]) if first else None
        folders = [*first, *self.folders]
        # A workspace of colcon has a folder for each package; what cannot be listed may have any.
        parts = [(folder, self._first_parts(folder)) for folder in folders]
        spec = _path_spec(name, [folder for folder, has in parts if has is None or name in has])
        if spec is None:
            # An editable installation has a finder of its own.
            with contextlib.suppress(ImportError, ValueError, AttributeError):
                spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin and str(_root(spec)) in self._gone:
            return None
        return spec

    def owner(self, spec: ModuleSpec) -> InstalledDistribution | None:
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
        return next(
            (package for package in installed if self._owns(package, spec.name, inside)), None
        )

    def _owns(self, distribution: InstalledDistribution, module: str, inside: str) -> bool:
        """Whether a distribution has installed a file or a folder, by its path below the folder."""
        record = self._record(distribution) if distribution.kind == "dist-info" else b""
        if not record:
            named = distribution.read("top_level.txt").decode(errors="replace").split()
            return module in named or (not named and _plain(module) == distribution.plain)
        needle = inside.encode()
        return any(
            record.startswith(needle + end) or b"\n" + needle + end in record
            for end in (b",", b"/")
        )

    def distribution(self, name: str) -> InstalledDistribution | None:
        """An installed distribution by its name."""
        return self._installed.get(_plain(name))

    def with_requirements(self, distributions: set[str]) -> dict[str, str]:
        """The versions of distributions and of everything that they require, by name."""
        versions: dict[str, str] = {}
        waiting = [*distributions]
        while waiting and len(versions) < _MAX_DISTRIBUTIONS:
            distribution = self.distribution(waiting.pop())
            if distribution is not None and distribution.name not in versions:
                versions[distribution.name] = distribution.version
                waiting += distribution.requirements
        return versions

    def _first_parts_in(self, folder: str) -> frozenset[str] | None:
        names = self._names_in(folder)
        return None if names is None else frozenset(name.partition(".")[0] for name in names)

    @cached_property
    def _by_folder(self) -> dict[str, list[InstalledDistribution]]:
        """What is installed, by folders in the order in which they are searched."""
        return {
            folder: [*_distributions_in(folder, self._names_in(folder) or ())]
            for folder in self.folders
        }

    @cached_property
    def _installed(self) -> dict[str, InstalledDistribution]:
        """What is installed, by plain names; what is found first counts."""
        in_order = list(chain.from_iterable(self._by_folder.values()))
        return {distribution.plain: distribution for distribution in reversed(in_order)}


def _distributions_in(folder: str, names: Iterable[str]) -> Iterator[InstalledDistribution]:
    for name in names:
        match = name.endswith("-info") and (
            _METADATA.fullmatch(name) or _EGG_WITHOUT_VERSION.fullmatch(name)
        )
        if match:
            parts = match.groupdict()
            distribution = InstalledDistribution(
                name=parts["name"].replace("_", "-"),
                version=parts.get("version", ""),
                folder=folder,
                metadata=name,
                kind=parts["kind"],
            )
            yield replace(distribution, version=distribution.version or distribution.stated_version)


def _python_path(text: str) -> list[str]:
    return [str(Path(path).absolute()) for path in text.split(os.pathsep) if path]


def _path_at_start() -> str:
    """PYTHONPATH as it was when this process started."""
    with contextlib.suppress(OSError):
        for variable in Path("/proc/self/environ").read_bytes().split(b"\0"):
            name, _, value = variable.partition(b"=")
            if name == b"PYTHONPATH":
                return os.fsdecode(value)
    return ""


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


_MAX_FILES: Final = 4_000
_COMPUTED_IMPORT: Final = re.compile(
    rb"import_module|__import__|spec_from_file_location|\brunpy\b|\bpkgutil\b|\bload_module\b"
    rb"|\bexec[ \t]*\("
)
_TOOL: Final = "r2bspec"
_TOOL_NODES: Final = "r2bspec.nodes"
"""The rest of r2bspec is the tool that measures: its version is in the record."""
_SUFFIX: Final = ".py"
_BYTECODE_FOLDER: Final = "__pycache__"


@dataclass
class Sources:
    """The sources of a node.

    Attributes:
        files: modules, in the order in which they were found.
        distributions: the names of what they import that is installed.
        incomplete: why there may be more; empty if these are all.
    """

    files: dict[Path, None] = field(default_factory=dict)
    distributions: set[str] = field(default_factory=set)
    incomplete: str = ""


Import = tuple[int, str, tuple[str, ...]]
"""The number of dots before a module, its name, and the names that are taken from it."""


def sources_of_file(search: ModuleSearch, file: Path) -> Sources:
    """The sources of a program or of a file that is imported by its path.

    Modules are looked for in the folder of its package, if it has one, and then in its own folder.
    """
    place = module_of(file)
    first = tuple(dict.fromkeys((str(place.folder), str(file.parent))))
    own = place.package.partition(".")[0]
    trail = _Trail(search, first, own)
    if own:
        trail.add_module(place.package, ())
    trail.add_file(file, place.package)
    return trail.follow()


def sources_of_module(search: ModuleSearch, name: str) -> Sources | None:
    """The sources of a module; None if there is no such module."""
    if search.find(name) is None:
        return None
    trail = _Trail(search, (), own=name.partition(".")[0])
    trail.add_module(name, ())
    return trail.follow()


def imports_of(file: Path) -> tuple[tuple[Import, ...], bool]:
    """What a file imports, and whether it may import more, as one of another Python version."""
    try:
        text = read_bytes(file, max_bytes=MAX_IMPORTED_PYTHON_BYTES)
    except (OSError, ValueError):
        return (), False
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return (), True
    return tuple(_imports_in(tree)), _COMPUTED_IMPORT.search(text) is not None


@dataclass
class _Trail:
    """The imports of one node.

    Attributes:
        search: where modules are found.
        first: the folders in which they are found first.
        own: the top-level package that is followed wherever it is installed.
    """

    search: ModuleSearch
    first: tuple[str, ...]
    own: str
    _sources: Sources = field(default_factory=Sources)
    _waiting: list[tuple[Path, str]] = field(default_factory=list)
    _is_installed: dict[str, bool] = field(default_factory=dict)

    def follow(self) -> Sources:
        """Follow everything that was added; the result is complete afterwards."""
        while self._waiting:
            if len(self._sources.files) > _MAX_FILES:
                self._sources.incomplete = f"it has more than {_MAX_FILES:,} modules"
                break
            file, package = self._waiting.pop()
            imports, computed = self.search.imports_of(file)
            if computed:
                self._add_surroundings(file, package)
            for level, name, taken in imports:
                self._add_import(level, name, taken, package)
        return self._sources

    def add_file(self, file: Path, package: str) -> None:
        """Add a source; `package` is the one that its relative imports start from."""
        if file not in self._sources.files:
            self._sources.files[file] = None
            if file.suffix == _SUFFIX or not file.suffix:
                self._waiting.append((file, package))

    def add_module(self, name: str, taken: Iterable[str]) -> None:
        """Add a module with its parent packages, and the modules that are taken from it."""
        parts = name.split(".")
        spec: ModuleSpec | None = None
        for end in range(1, len(parts) + 1):
            spec = self.search.find(".".join(parts[:end]), self.first)
            if spec is None:
                return
            self._add_spec(spec)
        if spec is None or spec.submodule_search_locations is None:
            return
        for part in taken:
            if part == "*":
                self._add_tree(spec.name, spec.submodule_search_locations)
            elif (below := self.search.find(f"{name}.{part}", self.first)) is not None:
                self._add_spec(below)

    def _add_spec(self, spec: ModuleSpec) -> None:
        if spec.name.partition(".")[0] == _TOOL and not spec.name.startswith(_TOOL_NODES):
            return
        if spec.has_location and spec.origin:
            is_package = spec.submodule_search_locations is not None
            self.add_file(
                Path(spec.origin), spec.name if is_package else spec.name.rpartition(".")[0]
            )

    def _add_import(self, level: int, name: str, taken: tuple[str, ...], package: str) -> None:
        if level:
            parts = package.split(".") if package else []
            base = parts[: len(parts) - level + 1]
            if not base or level > len(parts):
                return
            self.add_module(".".join([*base, name] if name else base), taken)
            return
        if not self._installed(name.partition(".")[0]):
            self.add_module(name, taken)

    def _installed(self, top: str) -> bool:
        """Whether a top-level module is known by a version; it is taken down then."""
        if top not in self._is_installed:
            spec = self.search.find(top, self.first)
            owner = self.search.owner(spec) if spec is not None else None
            if owner is not None:
                self._sources.distributions.add(owner.name)
            versioned = owner is not None and (
                not owner.is_from_folder if owner.kind == "dist-info" else owner.is_of_system
            )
            self._is_installed[top] = spec is None or (versioned and top != self.own)
        return self._is_installed[top]

    def _add_surroundings(self, file: Path, package: str) -> None:
        """Everything that a computed import may mean: the package, or the modules beside it."""
        if package:
            self._add_tree(package, [str(file.parent)])
        else:
            for module in _modules_in(file.parent):
                self.add_file(module, "")

    def _add_tree(self, name: str, folders: Iterable[str]) -> None:
        """Every module below a package."""
        waiting = [(Path(folder), name) for folder in folders]
        while waiting and len(self._sources.files) <= _MAX_FILES:
            folder, package = waiting.pop()
            for module in _modules_in(folder):
                self.add_file(module, package)
            waiting += [
                (folder / name, f"{package}.{name}")
                for name in _listed_names(folder) or ()
                if name.isidentifier() and name != _BYTECODE_FOLDER and is_folder(folder / name)
            ]


def _modules_in(folder: Path) -> Iterator[Path]:
    for name in _listed_names(folder) or ():
        if name.endswith(_SUFFIX) and is_regular(folder / name):
            yield folder / name


def _listed_names(folder: str | Path) -> list[str] | None:
    """What is in a folder; None if it cannot be listed, such as an archive."""
    try:
        return names_in(Path(folder))
    except OSError:
        return None


def _imports_in(tree: ast.AST) -> Iterator[Import]:
    """The imports among the statements of a module, in functions and branches, too."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            yield from ((0, alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.level, node.module or "", tuple(alias.name for alias in node.names)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in (
            getattr(node.test, "id", ""),
            getattr(node.test, "attr", ""),
        ):
            # What is imported then is for type checkers alone.
            waiting += node.orelse
        elif not isinstance(node, ast.expr):
            waiting += ast.iter_child_nodes(node)
