"""A run's way to a host and back: files and recordings, and the archive of its folder.

Both travel in pieces and are verified by their digests. What has arrived stays, here as on the
host, so that a slow link that breaks costs one piece. Each step is a call of the host's service,
which these generators yield to whoever submits it (`r2bspec.fleet.fleet_runs`).
"""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path
from typing import Final

from r2bspec.fleet.bundle import Bundle, Job, SentFile, digest_of
from r2bspec.fleet.errors import TransferError
from r2bspec.fleet.host_store import unpack_run
from r2bspec.fleet.hosts import Host
from r2bspec.fleet.messages import Call, Played, Steps

PIECE_BYTES: Final = 4 << 20
"""Small enough to pass through a scheduler, and to be repeated over a slow link."""

INCOMING: Final = ".incoming"
"""In the folder of a suite: archives that have not arrived as a whole yet."""

MAX_TRANSFERS: Final = 3


def offer(host: Host, job: Job, bundle: Bundle) -> Steps:
    """Offer a job to a host, and send what it lacks; pieces that are there are not sent again.

    Raises:
        TransferError: what arrives is repeatedly not what was sent.
        R2bspecError: the host refuses the job.
    """
    files = {file.sha256: file for file in job.files}
    for number in range(MAX_TRANSFERS + 1):
        missing: dict[str, int] = yield Call("prepare", (job,))
        if not missing:
            return
        for sha256, offset in missing.items():
            try:
                yield from _send(files[sha256], bundle.sources[sha256], offset)
            except TransferError:
                if number == MAX_TRANSFERS - 1:
                    raise
    raise TransferError(f"the host {host.name} does not keep the files of {job.name}")


def _send(file: SentFile, source: Path, offset: int) -> Steps:
    with source.open("rb") as stream:
        stream.seek(offset)
        while True:
            piece = stream.read(PIECE_BYTES)
            yield Call("put", (file, offset, piece))
            offset += len(piece)
            if offset >= file.size or not piece:
                return


def fetch(host: Host, identity: str, played: Played, root: Path, folder: Path) -> Steps:
    """Fetch the folder of a run: it appears whole, or not at all.

    What has arrived of the archive before stays, so that a broken connection costs one piece.

    Args:
        host: has the run.
        identity: of its job.
        played: what the host said of it.
        root: the folder of the suite.
        folder: of the run; replaced if it exists.

    Raises:
        TransferError: the archive is not what its digest says.
        OSError: the disk is full.
    """
    incoming = root / INCOMING
    incoming.mkdir(mode=0o700, parents=True, exist_ok=True)
    archive = incoming / f"{identity}.tar.gz"
    with archive.open("ab") as stream:
        while (size := stream.tell()) < played.size:
            piece: bytes = yield Call("read", (identity, size, PIECE_BYTES))
            if not piece:
                raise TransferError(f"the host {host.name} has no more of the run")
            stream.write(piece)
        stream.flush()
        os.fsync(stream.fileno())
    if digest_of(archive) != played.sha256:
        archive.unlink()
        raise TransferError(f"the run did not arrive as the host {host.name} sent it")
    unpacked = incoming / identity
    shutil.rmtree(unpacked, ignore_errors=True)
    unpack_run(archive, unpacked)
    folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.exists():
        shutil.rmtree(folder)
    unpacked.rename(folder)
    archive.unlink()
    with contextlib.suppress(OSError):
        incoming.rmdir()
