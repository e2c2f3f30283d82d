"""Python files of nodes: where they may be read, as modules of their package, and their names.

Nothing is imported: a module is found by its name in the folder of the importing file. A node named
by its file, such as ``../src/pkg/pkg/node.py:Node``, is a module of its package, so that it may
import other modules of it: ``from pkg.helper import …``, ``from . import …``.
"""

from __future__ import annotations

import ast
import itertools
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

from r2bspec.safe_io import safe_file
from r2bspec.safe_io.git import find_work_tree
from r2bspec.safe_io.limits import MAX_BASE_CLASSES, MAX_PYTHON_BYTES
from r2bspec.safe_io.shared_lookups import shared_lookup

_INIT = "__init__.py"
_MAX_KEPT_BYTES = 10_000
_MAX_FOLDERS = 500
"""How many folders below ``src`` are looked at for a package."""

ReadSource = Callable[[Path], ast.Module | None]


@shared_lookup
def source_folder(base_dir: Path) -> Path:
    """Return where sources may be read: the work tree or workspace of a spec, or its folder."""
    return find_work_tree(base_dir) or _find_workspace(base_dir) or base_dir


def _find_workspace(base_dir: Path) -> Path | None:
    """Return the innermost folder around a spec whose ``src`` has a package; None without one."""
    start = safe_file.real_path(base_dir)
    return next((top for top in (start, *start.parents) if _has_packages(top / "src")), None)


def _has_packages(folder: Path) -> bool:
    """Return whether a folder of a folder is a package, or a repository of packages."""
    places = [folder / name for name in safe_file.names_if_any(folder)[:_MAX_FOLDERS]]
    inner = (place / name for place in places for name in safe_file.names_if_any(place))
    deeper = itertools.islice(inner, _MAX_FOLDERS)
    return any(safe_file.is_regular(each / "package.xml") for each in (*places, *deeper))


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
    """Return the name of a file as a module.

    Its folders up to the first without ``__init__.py`` count.

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


def read_python_file(source: Path, folder: Path | None = None) -> ast.Module | None:
    """Return the syntax tree of a Python file, or None if it cannot be read.

    Args:
        source: the file.
        folder: where the file must be; by default anywhere.
    """
    folders = None if folder is None else (folder,)
    try:
        content = safe_file.read_bytes(source, max_bytes=MAX_PYTHON_BYTES, folders=folders)
        return _parsed(content) if len(content) <= _MAX_KEPT_BYTES else ast.parse(content)
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return None


@lru_cache(maxsize=8)
def _parsed(content: bytes) -> ast.Module:
    """Return the tree of a text that many specs name, or that an editor reads again and again."""
    return ast.parse(content)


_OF_RCLPY: Final = re.compile(
    r"Node|LifecycleNode|Action(Client|Server)|(?i:qos)\w*|\w+(Policy|Executor|CallbackGroup)"
)
"""The names of rclpy that nodes use, which ``import *`` binds."""


class SourceFile:
    """A Python file, and what the names in it mean, as far as its text alone determines that.

    A name means what an import says only if nothing else in the file binds it.

    Attributes:
        tree: its syntax.
        path: absolute; None for a text of which nothing else is known.
        read: reads another file of its package; None if it may not be read.
    """

    def __init__(
        self, tree: ast.Module, path: Path | None = None, read: ReadSource = lambda _: None
    ) -> None:
        self.tree = tree
        self.path = path
        self.read = read
        self._imports: dict[str, set[tuple[int, str, str]]] = defaultdict(set)
        self._lines: dict[str, int] = {}
        self._stars: dict[str, int] = {}
        self._bound: dict[str, list[ast.AST]] = defaultdict(list)
        for node in ast.walk(tree):
            for name in _bound_names(node):
                self._bound[name].append(node)
            if isinstance(node, ast.Import | ast.ImportFrom):
                self._add_import(node)

    def _add_import(self, node: ast.Import | ast.ImportFrom) -> None:
        for alias in node.names:
            name = alias.asname or alias.name.partition(".")[0]
            self._lines[name] = node.lineno
            if isinstance(node, ast.Import):
                self._imports[name].add((0, "", alias.name if alias.asname else name))
            elif alias.name == "*":
                self._stars["." * node.level + (node.module or "")] = node.lineno
            else:
                self._imports[name].add((node.level, node.module or "", alias.name))

    def definition(self, name: str) -> ast.FunctionDef | ast.ClassDef | None:
        """Return the function or class at the top level, if nothing else binds its name."""
        match self._bound.get(name):
            case [ast.FunctionDef() | ast.ClassDef() as only] if only in self.tree.body:
                return None if name in self._imports else only
        return None

    def constant(self, name: str) -> ast.expr | None:
        """Return the value of a variable at the top level, if nothing else binds its name."""
        if name in self._imports or len(self._bound.get(name, ())) != 1:
            return None
        for statement in self.tree.body:
            match statement:
                case (
                    ast.Assign(targets=[ast.Name(id=target)], value=value)
                    | ast.AnnAssign(target=ast.Name(id=target), value=value)
                ) if target == name:
                    return value
        return None

    def full_name(self, node: ast.expr) -> str:
        """Return the full name of an imported object, such as ``rclpy.node.Node``.

        Empty if unknown.
        """
        if isinstance(node, ast.Attribute):
            above = self.full_name(node.value)
            return f"{above}.{node.attr}" if above else ""
        if not isinstance(node, ast.Name) or node.id in self._bound:
            return ""
        if node.id not in self._imports:
            return self._starred(node.id)
        origin = self._origin(node.id)
        full = "" if origin is None or origin[0] else ".".join(filter(None, origin[1:]))
        # A later ``import *`` may bind another type of the same name.
        is_hidden = _has_types(full) and any(
            line > self._lines[node.id] and _has_types(module)
            for module, line in self._stars.items()
        )
        return "" if is_hidden else full

    def _starred(self, name: str) -> str:
        """Return the full name of what the only possible ``import *`` binds."""
        is_of_rclpy = _OF_RCLPY.fullmatch(name) is not None
        modules = [
            module
            for module in self._stars
            if (module.startswith("rclpy") if is_of_rclpy else not module.startswith("rclpy"))
        ]
        return f"{modules[0]}.{name}" if len(modules) == 1 else ""

    def _origin(self, name: str) -> tuple[int, str, str] | None:
        """Return level, module and name of the only import that binds a name."""
        origins = self._imports.get(name, set())
        return next(iter(origins)) if len(origins) == 1 and name not in self._bound else None

    def imported(self, name: str) -> tuple[SourceFile, str] | None:
        """Return the file of the same package from which a name is imported, and its name there."""
        origin = self._origin(name)
        place = None
        if origin is not None and self.path is not None and (origin[0] or origin[1]):
            place = _module_file(self.path, origin[0], origin[1])
        tree = None if place is None else self.read(place)
        if origin is None or tree is None:
            return None
        return SourceFile(tree, place, self.read), origin[2]


class Definition(NamedTuple):
    """A class or a function, and the file that defines it."""

    file: SourceFile
    node: ast.ClassDef | ast.FunctionDef


def find_definition(file: SourceFile, name: str) -> Definition | None:
    """Return the definition of a top-level name of a file, following imports."""
    for _ in range(MAX_BASE_CLASSES):
        if (node := file.definition(name)) is not None:
            return Definition(file, node)
        imported = file.imported(name)
        if imported is None:
            return None
        file, name = imported
    return None


def _has_types(module: str) -> bool:
    """Return whether a module, or that of a full name, has the types of a package."""
    return module.split(".")[1:2] in (["msg"], ["srv"], ["action"])


def _bound_names(node: ast.AST) -> Iterator[str]:
    """Yield the names that a node binds or changes, other than by an import."""
    match node:
        case (
            ast.Name(id=name, ctx=ast.Store() | ast.Del())
            | ast.Attribute(value=ast.Name(id=name), ctx=ast.Store())
            | ast.ExceptHandler(name=str(name))
            | ast.MatchAs(name=str(name))
            | ast.MatchStar(name=str(name))
            | ast.MatchMapping(rest=str(name))
        ):
            yield name
        case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
            yield node.name
        case ast.arg():
            yield node.arg


def _module_file(importing: Path, level: int, module: str) -> Path | None:
    """Return the file of a module of the same package, or beside it; None if there is none."""
    folder = importing.parent if level else module_of(importing).folder
    for _ in range(level - 1):
        folder = folder.parent
    place = folder.joinpath(*module.split(".")) if module else folder
    files = (place.with_name(f"{place.name}.py"), place / "__init__.py")
    return next((file for file in files if file.is_file()), None)
