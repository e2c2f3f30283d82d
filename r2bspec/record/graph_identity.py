"""What a graph consists of: the files of its nodes, the packages that they load, the revision.

A plan says what is run, and is the same on every machine. Which code was run is an observation, and
belongs to the record. Digests do not depend on where a work tree lies, so that two work trees with
the same code have the same identity. The revision is for people: a commit that changes nothing of
the graph does not change its identity.

What was really in the processes of
a graph is in ``loaded_files.json`` of a run folder: mapped files (programs, libraries, extension
modules) and modules of Python. A node that took a module from elsewhere shows there.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any, Final

import msgspec

_SHOWN_COMMIT_DIGITS: Final = 7


class FileDigest(msgspec.Struct, frozen=True):
    """A file of a node.

    Attributes:
        path: relative to the top of the work tree, or to the folder of the spec where there is no
            repository; absolute for a file outside of it.
        sha256: of its content, in hexadecimal digits.
    """

    path: str
    sha256: str


class Revision(msgspec.Struct, frozen=True):
    """A revision of a work tree.

    Attributes:
        commit: its full name; empty before the first commit.
        dirty: whether tracked files differ from it.
        name: what the user called it, such as ``origin/main``; empty for what is checked out.
    """

    commit: str
    dirty: bool
    name: str = ""


class NodeIdentity(msgspec.Struct, frozen=True, kw_only=True):
    """The identity of a node: its files, programs and packages.

    Attributes:
        kind: ``python``, ``plugin``, ``executable``, ``command``, ``launch`` or ``external``, and
            ``setup`` or ``step`` for a command before or after the start.
        digest: over everything but the paths; empty if nothing is known.
        files: its launch files, parameter files, what its command names, and what its process
            has loaded and is not installed, sorted by path.
        package: the ROS package that it is from.
        version: the version of the package.
        unknown: why it is not known, or not completely.
    """

    kind: str
    digest: str
    files: tuple[FileDigest, ...] = ()
    package: str = ""
    version: str = ""
    unknown: str = ""


class GraphIdentity(msgspec.Struct, frozen=True, kw_only=True):
    """The identity of a graph: its nodes, packages and revision.

    Attributes:
        digest: over all nodes and packages; the revision does not count.
        nodes: by their keys in the spec; those of a preprocessor begin with ``preprocess.``, those
            of a command with ``setup `` or ``step ``.
        packages: versions of what is installed and loaded, by distribution, and of the container.
        revision: the revision of the work tree that holds the spec; None outside of a repository.
    """

    digest: str
    nodes: dict[str, NodeIdentity]
    packages: dict[str, str] = {}
    revision: Revision | None = None


def node_digest(node: NodeIdentity) -> str:
    """Return the digest of a node, over everything in it except the paths of its files."""
    if not (node.files or node.version):
        return ""
    return _digest([node.kind, _contents(node), node.package, node.version])


def identity_digest(nodes: Mapping[str, NodeIdentity], packages: Mapping[str, str]) -> str:
    """Return the digest of a graph."""
    contents = {name: [node.kind, node.digest] for name, node in nodes.items()}
    return _digest([sorted(contents.items()), sorted(packages.items())])


def _digest(value: object) -> str:
    return hashlib.sha256(msgspec.json.encode(value)).hexdigest()


def revision_text(revision: Revision | None) -> str:
    """Return a revision in a few words: ``3f2a1c4+dirty`` or ``origin/main@9b1e44f``.

    Empty for None.
    """
    if revision is None:
        return ""
    text = revision.commit[:_SHOWN_COMMIT_DIGITS] or "no commit"
    if revision.name and not revision.commit.startswith(revision.name):
        text = f"{revision.name}@{text}"
    return f"{text}+dirty" if revision.dirty else text


def common_identity(identities: Iterable[GraphIdentity | None]) -> GraphIdentity | None:
    """Return one identity for several runs of the same code; None if a file or a version differs.

    A node may load a file in some starts only.
    """
    first, *others = [*identities] or [None]
    for other in others:
        if first is None or other is None:
            return None
        if other.digest != first.digest:
            first = _merged(first, other)
    return first


def _merged(first: GraphIdentity, other: GraphIdentity) -> GraphIdentity | None:
    nodes = dict(first.nodes)
    for name, node in other.nodes.items():
        files = {file.path: file for file in (*nodes.get(name, node).files, *node.files)}
        merged = msgspec.structs.replace(node, files=tuple(files[path] for path in sorted(files)))
        nodes[name] = msgspec.structs.replace(merged, digest=node_digest(merged))
    packages = {**first.packages, **other.packages}
    merged_files = _files(first) | _files(other)
    is_same = _files(first).items() <= merged_files.items()
    if not (is_same and first.packages.items() <= packages.items()):
        return None
    digest = identity_digest(nodes, packages)
    return GraphIdentity(digest=digest, nodes=nodes, packages=packages, revision=first.revision)


def identity_differences(base: GraphIdentity, head: GraphIdentity) -> tuple[str, ...]:
    """Return the differences of base and head: ``blur.py changed``, ``numpy 2.1 → 2.2``.

    Those of nodes come first. A file that several nodes have in common is named once. Files outside
    of the work tree are matched by their content and their names, because the two sides have them
    in different places.
    """
    if base.digest == head.digest:
        return ()
    texts: list[str] = []
    for name in sorted(base.nodes.keys() | head.nodes.keys()):
        texts += _node_differences(name, base.nodes.get(name), head.nodes.get(name))
    return (
        *sorted({*texts, *_file_changes(_files(base), _files(head))}),
        *sorted(_version_changes(base.packages, head.packages)),
    )


def _node_differences(
    name: str, base: NodeIdentity | None, head: NodeIdentity | None
) -> Iterator[str]:
    """Yield what differs in one node, except for its files."""
    if base is None or head is None:
        yield f"{name} {'added' if base is None else 'removed'}"
        return
    if base.kind != head.kind:
        yield f"{name}: {base.kind} → {head.kind}"
    if (base.package, base.version) != (head.package, head.version):
        yield from _version_changes({base.package: base.version}, {head.package: head.version})


def _contents(node: NodeIdentity) -> list[tuple[str, str]]:
    """Return the names and the digests of the files of a node."""
    return sorted((PurePosixPath(file.path).name, file.sha256) for file in node.files)


def _version_changes(base: Mapping[str, str], head: Mapping[str, str]) -> Iterator[str]:
    for name in base.keys() | head.keys():
        before, after = base.get(name), head.get(name)
        if not name or before == after:
            continue
        if before is None:
            yield f"{name} {after} added"
        elif after is None:
            yield f"{name} {before} removed"
        else:
            yield f"{name} {before or 'unknown'} → {after or 'unknown'}"


def _files(identity: GraphIdentity) -> dict[str, str]:
    return {file.path: file.sha256 for node in identity.nodes.values() for file in node.files}


def _file_changes(base: dict[str, str], head: dict[str, str]) -> Iterator[str]:
    """Yield the files that changed, came or went.

    By their last names where these are unambiguous.
    """
    changed = {path for path in base.keys() & head.keys() if base[path] != head[path]}
    removed = base.keys() - head.keys()
    added = head.keys() - base.keys()
    for path in sorted(removed):
        # The same file in another place, first with the same content, then with another one.
        alike = [path_ for path_ in sorted(added) if _name(path_) == _name(path)]
        same = [path_ for path_ in alike if head[path_] == base[path]]
        if same or len(alike) == 1:
            moved = (same or alike)[0]
            removed, added = removed - {path}, added - {moved}
            if not same:
                changed.add(moved)
    groups = {"changed": changed, "added": added, "removed": removed}
    names = Counter(_name(path) for paths in groups.values() for path in paths)
    for what, paths in groups.items():
        for path in paths:
            yield f"{_name(path) if names[_name(path)] == 1 else path} {what}"


def _name(path: str) -> str:
    return PurePosixPath(path).name


MACHINE_FACTS: Final = (
    "architecture",
    "cpu",
    "cores",
    "cpu_quota",
    "gpus",
    "cpu_governor",
)
"""The facts that determine the speed of a machine and are constant over time. They do not include
the host name: machines of one kind are interchangeable, as in a pool of CI runners."""


def check_machine_facts(machine: Mapping[str, Any]) -> None:
    """Check the types of the facts of a machine that are used in calculations.

    Args:
        machine: as in `RunRecord.machine`.

    Raises:
        ValueError: a number is none, or the GPUs are no list.
    """
    for name in ("cores", "threads_per_core", "memory_bytes"):
        value = machine.get(name)
        if value is not None and not (isinstance(value, int) and value > 0):
            raise ValueError(f"machine.{name} is no number above 0")
    if not isinstance(machine.get("gpus") or [], list):
        raise ValueError("machine.gpus is no list")
