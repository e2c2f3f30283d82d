"""The identity of the graph of a plan: for each node, the files that its process uses.

Before a run these are the files of the work tree that the plan names: the file of a Python node;
files among the words of a command; parameter files and launch files; and for a program or component
from a package of the work tree the sources of that package, because build products change with the
folder of the build. After a run it is the files that the processes have really loaded
(`observed_identity`). Installed files are identified by the versions of their packages.

Nothing is executed, and nothing of the graph is imported.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import islice
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.execute.identity.installed_python import (
    installed_version,
    is_installed,
    version_changes,
)
from r2bspec.plan.command_lines import EXECUTABLE, INCLUDED_LAUNCH
from r2bspec.plan.installed_packages import package_share, package_version
from r2bspec.plan.plan import NodePlan, Plan, ProcessPlan
from r2bspec.record.graph_identity import (
    FileDigest,
    GraphIdentity,
    NodeIdentity,
    Revision,
    identity_digest,
    node_digest,
)
from r2bspec.safe_io.git import find_work_tree, inspect_work_tree
from r2bspec.safe_io.limits import MAX_DIGEST_BYTES, MAX_MANIFEST_BYTES, MAX_NAME_CHARACTERS
from r2bspec.safe_io.safe_file import is_regular, open_regular, read_bytes


class FileDigests:
    """The digests of files of one run; a file is read once.

    Args:
        top: the folder that paths are relative to.
    """

    def __init__(self, top: Path) -> None:
        self._top = os.path.realpath(top)
        self._digests: dict[str, str] = {}
        self._real_folder = cache(os.path.realpath)

    def digest(self, path: Path) -> FileDigest | None:
        """Return the digest of a file; None if it cannot be read.

        Links are followed: a file that is linked into an installation is named as in the sources.
        """
        place = self.real_path(path)
        if place not in self._digests:
            try:
                self._digests[place] = file_sha256(Path(place))
            except OSError:
                return None
        return FileDigest(self.shown(place), self._digests[place])

    def real_path(self, path: Path) -> str:
        """Return a path without links; the links of a folder are resolved once."""
        folder, name = os.path.split(path)
        if name in {"", ".", ".."}:
            return os.path.realpath(path)
        place = os.path.join(self._real_folder(folder), name)  # noqa: PTH118 - for many files
        return os.path.realpath(place) if os.path.islink(place) else place  # noqa: PTH114

    def shown(self, place: str) -> str:
        """Return a path without links, in the form of `FileDigest`."""
        inside = place.startswith(f"{self._top}/")
        return place[len(self._top) + 1 :] if inside else place

    def is_inside(self, path: Path) -> bool:
        """Return True if a file, after all links, is in the work tree."""
        return self.real_path(path).startswith(f"{self._top}/")


def file_sha256(path: Path) -> str:
    """Return the digest of the content of a regular file.

    Raises:
        OSError: it is none, is larger than half a gigabyte, or cannot be read.
    """
    with open_regular(path) as file:
        if os.fstat(file.fileno()).st_size > MAX_DIGEST_BYTES:
            raise OSError(f"{path} is too large for a digest")
        return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


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
    """The packages of a work tree, looked up on first use.

    Args:
        top: the top of the work tree.
    """

    def __init__(self, top: Path) -> None:
        self._top = top

    @cached_property
    def folders(self) -> dict[str, Path]:
        """The folders of the packages, by name."""
        packages: dict[str, Path] = {}
        for place, folders, files in islice(os.walk(self._top), _MAX_FOLDERS):
            parent = Path(place)
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
        """Yield the files of a package and of the packages of the work tree that it depends on.

        Tests and documents are left out, because they do not run.
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


def _manifest(folder: Path) -> bytes:
    try:
        return read_bytes(folder / _MANIFEST, max_bytes=MAX_MANIFEST_BYTES)
    except (OSError, ValueError):
        return b""


def _files_of(folder: Path) -> Iterator[Path]:
    count = 0
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(
            name for name in folders if name not in _NOT_RUN and not name.startswith(".")
        )
        for name in sorted(files):
            if _NOT_RUN_FILES.fullmatch(name) is None:
                yield Path(parent, name)
                count += 1
                if count >= _MAX_FILES:
                    return


def graph_identity(
    plan: Plan, base_dir: Path, *, revision: Revision | None = None, top: Path | None = None
) -> GraphIdentity:
    """Return the identity of the graph of a plan as it is now on this machine.

    Args:
        plan: the plan of the run.
        base_dir: the folder of the spec, to which its paths are relative.
        revision: the revision of the work tree; looked up in the repository that contains
            `base_dir` if None.
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
    """Return the identity of a graph from the files that its processes have loaded.

    Args:
        identity: before the run.
        plan: the plan of the run.
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
    """Return the files and package versions of a graph that differ from an earlier run.

    Args:
        identity: the identity of the earlier run.
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
        self._packages: dict[str, str] = {}

    def nodes(self, plan: Plan) -> Iterator[tuple[str, NodeIdentity]]:
        """Yield every node of the graph and every command of the run, by its name."""
        for process in plan.processes:
            before = "preprocess." if process.phase == "preprocess" else ""
            for node in process.nodes:
                yield f"{before}{node.node}", self._identity(self._node(process, node))
        for external in plan.external:
            parts = _Parts("external", unknown=["it is started by others"])
            yield external.name, self._identity(parts)
        for setup in plan.setup:
            parts = _Parts("setup")
            self._add_words(parts, setup.argv, self._base_dir / setup.directory)
            yield f"setup {setup.name}", self._identity(parts)
        for step in plan.after_ready:
            if step.argv:
                parts = _Parts("step")
                self._add_words(parts, step.argv, self._base_dir)
                yield f"step {step.name}", self._identity(parts)

    def packages(self) -> dict[str, str]:
        """Return the versions of Python, and of what is installed and was loaded."""
        return {"python": platform.python_version(), **self._packages}

    def observed(self, node: NodeIdentity, loaded: Iterable[str]) -> NodeIdentity:
        """Return the node by what its process has loaded; what the plan names stays.

        What was built in the work tree is known by its sources.
        """
        parts = _Parts(node.kind, package=node.package, unknown=[node.unknown] * bool(node.unknown))
        parts.files = {file.path: file for file in node.files}
        for name in loaded:
            path = Path(name)
            if is_installed(path):
                self._packages |= installed_version(path)
            elif path.suffix == ".py" or (not self._digests.is_inside(path) and is_regular(path)):
                self._add_file(parts, path)
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
            self._add_package(parts, node.package)
        elif node.target:
            parts.kind = "python"
            path, colon, _ = node.target.rpartition(":")
            if colon:
                self._add_file(parts, (self._base_dir / path).resolve())
            elif package_share(package := node.target.partition(".")[0]):
                parts.package = package
        elif INCLUDED_LAUNCH in process.argv:
            parts.kind = "launch"
            self._add_launch(parts, process.argv)
        # Of a node in a process of the harness: a prefix, and a program of the work tree in it.
        self._add_words(parts, process.argv, self._base_dir)
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

    def _add_package(self, parts: _Parts, package: str) -> None:
        """A ROS package, with its sources where it lies in the work tree."""
        parts.package = parts.package or package
        for path in self._workspace.sources(package):
            self._add_file(parts, path)

    def _add_words(self, parts: _Parts, words: Sequence[str], folder: Path) -> None:
        """The programs and the files of the work tree in a command, also as ``key:=file``."""
        if [*words[:2]] == ["ros2", "run"] and len(words) > 3:
            words = (f"$(executable {words[2]} {words[3]})", *words[4:])
        for word in words:
            if (executable := EXECUTABLE.fullmatch(word)) is not None:
                # Of a container, the program is no part of its components.
                if parts.kind in {"command", "setup", "step"}:
                    parts.kind = "executable" if parts.kind == "command" else parts.kind
                    self._add_package(parts, executable["package"])
                continue
            for name in dict.fromkeys((word, word.rpartition("=")[2])):
                path = folder / name
                if not name or name.startswith("$(") or len(name) > MAX_NAME_CHARACTERS:
                    continue
                if is_regular(path) and self._digests.is_inside(path):
                    self._add_file(parts, path)

    def _add_launch(self, parts: _Parts, argv: Sequence[str]) -> None:
        """A launch file, and its package where that lies in the work tree."""
        places = dict(word.split(":=", 1) for word in argv if ":=" in word)
        name, package = places.get("file", ""), places.get("package", "")
        share = package_share(package) if package else self._base_dir
        file = share / name if share is not None else None
        if file is None or not is_regular(file):
            parts.unknown.append(f"launch file {name} is not installed")
            return
        self._add_file(parts, file)
        if package:
            self._add_package(parts, package)
        parts.unknown.append("what a launch file starts is decided when it is executed")
