"""A run folder as one archive: packed on its host, unpacked by the client."""

from __future__ import annotations

import os
import tarfile
from pathlib import Path
from typing import Final

from r2bspec.fleet.errors import TransferError

_COMPRESSION: Final = 1
"""Samples and logs shrink to a fraction even so; the time is taken after the run, not during it."""
_MAX_RUN_BYTES: Final = 64 << 30


def pack(folder: Path, archive: Path) -> None:
    """Write a run folder into an archive.

    Args:
        folder: with files and folders only; anything else is left out.
        archive: a new file.
    """
    with tarfile.open(archive, "w:gz", compresslevel=_COMPRESSION) as tar:
        tar.add(folder, arcname=".", recursive=True, filter=_plain)


def _plain(entry: tarfile.TarInfo) -> tarfile.TarInfo | None:
    """Files and folders, without the names and numbers of users; nothing else is in a run."""
    if not (entry.isfile() or entry.isdir()):
        return None
    entry.uid = entry.gid = 0
    entry.uname = entry.gname = ""
    return entry


def unpack(archive: Path, target: Path) -> None:
    """Unpack plain files and folders only.

    Raises:
        TransferError: the archive has something else, or leads out of the folder.
    """
    target.mkdir(mode=0o700)
    total = 0
    try:
        with tarfile.open(archive, "r:gz") as tar:
            for entry in tar:
                total += entry.size
                if not (entry.isfile() or entry.isdir()) or total > _MAX_RUN_BYTES:
                    raise TransferError(f"the archive of a run has the entry {entry.name!r}")
                tar.extract(entry, target, filter="data")
    except tarfile.TarError as error:
        raise TransferError(f"the archive of a run is damaged: {error}") from error
    for parent, folders, files in os.walk(target):
        for name in folders:
            Path(parent, name).chmod(0o700)
        for name in files:
            Path(parent, name).chmod(0o600)
