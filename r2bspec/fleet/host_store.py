"""What a host keeps: recordings, files of bundles and finished runs, up to a limit.

::

    objects/SHA256            a file of a bundle
    recordings/SHA256/        a recording, complete; SHA256.part while it arrives
    work/BUNDLE/              the files of a bundle where they are used
    spool/IDENTITY/           a run until its client has it

Whatever was used least recently is removed first. Everything can be removed while no run plays:
what is missing is sent again.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from r2bspec.bags.integrity import hash_files
from r2bspec.fleet.bundle import digest_of
from r2bspec.fleet.errors import HostFullError, TransferError
from r2bspec.fleet.host_messages import Job, Missing, SentFile, SentRecording

DEFAULT_LIMIT_BYTES: Final = 20 << 30
_FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT})
_KINDS: Final = ("objects", "recordings", "work", "spool")
_PART: Final = ".part"
_HEADSTART_S: Final = {"spool": 86_400.0}
"""So much later counts a run as used: it would have to be played again, and not only sent."""


@contextlib.contextmanager
def full_disk(name: str) -> Iterator[None]:
    """Report a full disk of this host as such.

    Raises:
        HostFullError: a file could not be written for want of room.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in _FULL:
            raise
        raise HostFullError(
            f"the disk of the host {name} is full",
            hint="Free space there, or start its worker with a smaller --cache-limit.",
        ) from error


def inside(root: Path, path: str) -> Path:
    """A place below a folder.

    Raises:
        TransferError: the path leads out of it.
    """
    parts = PurePosixPath(path).parts
    if not parts or path.startswith("/") or ".." in parts or "\0" in path:
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

    def open(self) -> None:
        """Create the folders."""
        for kind in _KINDS:
            (self.root / kind).mkdir(mode=0o700, parents=True, exist_ok=True)

    @contextlib.contextmanager
    def locked(self) -> Iterator[bool]:
        """Have the folder to oneself; False if another worker has it."""
        self.open()
        with (self.root / ".lock").open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                yield False
                return
            yield True

    def missing(self, job: Job) -> Iterator[Missing]:
        """The files that must be sent before a job can be played."""
        for file in {each.sha256: each for each in job.files}.values():
            if not self._object(file.sha256).is_file():
                yield self._missing("", file)
        for recording in job.recordings:
            if recording.absolute or self.recording(recording) is not None:
                continue
            for file in recording.files:
                target = self._part(recording.sha256, file.path)
                if not target.is_file() or target.stat().st_size != file.size:
                    yield self._missing(recording.sha256, file)

    def _missing(self, recording: str, file: SentFile) -> Missing:
        target = self._target(recording, file)
        offset = target.stat().st_size if target.is_file() else 0
        return Missing(recording=recording, file=file, offset=min(offset, file.size))

    def put(self, missing: Missing, offset: int, content: bytes) -> None:
        """Write a piece of a file; the last piece verifies it.

        Raises:
            TransferError: the file is not what its digest says; it is removed.
        """
        target = self._target(missing.recording, missing.file)
        target.parent.mkdir(parents=True, exist_ok=True)
        with target.open("r+b" if target.exists() else "w+b") as stream:
            stream.seek(offset)
            stream.truncate()
            stream.write(content)
            size = stream.tell()
        if size < missing.file.size:
            return
        if digest_of(target) != (missing.file.sha256, missing.file.size):
            target.unlink()
            raise TransferError(f"{missing.file.path} did not arrive as it was sent")
        if not missing.recording:
            target.replace(self._object(missing.file.sha256))

    def _target(self, recording: str, file: SentFile) -> Path:
        if recording:
            return self._part(recording, file.path)
        return inside(self.root / "objects", f"{file.sha256}{_PART}")

    def _object(self, sha256: str) -> Path:
        return inside(self.root / "objects", sha256)

    def _part(self, recording: str, path: str) -> Path:
        return inside(inside(self.root / "recordings", f"{recording}{_PART}"), path)

    def recording(self, sent: SentRecording) -> Path | None:
        """Where a recording is on this host, verified; None if it is not there yet."""
        name = PurePosixPath(sent.path).name
        kept = inside(self.root / "recordings", sent.sha256)
        if kept.is_dir():
            os.utime(kept)
            return kept if sent.folder else kept / sent.files[0].path
        for folder in self.shared:
            for candidate in (folder / sent.sha256, folder / name):
                if candidate.exists() and hash_files(candidate) == sent.sha256:
                    return candidate
        return None

    def complete(self, sent: SentRecording) -> None:
        """Take a recording into the cache if all of it has arrived.

        Raises:
            TransferError: its digest differs; its files are removed.
        """
        if sent.absolute or self.recording(sent) is not None:
            return
        part = inside(self.root / "recordings", f"{sent.sha256}{_PART}")
        if hash_files(part if sent.folder else part / sent.files[0].path) != sent.sha256:
            shutil.rmtree(part, ignore_errors=True)
            raise TransferError(f"the recording {sent.path} did not arrive as it was sent")
        part.rename(inside(self.root / "recordings", sent.sha256))

    def unpack(self, job: Job) -> Path:
        """The files of a job where they are used; what a run made there before stays."""
        tree = inside(self.root / "work", job.bundle)
        for file in job.files:
            target = inside(tree, file.path)
            if target.is_file() and digest_of(target) == (file.sha256, file.size):
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self._object(file.sha256), target)
            target.chmod(0o700 if file.executable else 0o600)
        for side in (job.head, job.base):
            if side is not None:
                (tree if side.base_dir == "." else inside(tree, side.base_dir)).mkdir(
                    parents=True, exist_ok=True
                )
        for recording in job.recordings:
            if not recording.absolute:
                self._link(tree, recording)
        os.utime(tree)
        return tree

    def _link(self, tree: Path, recording: SentRecording) -> None:
        source = self.recording(recording)
        if source is None:
            raise TransferError(f"the recording {recording.path} is not on this host")
        place = inside(tree, recording.path)
        place.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileNotFoundError):
            place.unlink()
        place.symlink_to(source)

    def spool(self, identity: str) -> Path:
        """The folder of a run that no client has fetched yet."""
        return inside(self.root / "spool", identity)

    def trim(self, keep: frozenset[str] = frozenset()) -> None:
        """Remove what was used least recently until the limit is kept.

        Args:
            keep: names of entries that are in use.
        """
        entries = sorted(
            (each for kind in _KINDS for each in (self.root / kind).iterdir()),
            key=lambda each: each.lstat().st_mtime + _HEADSTART_S.get(each.parent.name, 0.0),
        )
        sizes = {each: _size(each) for each in entries}
        total = sum(sizes.values())
        for each in entries:
            if total <= self.limit_bytes:
                return
            if each.name.removesuffix(_PART) not in keep:
                remove(each)
                total -= sizes[each]


def remove(place: Path) -> None:
    """Remove a file or a folder, whatever is left of it."""
    if place.is_dir() and not place.is_symlink():
        shutil.rmtree(place, ignore_errors=True)
    else:
        place.unlink(missing_ok=True)


def _size(place: Path) -> int:
    if not place.is_dir() or place.is_symlink():
        return place.lstat().st_size
    total = 0
    for parent, _, files in os.walk(place):
        for name in files:
            with contextlib.suppress(OSError):
                total += Path(parent, name).lstat().st_size
    return total
