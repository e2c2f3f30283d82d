"""The environment of the base: search paths to the code of the head lead to that of the base.

The head runs in the environment of this process. In it, search paths (PYTHONPATH, PATH, an overlay
of colcon), and packages that are installed as editable, lead into the work tree of the head. A run
of the base that kept them would run the head's code, and find no difference. So

- an entry of a search path in the head's work tree becomes the same folder of the base, or goes if
  the base has none;
- a package that is installed as editable from the head's work tree is found in the base first;
- an overlay that was built from the head's work tree, and a package that was installed from it as
  a copy, cannot be turned into the base's. They go if the base is built
  (``benchmark.gate.base``), and are an error otherwise.

What the processes have really loaded is checked after each run (`r2bspec.compare.merge_gate`).
What serves both sides, r2bspec itself and the environment in which it runs, must not be of the
change (`check_tools`).

Then the base becomes what runs: its build commands, and the environment that its setup makes.
Which commands these are is the base's own matter: its version of ``benchmark.gate.base`` counts, so
that a change cannot decide how it is compared.
"""

from __future__ import annotations

import ast
import importlib.metadata
import json
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote, urlsplit

from r2bspec.compare.base_tree import BaseRevisionError, BaseTree
from r2bspec.diagnostics.quote import clip
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.execute.processes.bounded_command import run_bounded
from r2bspec.execute.processes.environment import applied_environment, workspace_environment
from r2bspec.execute.states import Interrupts, Progress
from r2bspec.language.spec import GateBase
from r2bspec.safe_io import git
from r2bspec.safe_io.limits import MAX_PATH_FILE_BYTES
from r2bspec.safe_io.safe_file import names_in

SEARCH_PATHS = (
    *("PYTHONPATH", "PATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH"),
    *("CMAKE_PREFIX_PATH", "PKG_CONFIG_PATH"),
)
"""The variables by which code is found: lists of folders."""

_COLCON_MARK = ".colcon_install_layout"
_FINDER = re.compile(r"__editable___.*_finder\.py")

_WAY_OUT = "Say in the spec how the base is built: benchmark.gate.base."


def base_environment(tree: BaseTree, *, built: bool) -> dict[str, str]:
    """Return the variables of the base that differ from those of this process.

    Args:
        tree: the work tree of the base.
        built: whether the base is built, so that its own overlay replaces that of the head.

    Returns:
        The variables by name; empty for one that is removed.

    Raises:
        BaseRevisionError: the base would run code of the head.
    """
    overlays = _head_overlays(tree)
    copies = [name for name, url in _installed_from(tree) if not _is_editable(url)]
    if not built and (overlays or copies):
        what = (
            f"the overlay {overlays[0]} was built from the work tree of the head"
            if overlays
            else f"the package {copies[0]} was installed from the work tree of the head"
        )
        raise BaseRevisionError(f"{what}: {tree.name} would run the head's code", hint=_WAY_OUT)
    changes = {}
    for name in SEARCH_PATHS:
        entries = [entry for entry in os.environ.get(name, "").split(os.pathsep) if entry]
        kept = (entry for entry in entries if not _is_in_any(Path(entry), overlays))
        mapped = [path for entry in kept for path in _mapped(entry, tree)]
        if name == "PYTHONPATH":
            mapped = [*dict.fromkeys([*_editable_folders(tree), *mapped])]
        if mapped != entries:
            changes[name] = os.pathsep.join(mapped)
    return changes


def is_code_of(path: Path, tree: BaseTree, side: str) -> bool:
    """Return True if a file belongs to the work tree of the base or of the head, and to no tool.

    A virtual environment in the work tree, and r2bspec itself, serve both sides.
    """
    in_base = path.is_relative_to(tree.top)
    if side == "base":
        return in_base
    return path.is_relative_to(tree.head_top) and not in_base and not _is_tool(path)


def check_tools(tree: BaseTree) -> None:
    """Refuse a change that contains the tools that compare it.

    A search path that leads into the work tree can replace a module of r2bspec by a module of the
    change, and git can have files in the virtual environment that serves both sides.

    Raises:
        BaseRevisionError: it does.
    """
    prefix = Path(sys.prefix).resolve()
    if prefix.is_relative_to(tree.head_top):
        tracked = git.output_of(tree.head_top, "ls-files", "--", str(prefix)).splitlines()
        if tracked:
            raise BaseRevisionError(
                f"git has {clip(tracked[0])}, which is in the Python environment {prefix} that "
                "both sides use",
                hint="Make the environment in a folder that git does not track.",
            )
    for name, module in sorted(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if isinstance(file, str) and is_code_of(Path(file).resolve(), tree, "head"):
            raise BaseRevisionError(
                f"r2bspec has loaded {file} of the work tree that it compares, as its own {name}",
                hint="PYTHONPATH, or 'python -m' without -P, leads there. Give the nodes their "
                "path in the spec, or install r2bspec into an environment of its own.",
            )


def _mapped(entry: str, tree: BaseTree) -> Iterator[str]:
    """Yield an entry of a search path, as the base has it; none if that does not exist."""
    path = Path(entry).resolve()
    if not is_code_of(path, tree, "head"):
        yield entry
    elif (base_path := tree.in_base(path)) is not None and base_path.exists():
        yield str(base_path)


def _is_tool(path: Path) -> bool:
    """Return True if a path belongs to the virtual environment or to r2bspec itself."""
    package = Path(__file__).resolve().parents[1]
    # The folder of the package is in a search path where r2bspec is installed as editable.
    in_tools = _is_in_any(path, (Path(sys.prefix), Path(sys.prefix).resolve(), package))
    return in_tools or path == package.parent


def _is_in_any(path: Path, folders: Iterable[Path]) -> bool:
    return any(path.is_relative_to(folder) for folder in folders)


def _head_overlays(tree: BaseTree) -> list[Path]:
    """Return the installations of colcon in the search paths whose workspace holds the head's tree.

    Those within that tree are no matter: their entries are mapped as any other.
    """
    overlays: dict[Path, None] = {}
    for name in SEARCH_PATHS:
        for entry in os.environ.get(name, "").split(os.pathsep):
            path = Path(entry).absolute()
            for folder in (path, *path.parents) if entry else ():
                if (folder / _COLCON_MARK).is_file():
                    outside = not folder.resolve().is_relative_to(tree.head_top)
                    if outside and tree.head_top.is_relative_to(folder.parent.resolve()):
                        overlays[folder] = None
                    break
    return list(overlays)


def _installed_from(tree: BaseTree) -> Iterator[tuple[str, Mapping[str, object]]]:
    """Return the distributions installed from the head's tree, by direct_url.json (PEP 610)."""
    for distribution in importlib.metadata.distributions():
        text = distribution.read_text("direct_url.json")
        if not text:
            continue
        try:
            url = json.loads(text)
            place = Path(unquote(urlsplit(str(url["url"])).path)).resolve()
        except (ValueError, KeyError, TypeError, OSError):
            continue
        name = str(distribution.metadata["Name"])
        if place.is_relative_to(tree.head_top) and name != "r2bspec":
            yield name, url


def _is_editable(url: Mapping[str, object]) -> bool:
    about = url.get("dir_info")
    return isinstance(about, dict) and about.get("editable") is True


def _editable_folders(tree: BaseTree) -> Iterator[str]:
    """Return the folders in the base of packages that are editable in the head.

    An installer writes a ``.pth`` file with the folder, or a module that maps packages to their
    folders. Modules on PYTHONPATH are found before both.
    """
    for folder in map(Path, sys.path):
        try:
            names = sorted(names_in(folder)) if folder.is_dir() else []
        except OSError:
            continue
        for name in names:
            if name.endswith(".pth"):
                places = _lines(folder / name)
            elif _FINDER.fullmatch(name):
                # Each package is found in the folder that contains its own.
                places = [str(Path(place).parent) for place in _finder_folders(folder / name)]
            else:
                continue
            for place in places:
                path = Path(place).resolve()
                mapped = tree.in_base(path) if is_code_of(path, tree, "head") else None
                if mapped is not None and mapped.exists():
                    yield str(mapped)


def _lines(file: Path) -> list[str]:
    try:
        text = file.read_bytes()[:MAX_PATH_FILE_BYTES].decode("utf-8", errors="replace")
    except OSError:
        return []
    # A line that begins with import is code: it is not executed here.
    return [line for line in text.splitlines() if line.startswith("/")]


def _finder_folders(file: Path) -> list[str]:
    """Return the folders of MAPPING, a literal in the module that setuptools writes."""
    try:
        body = ast.parse(file.read_bytes()[:MAX_PATH_FILE_BYTES]).body
    except (OSError, SyntaxError, ValueError):
        return []
    for statement in body:
        if isinstance(statement, ast.AnnAssign | ast.Assign) and statement.value is not None:
            target = (
                statement.target if isinstance(statement, ast.AnnAssign) else statement.targets[0]
            )
            if isinstance(target, ast.Name) and target.id == "MAPPING":
                try:
                    mapping = ast.literal_eval(statement.value)
                except ValueError:
                    return []
                return [str(place) for place in mapping.values()] if mapping else []
    return []


class BaseBuildError(R2bspecError):
    """The base of a gate does not build."""

    code = "R2B695"
    exit_code = ExitStatus.USAGE


@dataclass
class BaseBuilds:
    """The builds of a base, each made once for all specs that need it."""

    tree: BaseTree
    _environments: dict[GateBase, Mapping[str, str]] = field(default_factory=dict)

    def environment(self, settings: GateBase, progress: Progress) -> Mapping[str, str]:
        """Build the base if necessary; return the variables that differ from this process.

        Raises:
            BaseBuildError: a command fails, or takes too long.
            BaseRevisionError: the base would run code of the head.
            WorkspaceError: the setup does not exist, or cannot be sourced.
        """
        if settings not in self._environments:
            self._environments[settings] = self._build(settings, progress)
        return self._environments[settings]

    def _build(self, settings: GateBase, progress: Progress) -> Mapping[str, str]:
        built = bool(settings.build or settings.setup)
        environment = base_environment(self.tree, built=built)
        with applied_environment(environment):
            for command in settings.build:
                progress.note(f"building {self.tree.name}: {' '.join(command)}")
                _run(command, self.tree, settings.timeout.ns / 1e9)
        # The build may have made the folders that entries of search paths lead to.
        environment = base_environment(self.tree, built=built)
        if settings.setup:
            with applied_environment(environment):
                environment |= workspace_environment(_setup(settings.setup, self.tree))
        return environment


def _setup(text: str, tree: BaseTree) -> str:
    """Return the setup of a base: a path below its top, or a variable."""
    place = tree.top / text
    name, equals, value = text.partition("=")
    if equals and not place.exists():
        # Such as PYTHONPATH=build/base: folders of the base.
        folders = (tree.top / entry for entry in value.split(os.pathsep))
        return f"{name}={os.pathsep.join(map(str, folders))}" if name == "PYTHONPATH" else text
    return str(place)


def _run(command: Sequence[str], tree: BaseTree, timeout_s: float) -> None:
    """Run one command of a build; what it started ends with it.

    Raises:
        BaseBuildError: it fails, or takes too long.
        InterruptedRunError: a signal arrived.
    """
    with Interrupts() as interrupts:
        done = run_bounded(command, timeout_s=timeout_s, folder=tree.top, check=interrupts.check)
        interrupts.check()
    if done.problem:
        raise _failed(command, tree, done.problem, done.last_lines)


def _failed(command: Sequence[str], tree: BaseTree, what: str, tail: str = "") -> BaseBuildError:
    return BaseBuildError(
        f"{tree.name} does not build: {clip(' '.join(command))} {what}"
        + (f"; its last output:\n{tail}" if tail else ""),
        hint="Mend the base, or judge the head alone: --allow base.",
    )
