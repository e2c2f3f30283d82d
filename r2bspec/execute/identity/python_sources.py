"""The Python sources of a node, followed from import to import without executing any.

What is imported from files of the user is a source, and is followed. What is imported from an
installed distribution is known by its version; the standard library by that of Python. A source
that imports by computed names may load anything beside it: then every module of its package, or of
its folder, is a source.

Statements are picked from the text by their first word, and parsed with `ast`: parsing whole files
would take most of the time. A line of a docstring that happens to be an import adds a module that
is not needed, which does no harm.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Final

from r2bspec.execute.identity.distributions import ModuleSearch
from r2bspec.safe_io.safe_file import is_folder, is_regular, names_in, read_bytes

_MAX_SOURCE_BYTES: Final = 4_000_000
_MAX_FILES: Final = 4_000
_STATEMENT: Final = re.compile(
    rb"(?m)^[ \t]*((?:import[ \t]+[^#;\r\n\\(]+"
    rb"|from[ \t]+[.\w]+[ \t]+import[ \t]*(?:\([^)]*\)|[^#;\r\n\\(]+)))"
)
_INLINE_STATEMENT: Final = re.compile(
    rb"[:;][ \t]*((?:import[ \t]+[\w., \t]+|from[ \t]+[.\w]+[ \t]+import[ \t]+[\w., \t]+))"
)
_LONG_STATEMENT: Final = re.compile(
    rb"(?m)^[ \t]*(?:from|import)\b(?:[^#\r\n]*\\\r?$|[^\r\n(]*\([^)#]*#)"
)
"""One over several lines that are joined by backslashes or have comments: files with such are
parsed whole."""
_COMPUTED_IMPORT: Final = re.compile(
    rb"import_module|__import__|spec_from_file_location|\brunpy\b|\bpkgutil\b|\bload_module\b"
    rb"|\bexec[ \t]*\("
)
_FOR_TYPES: Final = re.compile(
    rb"(?m)^([ \t]*)if (?:typing\.)?TYPE_CHECKING:[^\r\n]*\r?\n(?:\1[ \t]+.*\r?\n|[ \t]*\r?\n)*"
)
"""What is imported for type checkers alone."""
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


@dataclass(frozen=True)
class _Imports:
    """What a file imports: pairs of a module and of the names that are taken from it.

    Attributes:
        modules: each with the number of dots before it.
        computed: whether it may import more.
    """

    modules: tuple[tuple[int, str, tuple[str, ...]], ...]
    computed: bool


class PythonSources:
    """Follows imports; each file is read once in a run.

    Args:
        search: where modules are found.
    """

    def __init__(self, search: ModuleSearch) -> None:
        self._search = search
        self._imports: dict[Path, _Imports] = {}

    def of_file(self, file: Path) -> Sources:
        """The sources of a program or of a file that is imported by its path.

        Modules beside it are found first, as if it were run as a script.
        """
        trail = _Trail(self, self._search, str(file.parent))
        trail.add_file(file, "")
        return trail.follow()

    def of_module(self, name: str) -> Sources | None:
        """The sources of a module; None if there is no such module."""
        if self._search.find(name) is None:
            return None
        trail = _Trail(self, self._search, "", own=name.partition(".")[0])
        trail.add_module(name, ())
        return trail.follow()

    def imports_of(self, file: Path) -> _Imports:
        """What a file imports; nothing if it cannot be read."""
        if file not in self._imports:
            try:
                text = read_bytes(file, max_bytes=_MAX_SOURCE_BYTES)
            except (OSError, ValueError):
                text = b""
            text = _FOR_TYPES.sub(rb"", text)
            self._imports[file] = _Imports(
                tuple(_import_statements(text)), _COMPUTED_IMPORT.search(text) is not None
            )
        return self._imports[file]


class _Trail:
    """The imports of one node.

    Args:
        sources: reads files.
        search: where modules are found.
        folder: where they are found first; empty for nowhere else.
        own: the top-level package that is followed wherever it is installed.
    """

    def __init__(
        self, sources: PythonSources, search: ModuleSearch, folder: str, own: str = ""
    ) -> None:
        self._sources = sources
        self._search = search
        self._folder = folder
        self._own = own
        self._found = Sources()
        self._waiting: list[tuple[Path, str]] = []
        self._is_installed: dict[str, bool] = {}

    def follow(self) -> Sources:
        """Follow everything that was added; the result is complete afterwards."""
        while self._waiting:
            if len(self._found.files) > _MAX_FILES:
                self._found.incomplete = f"it has more than {_MAX_FILES:,} modules"
                break
            file, package = self._waiting.pop()
            imports = self._sources.imports_of(file)
            if imports.computed:
                self._add_surroundings(file, package)
            for level, name, taken in imports.modules:
                self._add_import(level, name, taken, package)
        return self._found

    def add_file(self, file: Path, package: str) -> None:
        """Add a source; `package` is the one that its relative imports start from."""
        if file not in self._found.files:
            self._found.files[file] = None
            if file.suffix == _SUFFIX or not file.suffix:
                self._waiting.append((file, package))

    def add_module(self, name: str, taken: Iterable[str]) -> None:
        """Add a module with its parent packages, and the modules that are taken from it."""
        parts = name.split(".")
        spec: ModuleSpec | None = None
        for end in range(1, len(parts) + 1):
            spec = self._search.find(".".join(parts[:end]), self._folder)
            if spec is None:
                return
            self._add_spec(spec)
        if spec is None or spec.submodule_search_locations is None:
            return
        for part in taken:
            if part == "*":
                self._add_tree(spec.name, spec.submodule_search_locations)
            elif (below := self._search.find(f"{name}.{part}", self._folder)) is not None:
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
            spec = self._search.find(top, self._folder)
            owner = self._search.owner(spec) if spec is not None else None
            if owner is not None:
                self._found.distributions.add(owner.name)
            versioned = owner is not None and (
                not owner.is_from_folder if owner.kind == "dist-info" else owner.is_of_system
            )
            self._is_installed[top] = spec is None or (versioned and top != self._own)
        return self._is_installed[top]

    def _add_surroundings(self, file: Path, package: str) -> None:
        """Everything that a computed import may mean: the package, or the modules beside it."""
        if package:
            self._add_tree(package, [str(file.parent)])
        else:
            for module in _modules_in(file.parent):
                self.add_file(module, package)

    def _add_tree(self, name: str, folders: Iterable[str]) -> None:
        """Every module below a package."""
        waiting = [(Path(folder), name) for folder in folders]
        while waiting and len(self._found.files) <= _MAX_FILES:
            folder, package = waiting.pop()
            for module in _modules_in(folder):
                self.add_file(module, package)
            waiting += [(path, f"{package}.{path.name}") for path in _packages_in(folder)]


def _modules_in(folder: Path) -> Iterator[Path]:
    for name in _names(folder):
        if name.endswith(_SUFFIX) and is_regular(folder / name):
            yield folder / name


def _packages_in(folder: Path) -> Iterator[Path]:
    for name in _names(folder):
        if name.isidentifier() and name != _BYTECODE_FOLDER and is_folder(folder / name):
            yield folder / name


def _names(folder: Path) -> list[str]:
    try:
        return names_in(folder)
    except OSError:
        return []


def _import_statements(text: bytes) -> Iterator[tuple[int, str, tuple[str, ...]]]:
    statements = [*_STATEMENT.findall(text), *_INLINE_STATEMENT.findall(text)]
    nodes: list[ast.AST] = []
    try:
        if _LONG_STATEMENT.search(text) is not None:
            nodes = [*ast.walk(ast.parse(text))]
        else:
            for statement in dict.fromkeys(statements):
                nodes += _parsed(statement)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((0, alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.level, node.module or "", tuple(alias.name for alias in node.names)


def _parsed(statement: bytes) -> list[ast.stmt]:
    """The statements of a line; none for a line of prose that begins like one."""
    try:
        return ast.parse(statement.strip()).body
    except SyntaxError:
        return []
