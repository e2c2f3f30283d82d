"""Sending what a host lacks, and fetching the folder of a run: in pieces, verified by digest."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final

from r2bspec.fleet.bundle import Bundle, digest_of
from r2bspec.fleet.client import FleetClient, Host
from r2bspec.fleet.errors import TransferError
from r2bspec.fleet.host_messages import Job, Missing, Played, Prepared, Request
from r2bspec.fleet.run_archive import unpack

PIECE_BYTES: Final = 4 << 20
"""Small enough to pass through a scheduler, and to be repeated over a slow link."""

INCOMING: Final = ".incoming"
"""In the folder of a suite: archives that have not arrived as a whole yet."""

_ATTEMPTS: Final = 3


def offer(
    client: FleetClient, host: Host, job: Job, bundle: Bundle, check: Callable[[], None]
) -> Prepared:
    """Offer a job to a host, and send what it lacks; pieces that are there are not sent again.

    Raises:
        HostLostError: the host left.
        TransferError: what arrives is repeatedly not what was sent.
        R2bspecError: the host refuses the job.
    """
    request = Request(what="prepare", job=job)
    for number in range(_ATTEMPTS):
        prepared = client.ask(host, request, Prepared, check=check)
        if not prepared.missing:
            return prepared
        for missing in prepared.missing:
            try:
                _send(client, host, missing, bundle, check)
            except TransferError:
                if number == _ATTEMPTS - 1:
                    raise
    raise TransferError(f"the host {host.name} does not keep the files of {job.name}")


def _send(
    client: FleetClient, host: Host, missing: Missing, bundle: Bundle, check: Callable[[], None]
) -> None:
    with _source(missing, bundle).open("rb") as stream:
        offset = missing.offset
        stream.seek(offset)
        while True:
            piece = stream.read(PIECE_BYTES)
            request = Request(what="put", missing=missing, offset=offset)
            client.ask(host, request, dict, piece, check=check)
            offset += len(piece)
            if offset >= missing.file.size or not piece:
                return


def _source(missing: Missing, bundle: Bundle) -> Path:
    if not missing.recording:
        return bundle.sources[missing.file.sha256]
    place = bundle.recording_sources[missing.recording]
    return place / missing.file.path if place.is_dir() else place


def fetch(client: FleetClient, host: Host, played: Played, root: Path, folder: Path) -> None:
    """Fetch the folder of a run: it appears whole, or not at all.

    What has arrived of the archive before stays, so that a broken connection costs one piece.

    Args:
        client: of the fleet.
        host: has the run.
        played: its answer.
        root: the folder of the suite.
        folder: of the run; replaced if it exists.

    Raises:
        HostLostError: the host left.
        TransferError: the archive is not what its digest says.
        OSError: the disk is full.
    """
    incoming = root / INCOMING
    incoming.mkdir(mode=0o700, parents=True, exist_ok=True)
    archive = incoming / f"{played.identity}.tar.gz"
    with archive.open("ab") as stream:
        while (size := stream.tell()) < played.size:
            piece = client.read_piece(host, played.identity, size, PIECE_BYTES)
            if not piece:
                raise TransferError(f"the host {host.name} has no more of the run")
            stream.write(piece)
        stream.flush()
        os.fsync(stream.fileno())
    if digest_of(archive) != (played.sha256, played.size):
        archive.unlink()
        raise TransferError(f"the run did not arrive as the host {host.name} sent it")
    unpacked = incoming / played.identity
    shutil.rmtree(unpacked, ignore_errors=True)
    unpack(archive, unpacked)
    folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.exists():
        shutil.rmtree(folder)
    unpacked.rename(folder)
    archive.unlink()
    with contextlib.suppress(OSError):
        incoming.rmdir()
