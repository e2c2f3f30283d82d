"""The identity of the graph of a plan: of each node, the files that its process uses.

Before a run these are the files that the plan names: of a Python node its file and the Python files
beside it, of a program or a component the file, or the sources of its package where these lie in
the work tree, because what is built of them changes with the place of the build. After a run they
are the files that the processes have really loaded (`observed_identity`). What is installed is
known by the versions of its packages.

Nothing is executed, and nothing of the graph is imported. Files are looked up as the processes of
the run would: relative to the folder of the spec, on ``PATH``, ``PYTHONPATH`` and in the ament
index, with the environment as it now is. What cannot be known is said in `NodeIdentity.unknown`
instead of being left out.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import islice
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.execute.identity.installed_python import (
    entry_module,
    installed_version,
    is_installed,
    module_path,
    python_beside,
    version_changes,
)
from r2bspec.execute.processes.elf import ELF
from r2bspec.plan.command_lines import EXECUTABLE, INCLUDED_LAUNCH
from r2bspec.plan.installed_packages import ament_packages, package_share, package_version
from r2bspec.plan.plan import NodePlan, Plan, ProcessPlan
from r2bspec.plan.this_machine import AMENT_INDEX, ament_prefixes
from r2bspec.record.graph_identity import (
    FileDigest,
    GraphIdentity,
    NodeIdentity,
    Revision,
    identity_digest,
    node_digest,
)
from r2bspec.safe_io.file_search import walk
from r2bspec.safe_io.git import find_work_tree, inspect_work_tree
from r2bspec.safe_io.limits import (
    MAX_DIGEST_BYTES,
    MAX_IDENTITY_TEXT_BYTES,
    MAX_MANIFEST_BYTES,
    MAX_NAME_CHARACTERS,
)
from r2bspec.safe_io.safe_file import is_regular, open_regular, read_bytes

_PYTHON_PROGRAM: Final = re.compile(rb"#![^\n]*\bpython[0-9.]*\b")
_PYTHON_INTERPRETER: Final = re.compile(r"(?:.*/)?python[0-9.]*|\$\(python\)")
_ENTRY_SCRIPT: Final = re.compile(
    rb"""['"](?P<name>[\w.-]+)(?:==[^'"]*)?['"],\s*['"](?P<group>\w+)['"],\s*['"](?P<entry>[^'"]+)['"]"""
)
"""What a program that was installed with an entry point says of it: distribution, group, name."""
_QUOTED: Final = re.compile(r"""["']([^"'\n]{1,300})["']""")
_PODMAN_FILE: Final = Path("/run/.containerenv")
_PODMAN_IMAGE: Final = re.compile(rb'(?m)^imageid="([^"\n]+)"')
_IMAGE_VARIABLES: Final = ("CI_JOB_IMAGE", "DEVCONTAINER_IMAGE")


class FileDigests:
    """The digests of files of one run; each file is read once.

    Args:
        top: the folder that paths are relative to.
    """

    def __init__(self, top: Path) -> None:
        self._top = os.path.realpath(top)
        self._digests: dict[str, str] = {}
        self._real_folder = cache(os.path.realpath)

    def digest(self, path: Path) -> FileDigest | None:
        """The digest of a file; None if it cannot be read.

        Links are followed: a file that is linked into an installation has its name in the sources.
        """
        place = self.real_path(path)
        if place not in self._digests:
            try:
                self._digests[place] = file_sha256(Path(place))
            except OSError:
                return None
        return FileDigest(self.shown(place), self._digests[place])

    def real_path(self, path: Path) -> str:
        """A path without links; of the files of one folder, its links are resolved once."""
        folder, name = os.path.split(path)
        if name in {"", ".", ".."}:
            return os.path.realpath(path)
        place = os.path.join(self._real_folder(folder), name)  # noqa: PTH118 - for many files
        return os.path.realpath(place) if os.path.islink(place) else place  # noqa: PTH114

    def shown(self, place: str) -> str:
        """A path without links, as `FileDigest` has it."""
        inside = place.startswith(f"{self._top}/")
        return place[len(self._top) + 1 :] if inside else place

    def is_inside(self, path: Path) -> bool:
        """Whether a file is one of the work tree, after all links."""
        return self.real_path(path).startswith(f"{self._top}/")


def file_sha256(path: Path) -> str:
    """The digest of the content of a regular file.

    Raises:
        OSError: it is none, is larger than half a gigabyte, or cannot be read.
    """
    with open_regular(path) as file:
        if os.fstat(file.fileno()).st_size > MAX_DIGEST_BYTES:
            raise OSError(f"{path} is too large for a digest")
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def is_elf(path: Path) -> bool:
    """Whether a file is an executable or a library of this system."""
    try:
        with open_regular(path) as file:
            return file.read(len(ELF)) == ELF
    except OSError:
        return False


_MANIFEST: Final = "package.xml"

_MAX_DEPTH: Final = 6
_MAX_FOLDERS: Final = 5_000
_MAX_FILES: Final = 5_000
_NAME: Final = re.compile(rb"<name>\s*([A-Za-z0-9_-]+)\s*</name>")
_DEPENDENCY: Final = re.compile(
    rb"<(?:build_|exec_|run_|build_export_)?depend[^>]*>\s*([A-Za-z0-9_-]+)\s*<"
)
_MARKERS: Final = frozenset({"COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE"})
_NO_SOURCES: Final = frozenset({"build", "install", "log", "node_modules", "__pycache__"})
_NOT_RUN: Final = frozenset({"test", "tests", "doc", "docs", "__pycache__"})
_NOT_RUN_FILES: Final = re.compile(r"(?i)(readme|changelog|license|contributing).*|.*\.py[co]|\..*")


class WorkspacePackages:
    """The packages of one work tree, looked up when the first of them is asked for.

    Args:
        top: the top of the work tree.
    """

    def __init__(self, top: Path) -> None:
        self._top = top

    @cached_property
    def folders(self) -> dict[str, Path]:
        """The folders of the packages, by name."""
        packages: dict[str, Path] = {}
        for parent, folders, files in islice(walk(self._top), _MAX_FOLDERS):
            is_ignored = not _MARKERS.isdisjoint(files)
            if not is_ignored and _MANIFEST in files and (match := _NAME.search(_manifest(parent))):
                packages.setdefault(match[1].decode(), parent)
            depth = len(parent.relative_to(self._top).parts)
            if is_ignored or _MANIFEST in files or depth == _MAX_DEPTH:
                folders.clear()
            folders[:] = sorted(
                name for name in folders if not name.startswith(".") and name not in _NO_SOURCES
            )
        return packages

    def sources(self, package: str) -> Iterator[Path]:
        """The files of a package, and of those of the work tree that it depends on.

        Tests and documents are left out: they are no part of what runs.
        """
        waiting, seen = [package], set[str]()
        while waiting:
            name = waiting.pop()
            folder = self.folders.get(name)
            if folder is None or name in seen:
                continue
            seen.add(name)
            yield from _files_of(folder)
            waiting += [match.decode() for match in _DEPENDENCY.findall(_manifest(folder))]

    def counterpart(self, package: str, inside: str) -> Path | None:
        """The source of an installed module of a package, by its path below the installation."""
        folder = self.folders.get(package)
        places = (folder / inside, folder / "src" / inside) if folder is not None else ()
        return next(filter(is_regular, places), None)


def _manifest(folder: Path) -> bytes:
    try:
        return read_bytes(folder / _MANIFEST, max_bytes=MAX_MANIFEST_BYTES)
    except (OSError, ValueError):
        return b""


def _files_of(folder: Path) -> Iterator[Path]:
    count = 0
    for parent, folders, files in walk(folder):
        folders[:] = sorted(
            name for name in folders if name not in _NOT_RUN and not name.startswith(".")
        )
        for name in sorted(files):
            if _NOT_RUN_FILES.fullmatch(name) is None:
                yield parent / name
                count += 1
                if count >= _MAX_FILES:
                    return


def graph_identity(
    plan: Plan, base_dir: Path, *, revision: Revision | None = None, top: Path | None = None
) -> GraphIdentity:
    """What the graph of a plan is made of, here and now.

    Args:
        plan: of the run.
        base_dir: the folder of the spec, to which its paths are relative.
        revision: of the work tree; looked up in the repository that contains `base_dir` if None.
        top: the folder that paths are made relative to: by default the top of the work tree, or
            `base_dir` where there is no repository.
    """
    work_tree = find_work_tree(base_dir)
    with ThreadPoolExecutor(max_workers=1) as git:
        asked = git.submit(_revision_of, work_tree) if revision is None else None
        identify = _GraphIdentifier(base_dir, top or work_tree or base_dir)
        nodes = dict(identify.nodes(plan))
        packages = dict(sorted(identify.packages().items()))
        revision = asked.result() if asked is not None else revision
    return GraphIdentity(
        digest=identity_digest(nodes, packages), nodes=nodes, packages=packages, revision=revision
    )


def observed_identity(
    identity: GraphIdentity,
    plan: Plan,
    base_dir: Path,
    loaded: Mapping[str, Iterable[str]],
    top: Path | None = None,
) -> GraphIdentity:
    """The identity of a graph by what its processes have loaded.

    Args:
        identity: before the run.
        plan: of the run.
        base_dir: the folder of the spec.
        loaded: the files of each process, by its name.
        top: as for `graph_identity`.
    """
    identify = _GraphIdentifier(base_dir, top or find_work_tree(base_dir) or base_dir)
    nodes = dict(identity.nodes)
    for process in plan.processes:
        before = "preprocess." if process.phase == "preprocess" else ""
        for node in process.nodes:
            name = f"{before}{node.node}"
            if process.name in loaded and name in nodes:
                nodes[name] = identify.observed(nodes[name], loaded[process.name])
    packages = dict(sorted((identity.packages | identify.packages()).items()))
    digest = identity_digest(nodes, packages)
    return GraphIdentity(digest=digest, nodes=nodes, packages=packages, revision=identity.revision)


def changes_since(identity: GraphIdentity, base_dir: Path, *, is_elsewhere: bool) -> list[str]:
    """What of a graph is not as it was in an earlier run: files, and versions of packages.

    Args:
        identity: of the earlier run.
        base_dir: the folder of the spec.
        is_elsewhere: whether that was on another machine, which has other installations.
    """
    top = find_work_tree(base_dir) or base_dir
    digests = FileDigests(top)
    changes = set()
    for file in (file for node in identity.nodes.values() for file in node.files):
        if is_elsewhere and file.path.startswith("/"):
            continue
        now = digests.digest(top / file.path)
        if now is None or now.sha256 != file.sha256:
            changes.add(f"{Path(file.path).name} {'removed' if now is None else 'changed'}")
    if not is_elsewhere:
        changes |= set(version_changes(identity.packages))
    return sorted(changes)


def _revision_of(work_tree: Path | None) -> Revision | None:
    state = inspect_work_tree(work_tree) if work_tree is not None else None
    return Revision(state.commit, bool(state.changed)) if state is not None else None


@dataclass
class _Parts:
    """What is known of a node so far."""

    kind: str
    files: dict[str, FileDigest] = field(default_factory=dict)
    package: str = ""
    unknown: list[str] = field(default_factory=list)


class _GraphIdentifier:
    """Identifies the nodes of one plan; what they share is looked up once."""

    def __init__(self, base_dir: Path, top: Path) -> None:
        self._base_dir = base_dir
        self._digests = FileDigests(top)
        self._workspace = WorkspacePackages(top)
        self._version = cache(package_version)
        self._share = cache(package_share)
        self._packages: dict[str, str] = {}

    def nodes(self, plan: Plan) -> Iterator[tuple[str, NodeIdentity]]:
        """Every node of the graph and every command of the run, by its name."""
        for process in plan.processes:
            before = "preprocess." if process.phase == "preprocess" else ""
            for node in process.nodes:
                yield f"{before}{node.node}", self._identity(self._node(process, node))
        for external in plan.external:
            yield (
                external.name,
                self._identity(_Parts("external", unknown=["it is started by others"])),
            )
        for setup in plan.setup:
            parts = _Parts("setup")
            self._add_command(parts, setup.argv, self._base_dir / setup.directory)
            yield f"setup {setup.name}", self._identity(parts)
        for step in plan.after_ready:
            if step.argv:
                parts = _Parts("step")
                self._add_command(parts, step.argv, self._base_dir)
                yield f"step {step.name}", self._identity(parts)

    def packages(self) -> dict[str, str]:
        """The versions of Python, of what is installed, and of what contains all of it."""
        packages = {"python": platform.python_version(), **self._packages}
        if image := container_image():
            packages["container image"] = image
        return packages

    def observed(self, node: NodeIdentity, loaded: Iterable[str]) -> NodeIdentity:
        """The node by what its process has loaded; what is named and no Python file stays.

        What was built in the work tree is known by its sources.
        """
        parts = _Parts(node.kind, package=node.package, unknown=[node.unknown] * bool(node.unknown))
        for name in loaded:
            path = Path(name)
            if is_installed(path):
                self._packages |= installed_version(path)
            elif path.suffix == ".py":
                self._add_file(parts, path)
                self._add_counterpart(parts, path)
            elif not self._digests.is_inside(path) and is_regular(path):
                self._add_file(parts, path)
        is_python_known = any(path.endswith(".py") for path in parts.files)
        named = (file for file in node.files if not (is_python_known and file.path.endswith(".py")))
        parts.files = {file.path: file for file in named} | parts.files
        return self._identity(parts)

    def _identity(self, parts: _Parts) -> NodeIdentity:
        node = NodeIdentity(
            kind=parts.kind,
            digest="",
            files=tuple(parts.files[path] for path in sorted(parts.files)),
            package=parts.package,
            version=self._version(parts.package),
            unknown="; ".join(dict.fromkeys(parts.unknown)),
        )
        return msgspec.structs.replace(node, digest=node_digest(node))

    def _node(self, process: ProcessPlan, node: NodePlan) -> _Parts:
        parts = _Parts("command")
        if node.plugin:
            parts.kind = "plugin"
            self._add_plugin(parts, node.package, node.plugin)
        elif node.target:
            parts.kind = "python"
            self._add_target(parts, node.target)
        elif INCLUDED_LAUNCH in process.argv:
            parts.kind = "launch"
            self._add_launch(parts, process.argv)
        else:
            self._add_command(parts, process.argv, self._base_dir)
        if node.plugin or node.target:
            # A prefix, and a program of the work tree in it.
            self._add_named_files(parts, process.argv, self._base_dir)
        files = node.parameter_files
        for name in files if files is not msgspec.UNSET else ():
            self._add_file(parts, self._base_dir / name)
        return parts

    def _add_file(self, parts: _Parts, path: Path) -> None:
        digest = self._digests.digest(path)
        if digest is None:
            parts.unknown.append(f"{path} cannot be read")
        else:
            parts.files[digest.path] = digest

    def _add_target(self, parts: _Parts, target: str) -> None:
        path, colon, _ = target.rpartition(":")
        if colon:
            self._add_python(parts, (self._base_dir / path).resolve())
        else:
            self._add_module(parts, target.rpartition(".")[0])

    def _add_module(self, parts: _Parts, name: str) -> None:
        file = module_path(name)
        if file is None:
            parts.unknown.append(f"module {name} is not installed")
            return
        self._packages |= installed_version(file)
        package = name.partition(".")[0]
        if not parts.package and self._share(package):
            parts.package = package
        self._add_python(parts, file)

    def _add_python(self, parts: _Parts, file: Path) -> None:
        """A Python file with what it may import: from its folder, and from packages of ROS."""
        self._add_file(parts, file)
        if not parts.files:
            return
        for package, folder in self._workspace.folders.items():
            if file.is_relative_to(folder):
                self._add_package(parts, package)
        for path in python_beside(file):
            self._add_file(parts, path)
            self._add_counterpart(parts, path)

    def _add_counterpart(self, parts: _Parts, installed: Path) -> None:
        """The source that a module was installed from, in place of the module if they are equal.

        An installation that is older than the sources has both.
        """
        folder = next(
            (parent for parent in installed.parents if parent.name == "site-packages"), None
        )
        if folder is None:
            return
        inside = installed.relative_to(folder)
        source = self._workspace.counterpart(inside.parts[0], str(inside))
        digest = self._digests.digest(source) if source is not None else None
        copy = self._digests.digest(installed)
        if digest is not None and copy is not None:
            if digest.sha256 == copy.sha256:
                parts.files.pop(copy.path, None)
            parts.files[digest.path] = digest

    def _add_plugin(self, parts: _Parts, package: str, plugin: str) -> None:
        parts.package = package
        library = _component_library(package, plugin)
        if library is None:
            parts.unknown.append(f"{package} registers no component {plugin}")
        else:
            self._add_built(parts, library, package)
            return
        self._add_package(parts, package)

    def _add_built(self, parts: _Parts, file: Path, package: str) -> None:
        """What was built of a package: its sources in the work tree, or else the file."""
        sources = list(self._workspace.sources(package))
        for path in sources or [file]:
            self._add_file(parts, path)

    def _add_package(self, parts: _Parts, package: str) -> None:
        """The sources of a ROS package that lies in the work tree."""
        for path in self._workspace.sources(package):
            self._add_file(parts, path)

    def _add_executable(self, parts: _Parts, package: str, name: str) -> None:
        parts.package = parts.package or package
        program = _installed_file(f"lib/{package}/{name}")
        if program is None:
            parts.unknown.append(f"package {package} has no executable {name} here")
            self._add_package(parts, package)
        else:
            self._add_program(parts, program, package)

    def _add_program(self, parts: _Parts, program: Path, package: str = "") -> None:
        """A file, or the sources that it is built of, or those of a program of Python."""
        if is_elf(program):
            self._add_built(parts, program, package)
            return
        self._add_file(parts, program)
        text = _read(program)
        if program.suffix != ".py" and _PYTHON_PROGRAM.match(text) is None:
            self._add_package(parts, package)
            return
        entry = _ENTRY_SCRIPT.search(text)
        words = (entry[name].decode() for name in ("name", "group", "entry")) if entry else ()
        if entry is not None and (module := entry_module(*words)):
            # The program has the version in it, but nothing that runs.
            parts.files.pop(self._digests.shown(self._digests.real_path(program)), None)
            self._add_module(parts, module)
        else:
            self._add_python(parts, program.resolve())

    def _add_command(self, parts: _Parts, argv: Sequence[str], folder: Path) -> None:
        """A command: its program, and the files of the work tree that it names.

        A program elsewhere is known by its content.
        """
        rest = [*argv]
        match rest:
            case ["ros2", "run", package, name, *_] if not package.startswith("-"):
                parts.kind = "executable"
                self._add_executable(parts, package, name)
                rest = rest[4:]
            case [first, *_] if (executable := EXECUTABLE.fullmatch(first)) is not None:
                parts.kind = "executable"
                self._add_executable(parts, executable["package"], executable["name"])
                rest = rest[1:]
            case [first, "-m", module, *_] if _PYTHON_INTERPRETER.fullmatch(first):
                self._add_module(parts, module)
            case [first, *_]:
                self._add_first_word(parts, first, folder)
                rest = rest[1:]
        self._add_named_files(parts, rest, folder)

    def _add_first_word(self, parts: _Parts, word: str, folder: Path) -> None:
        place = str(folder / word) if "/" in word else shutil.which(word)
        program = Path(place) if place is not None else None
        if program is None or not is_regular(program):
            parts.unknown.append(f"program {word} is not installed")
        elif self._digests.is_inside(program):
            self._add_program(parts, program)
        elif not _PYTHON_INTERPRETER.fullmatch(word):
            self._add_file(parts, program)

    def _add_named_files(self, parts: _Parts, words: Iterable[str], folder: Path) -> None:
        """The files of the work tree among the words of a command, also as ``key:=file``."""
        for word in words:
            if (executable := EXECUTABLE.fullmatch(word)) is not None:
                # Of a container, or after a prefix.
                if parts.kind == "command":
                    parts.kind = "executable"
                    self._add_executable(parts, executable["package"], executable["name"])
                continue
            for name in dict.fromkeys((word, word.rpartition("=")[2])):
                if not name or name.startswith("$(") or len(name) > MAX_NAME_CHARACTERS:
                    continue
                path = folder / name
                if is_regular(path) and self._digests.is_inside(path):
                    self._add_program(parts, path)

    def _add_launch(self, parts: _Parts, argv: Sequence[str]) -> None:
        """A launch file, what it names beside it, and the packages of the work tree in its text.

        What it starts is decided when it is executed: that is not known.
        """
        places = dict(word.split(":=", 1) for word in argv if ":=" in word)
        name, package = places.get("file", ""), places.get("package", "")
        share = self._share(package) if package else self._base_dir
        parts.package = package
        file = share / name if share is not None else None
        if file is None or not is_regular(file):
            parts.unknown.append(f"launch file {name} is not installed")
            return
        self._add_file(parts, file)
        if package:
            self._add_package(parts, package)
        text = _read(file).decode(errors="replace")
        installed = ament_packages() | self._workspace.folders.keys()
        for quoted in dict.fromkeys(_QUOTED.findall(text)):
            if quoted in installed:
                self._add_package(parts, quoted)
            elif "." in quoted and is_regular(path := file.parent / quoted):
                self._add_file(parts, path)
        parts.unknown.append("what a launch file starts is decided when it is executed")


def _installed_file(inside: str) -> Path | None:
    """A file of the ROS packages, in the first prefix that has it, by its path below the prefix."""
    files = (prefix / inside for prefix in ament_prefixes())
    return next((file for file in files if file.exists()), None)


def _component_library(package: str, plugin: str) -> Path | None:
    """The library that the index names for a component; None if it names none."""
    inside = f"{AMENT_INDEX}/rclcpp_components/{package}"
    index = _installed_file(inside)
    if index is not None:
        for line in _read(index).decode(errors="replace").splitlines():
            name, _, library = map(str.strip, line.partition(";"))
            if name == plugin and library:
                return Path(str(index).removesuffix(inside), library)
    return None


def container_image() -> str:
    """The image of the container that this process runs in, as far as it can know; else empty.

    Podman writes the id into a file, and some pipelines set a variable. Docker says nothing.
    """
    match = _PODMAN_IMAGE.search(_read(_PODMAN_FILE))
    if match is not None:
        return match[1].decode(errors="replace")
    return next((os.environ[name] for name in _IMAGE_VARIABLES if os.environ.get(name)), "")


def _read(path: Path) -> bytes:
    with contextlib.suppress(OSError, ValueError):
        return read_bytes(path, max_bytes=MAX_IDENTITY_TEXT_BYTES)
    return b""
