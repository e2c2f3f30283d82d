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

from r2bspec.errors import R2bspecError
from r2bspec.fleet.bundle import Bundle, Job, SentFile, digest_of
from r2bspec.fleet.errors import FalseAnswerError, TransferError
from r2bspec.fleet.host_store import unpack_run
from r2bspec.fleet.hosts import Host
from r2bspec.fleet.messages import Call, RunEnded, Steps
from r2bspec.language.quantities import Size
from r2bspec.plan.canonical_json import parse_plan, plan_hash
from r2bspec.record.comparison_folder import PairedComparison, open_comparison
from r2bspec.record.files import RecordError
from r2bspec.record.run_folder import Run, open_run
from r2bspec.safe_io.file_search import regular_files
from r2bspec.safe_io.limits import MAX_FLEET_RUN_BYTES
from r2bspec.safe_io.private_files import remove_folder

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
            if sha256 not in bundle.sources or offset > files[sha256].size:
                raise FalseAnswerError(host.name, "it lacks a file that is not of the spec")
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


def fetch(
    host: Host, job: Job, played: RunEnded, root: Path, folder: Path, counted: dict[str, Path]
) -> Steps:
    """Fetch the folder of a run: it appears whole, or not at all.

    What has arrived of the archive before stays, so that a broken connection costs one piece.

    Args:
        host: has the run.
        job: that it was asked to play.
        played: what the host said of it.
        root: the folder of the suite.
        folder: of the run; replaced if it exists.
        counted: the folders of the runs that are here, by their identities; this one is added.

    Raises:
        TransferError: the archive is not what its digest says.
        FalseAnswerError: it is not the archive of such a run.
        OSError: the disk is full.
    """
    incoming = root / INCOMING
    incoming.mkdir(mode=0o700, parents=True, exist_ok=True)
    archive = incoming / f"{job.identity}.tar.gz"
    if played.size > min(MAX_FLEET_RUN_BYTES, shutil.disk_usage(incoming).free // 2):
        raise FalseAnswerError(host.name, f"its run has {Size(played.size)}, too much for here")
    with archive.open("ab") as stream:
        while (size := stream.tell()) < played.size:
            asked = min(PIECE_BYTES, played.size - size)
            piece: bytes = yield Call("read", (job.identity, size, asked))
            if len(piece) != asked:
                archive.unlink()
                raise TransferError(f"the host {host.name} does not hand out its run")
            stream.write(piece)
        stream.flush()
        os.fsync(stream.fileno())
    if digest_of(archive) != played.sha256:
        archive.unlink()
        raise TransferError(f"the run did not arrive as the host {host.name} sent it")
    unpacked = incoming / job.identity
    remove_folder(unpacked)
    try:
        unpack_run(archive, unpacked)
        run_id = _check_run(host, job, played, unpacked)
        if run_id and counted.setdefault(run_id, folder) != folder:
            raise FalseAnswerError(host.name, f"its run is that in {counted[run_id]}")
    except R2bspecError:
        remove_folder(unpacked)
        archive.unlink()
        raise
    folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.exists():
        remove_folder(folder)
    unpacked.rename(folder)
    archive.unlink()
    with contextlib.suppress(OSError):
        incoming.rmdir()


def _check_run(host: Host, job: Job, played: RunEnded, folder: Path) -> str:
    """See that a folder is that of a run of the job; returns the identity of the run, if any.

    A host that forges a whole run is not found out: what it measures is known to it alone.
    """
    opened: PairedComparison | Run
    try:
        opened = open_comparison(folder) if job.compares else open_run(folder)
    except RecordError as error:
        if played.problem is not None:
            return ""  # it failed before there was a record
        raise FalseAnswerError(host.name, f"what it hands out is no run: {error}") from error
    if plan_hash(opened.plan) != plan_hash(parse_plan(job.head.plan.encode(), job.name)):
        raise FalseAnswerError(host.name, "its run is one of another benchmark")
    return opened.record.run_id


def run_folders(root: Path) -> dict[str, Path]:
    """The folders of the runs of a suite, by the identities of the runs."""
    folders = {}
    for place in regular_files(root):
        if place.name not in ("record.json", "pairs.json"):
            continue
        with contextlib.suppress(R2bspecError):
            opened = open_run if place.name == "record.json" else open_comparison
            folders[opened(place.parent).record.run_id] = place.parent
    return folders
