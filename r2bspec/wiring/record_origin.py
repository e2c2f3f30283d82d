"""What a recorded interface was recorded from, so that it is not used for anything else.

A node of another spec may have the same key, and a node may change after it was recorded.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec

from r2bspec.language.spec import Node
from r2bspec.untrusted import safe_file

_MAX_FILE_BYTES = 64_000_000


class RecordOrigin(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What an interface was recorded from.

    Attributes:
        target: the node as the spec names it: its class, its package and plugin, or its command.
        sha256: of its files in the folder of the spec; empty if there are none.
        version: of its ROS package; empty if unknown.
    """

    target: str = ""
    sha256: str = ""
    version: str = ""


def node_target(node: Node) -> str:
    """A node as the spec names it."""
    if node.package:
        return f"{node.package} {node.plugin or node.executable}"
    import shlex

    return node.python or shlex.join(node.command)


def files_digest(node: Node, base_dir: Path) -> str:
    """SHA-256 of the files of a node in the folder of its spec; empty if there are none."""
    import hashlib

    digest = hashlib.sha256()
    found = False
    for name in _files(node):
        try:
            data = safe_file.read_bytes(
                base_dir / name, max_bytes=_MAX_FILE_BYTES, folders=(base_dir,)
            )
        except (OSError, ValueError):
            continue
        found = True
        digest.update(hashlib.sha256(data).digest())
    return digest.hexdigest() if found else ""


def _files(node: Node) -> Iterator[str]:
    place, colon, _ = node.python.rpartition(":")
    if colon:
        yield place
    yield from (word for word in node.command if "/" in word or word.endswith(".py"))


def difference(origin: RecordOrigin, node: Node, base_dir: Path) -> str:
    """Why a recorded interface is not that of a node; empty if it may be.

    The version of a package is not compared here: it differs between machines.
    """
    target = node_target(node)
    if origin.target != target:
        return f"it was recorded from {origin.target!r}, and the node is {target!r}"
    if origin.sha256 and origin.sha256 != files_digest(node, base_dir):
        return f"{target!r} has changed since it was recorded"
    return ""
