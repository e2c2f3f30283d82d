"""What a host keeps: files by their digests, and finished runs, up to a limit.

::

    objects/SHA256     a file of a bundle or a recording; SHA256.part while it arrives
    work/BUNDLE/       the files of a bundle where they are used; those of recordings are hard links
    spool/IDENTITY/    a run until its client has it

Whatever was used least recently is removed first. Everything can be removed while no run plays:
what is missing is sent again.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import gzip
import os
import shutil
import tarfile
import time
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Final

from r2bspec.bags.integrity import hash_files
from r2bspec.diagnostics.quote import quote
from r2bspec.fleet.bundle import Job, SentFile, bundle_digest, digest_of
from r2bspec.fleet.errors import TransferError
from r2bspec.safe_io.file_search import walk
from r2bspec.safe_io.limits import (
    MAX_BUNDLE_BYTES,
    MAX_BUNDLE_FILES,
    MAX_FLEET_RUN_BYTES,
    MAX_RUN_FOLDER_LEVELS,
)
from r2bspec.safe_io.private_files import remove_folder

JOB_FILE: Final = "job.json"
ENDED_FILE: Final = "ended.json"
PROGRESS_FILE: Final = "progress.json"
RUN_FOLDER: Final = "run"
"""In the folder of a run in ``spool``."""

SCRATCH: Final = "dask"
"""The folder of Dask itself."""

DEFAULT_LIMIT_BYTES: Final = 20 << 30
_KINDS: Final = ("objects", "work", "spool")
_PART: Final = ".part"
_HEADSTART_S: Final = {"spool": 86_400.0}
"""So much later counts a run as used: it would have to be played again, and not only sent."""

_COMPRESSION: Final = 1
"""Samples and logs shrink to a fraction even so; the time is taken after the run, not during it."""

FULL_DISK: Final = frozenset({errno.ENOSPC, errno.EDQUOT})
_MAX_READ_BYTES: Final = 64 << 10
"""Files are read in pieces of 16 KiB: more at once is a header."""

_POLL_S: Final = 0.2


def inside(root: Path, path: str) -> Path:
    """A place below a folder, or the folder itself for ``.``.

    Raises:
        TransferError: the path leads out of it.
    """
    parts = PurePosixPath(path).parts
    if not path or path.startswith("/") or ".." in parts or "\0" in path:
        raise TransferError(f"the path {path!r} leads out of its bundle")
    return root.joinpath(*parts)


@dataclass(frozen=True)
class HostStore:
    """The folder of a host, which belongs to one worker.

    Attributes:
        root: the folder.
        limit_bytes: the most that is kept.
        shared: folders of recordings that several hosts reach, each by its name or digest.
    """

    root: Path
    limit_bytes: int = DEFAULT_LIMIT_BYTES
    shared: tuple[Path, ...] = ()
    _verified: set[str] = field(default_factory=set)
    """The digests of objects that this process has hashed."""

    def open(self) -> None:
        """Create the folders."""
        for place in (self.root / kind for kind in _KINDS):
            # What is removed from a folder must be the store's own.
            if place.is_symlink():
                place.unlink()
            place.mkdir(mode=0o700, parents=True, exist_ok=True)

    @contextlib.contextmanager
    def locked(self, patience_s: float = 0.0) -> Iterator[int | None]:
        """Have the folder to oneself: the lock as a descriptor, or None if another one has it.

        A process that inherits the descriptor holds the lock, too: the run of a worker that was
        killed has the folder until it has ended, for which this waits.
        """
        self.open()
        deadline = time.monotonic() + patience_s
        with (self.root / ".lock").open("w") as file:
            while True:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    if time.monotonic() > deadline:
                        yield None
                        return
                    time.sleep(_POLL_S)
                else:
                    break
            yield file.fileno()

    def check(self, job: Job) -> None:
        """See that a job is what a client makes of a spec.

        Raises:
            TransferError: its files are not those of its bundle, or too many.
        """
        sizes = [file.size for file in job.files if not file.recording]
        is_too_large = sum(sizes) > MAX_BUNDLE_BYTES or len(sizes) > MAX_BUNDLE_FILES
        if is_too_large or bundle_digest(job.files) != job.bundle:
            raise TransferError(f"the files of {quote(job.name)} are not those of a bundle")

    def missing(self, job: Job) -> dict[str, int]:
        """The files that must be sent for a job, by digest: how many bytes are here already."""
        shared = self._shared(job)
        missing = {}
        for file in job.files:
            if file.recording not in shared and not self._is_here(file.sha256):
                part = self._object(f"{file.sha256}{_PART}")
                missing[file.sha256] = part.stat().st_size if part.is_file() else 0
        return missing

    def _is_here(self, sha256: str) -> bool:
        """Whether an object is here whole; one that this process did not store is hashed first."""
        kept = self._object(sha256)
        if not kept.is_file():
            return False
        if sha256 not in self._verified and digest_of(kept) != sha256:
            kept.unlink()
            return False
        self._verified.add(sha256)
        return True

    def put(self, file: SentFile, offset: int, content: bytes) -> None:
        """Write a piece of a file; the last piece verifies it.

        Raises:
            TransferError: the file is not what its digest says, and is removed; or the piece does
                not follow the one before it.
        """
        part = self._object(f"{file.sha256}{_PART}")
        arrived = part.stat().st_size if part.exists() else 0
        if offset > arrived or offset + len(content) > file.size:
            raise TransferError(f"a piece of {file.path} did not arrive as it was sent")
        with part.open("r+b" if part.exists() else "w+b") as stream:
            stream.seek(offset)
            stream.truncate()
            stream.write(content)
            size = stream.tell()
        if size < file.size:
            return
        if digest_of(part) != file.sha256:
            part.unlink()
            raise TransferError(f"{file.path} did not arrive as it was sent")
        part.chmod(0o400)
        part.replace(self._object(file.sha256))
        self._verified.add(file.sha256)

    def _object(self, name: str) -> Path:
        return inside(self.root / "objects", name)

    def _shared(self, job: Job) -> dict[str, Path]:
        """The recordings of a job that lie in a shared folder, by their digests."""
        return {
            recording.sha256: candidate
            for recording in job.recordings
            for folder in self.shared
            for candidate in (folder / recording.sha256, folder / Path(recording.path).name)
            if candidate.exists() and hash_files(candidate) == recording.sha256
        }

    def unpack(self, job: Job) -> Path:
        """The files of a job where they are used; what a run made there before stays."""
        tree = inside(self.root / "work", job.bundle)
        shared = self._shared(job)
        for file in job.files:
            if file.recording not in shared:
                self._place(file, tree)
        for recording in job.recordings:
            if recording.sha256 in shared:
                place = inside(tree, recording.path)
                remove(place)
                place.parent.mkdir(parents=True, exist_ok=True)
                place.symlink_to(shared[recording.sha256])
        for side in job.sides:
            inside(tree, side.base_dir).mkdir(parents=True, exist_ok=True)
        os.utime(tree)
        return tree

    def _place(self, file: SentFile, tree: Path) -> None:
        target = inside(tree, file.path)
        kept = self._object(file.sha256)
        os.utime(kept)
        # A link, to a shared recording or made by a run, would lead out of the tree.
        parents = PurePosixPath(file.path).parents
        for place in [tree / parent for parent in parents if (tree / parent).is_symlink()]:
            place.unlink()
        target.parent.mkdir(parents=True, exist_ok=True)
        if file.recording:
            if not target.is_file() or not target.samefile(kept):
                remove(target)
                target.hardlink_to(kept)
        elif target.is_symlink() or not target.is_file() or digest_of(target) != file.sha256:
            remove(target)
            shutil.copyfile(kept, target)
            target.chmod(0o700 if file.executable else 0o600)

    def spool(self, identity: str) -> Path:
        """The folder of a run that no client has fetched yet."""
        return inside(self.root / "spool", identity)

    def trim(self, keep: Collection[str] = ()) -> None:
        """Remove what was used least recently until the limit is kept.

        Args:
            keep: names of entries that are in use.
        """
        entries = sorted(
            (entry for kind in _KINDS for entry in (self.root / kind).iterdir()),
            key=lambda entry: entry.stat().st_mtime + _HEADSTART_S.get(entry.parent.name, 0.0),
        )
        sizes = {entry: _size(entry) for entry in entries}
        while sum(sizes.values()) > self.limit_bytes:
            removable = (entry for entry in sizes if not _is_used(entry, keep))
            if (oldest := next(removable, None)) is None:
                return
            remove(oldest)
            del sizes[oldest]


def remove(place: Path) -> None:
    """Remove a file or a folder, whatever is left of it."""
    if place.is_dir() and not place.is_symlink():
        remove_folder(place)
    else:
        place.unlink(missing_ok=True)


def _is_used(entry: Path, keep: Collection[str]) -> bool:
    """Whether an entry is to be kept, or is a file of a recording that a tree uses."""
    is_linked = entry.is_file() and entry.stat().st_nlink > 1
    return is_linked or entry.name.removesuffix(_PART) in keep


def _size(place: Path) -> int:
    """The bytes of an entry; those of a hard link in a tree are those of its object."""
    if place.is_file():
        return place.stat().st_size
    total = 0
    names = ((parent, name) for parent, folders, files in walk(place) for name in folders + files)
    for parent, name in names:
        file = parent / name
        with contextlib.suppress(OSError):
            status = file.lstat()
            total += status.st_size if status.st_nlink == 1 or file.is_dir() else 0
    return total


def pack_run(folder: Path, archive: Path) -> None:
    """Write the files and folders of a run into one archive; anything else is left out."""
    with tarfile.open(archive, "w:gz", compresslevel=_COMPRESSION) as tar:
        tar.add(folder, arcname=".", filter=_plain)


def _plain(entry: tarfile.TarInfo) -> tarfile.TarInfo | None:
    """Files and folders, without the names and numbers of users.

    A folder that a node has left may be deeper than functions are called.
    """
    if entry.name.count("/") > MAX_RUN_FOLDER_LEVELS:
        return None
    entry.uid = entry.gid = 0
    entry.uname = entry.gname = ""
    return entry if entry.isfile() or entry.isdir() else None


class _Inflated(gzip.GzipFile):
    """What an archive holds; a header that asks for more than a little memory is refused."""

    def read(self, size: int | None = -1) -> bytes:
        """See `gzip.GzipFile.read`."""
        if size is None or not 0 <= size <= _MAX_READ_BYTES:
            raise tarfile.ReadError(f"a header of {size} bytes")
        return super().read(size)


def unpack_run(archive: Path, target: Path) -> None:
    """Unpack the archive of a run, which has plain files and folders only.

    Raises:
        TransferError: the archive has something else, leads out of the folder, or is larger than
            the half of what is free here.
    """
    target.mkdir(mode=0o700)
    free_bytes = min(MAX_FLEET_RUN_BYTES, shutil.disk_usage(target).free // 2)
    try:
        with _Inflated(archive) as content, tarfile.open(fileobj=content, mode="r:") as tar:
            for number, entry in enumerate(tar):
                free_bytes -= entry.size
                is_plain = (entry.isfile() and not entry.issparse()) or entry.isdir()
                if not is_plain or number > MAX_BUNDLE_FILES or free_bytes < 0:
                    raise TransferError(
                        f"the archive of a run has the entry {quote(entry.name)}, which is no "
                        f"plain file, the {number + 1:,}. of them, or too large"
                    )
                entry.mode = 0o600 if entry.isfile() else 0o700
                tar.extract(entry, target, filter="data")
    except _DAMAGES as error:
        if getattr(error, "errno", None) in FULL_DISK:
            raise
        raise TransferError(f"the archive of a run is damaged: {error}") from error


_DAMAGES: Final = (tarfile.TarError, OSError, ValueError, EOFError, zlib.error, RecursionError)
