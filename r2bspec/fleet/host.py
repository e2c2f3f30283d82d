"""The worker of a host: it describes the host, and plays one run after another.

A run is ``r2bspec run`` in a process of its own, so that the event loop of the worker is not in the
process that measures.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from r2bspec._version import __version__
from r2bspec.fleet.archive import pack_folder, unpack
from r2bspec.plan.this_machine import MachineFacts, this_machine

_MAX_LOG_BYTES: Final = 100_000
_PROGRAM: Final = "r2bspec.fleet.run_with_worker"


class HostFacts(msgspec.Struct, frozen=True):
    """A host, as it describes itself."""

    version: str
    machine: MachineFacts


class Job(NamedTuple):
    """A run, or a comparison in pairs, which stays on its host.

    Attributes:
        archive: the archive of the files that it needs.
        verb: ``run``, or ``compare``.
        plan: the path of its plan in the archive.
        base: that of the base of a comparison, if that is another plan.
        words: further options of the verb.
    """

    archive: bytes
    verb: str
    plan: str
    base: str = ""
    words: tuple[str, ...] = ()


class Played(NamedTuple):
    """A run that has ended.

    Attributes:
        status: the status of the process.
        log: what it wrote, or the end of it.
        archive: the archive of its run folder; empty if there is none.
    """

    host: str
    status: int
    log: str
    archive: bytes


def describe_host() -> dict[str, Any]:
    """Return the `HostFacts` of this host as plain values, which any version can read."""
    facts = HostFacts(version=__version__, machine=this_machine())
    described: dict[str, Any] = msgspec.to_builtins(facts)
    return described


def play(job: Job) -> Played:
    """Play a job as a task of the worker of this host."""
    from distributed import get_worker

    worker = get_worker()
    with tempfile.TemporaryDirectory(dir=worker.local_directory) as scratch:
        tree, folder = Path(scratch, "files"), Path(scratch, "run")
        unpack(job.archive, tree)
        words = [job.verb, str(tree / job.plan), "--output", str(folder), *job.words]
        words += ["--against", str(tree / job.base)] if job.base else []
        with Path(scratch, "log").open("w+b") as log:
            # It ends when its standard input is closed, as by the end of the worker.
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", _PROGRAM, *words],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=scratch,
                env={**os.environ, "CI": "1"},
            )
            with process:
                status = process.wait()
            log.seek(max(0, log.seek(0, os.SEEK_END) - _MAX_LOG_BYTES))
            text = log.read().decode(errors="replace")
        archive = pack_folder(folder) if folder.is_dir() else b""
    return Played(str(worker.name), status, text, archive)
