"""What client and hosts say to each other: JSON, so that each reads only what it knows.

Values travel as the bytes of JSON and never as pickled objects of r2bspec: a host whose version
differs answers with its version, not with an error of a deserialiser.
"""

from __future__ import annotations

from typing import Any, Final, Literal, TypeVar

import msgspec

from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus
from r2bspec.fleet.errors import HostFullError, HostLostError, TransferError

PROTOCOL: Final = 1
"""The version of these messages."""

SLOT: Final = "r2bspec-host"
"""The resource of which each host has one."""

FACTS: Final = "r2bspec"
"""Under this key a worker describes its host when it registers, and its state in heartbeats."""

T = TypeVar("T")


class _Message(msgspec.Struct, frozen=True, kw_only=True):
    """Base of all messages: immutable; unknown fields of later versions are ignored."""


class SentFile(_Message, frozen=True, kw_only=True):
    """A file that travels.

    Attributes:
        path: relative to the root of its bundle, or to the folder of its recording.
        sha256: of its content, in hexadecimal digits.
    """

    path: str
    size: int
    sha256: str
    executable: bool = False


class SentRecording(_Message, frozen=True, kw_only=True):
    """A recording that a plan names.

    Attributes:
        path: where it must be, relative to the root of the bundle, or absolute.
        sha256: `r2bspec.bags.integrity.hash_files` of it.
        folder: whether it is a folder; else it is the one file.
    """

    path: str
    sha256: str
    files: tuple[SentFile, ...]
    folder: bool = True

    @property
    def absolute(self) -> bool:
        """Whether hosts must have it at this very path."""
        return self.path.startswith("/")


class Side(_Message, frozen=True, kw_only=True):
    """A benchmark: its plan and resolved spec, and its folder in the bundle."""

    plan: str
    spec_text: str
    base_dir: str


class Job(_Message, frozen=True, kw_only=True):
    """One run, or one comparison in pairs, which never leaves its host.

    Attributes:
        identity: names the run on its host: the same identity is never played twice.
        head: is run, and judged.
        base: of a comparison, if it is another spec; None if it is the head.
        against: the base as the user wrote it.
        environments: of the base: setup files and installed workspaces of the host.
        bundle: identifies `files`.
    """

    protocol: int = PROTOCOL
    version: str
    identity: str
    name: str
    head: Side
    base: Side | None = None
    compares: bool = False
    against: str = ""
    environments: tuple[str, ...] = ()
    pairs: int | None = None
    control: bool = False
    force: bool = False
    smoke: bool = False
    abort_on_fail: bool = False
    record_outputs: bool = False
    bundle: str
    files: tuple[SentFile, ...]
    recordings: tuple[SentRecording, ...]


def sides_of(job: Job) -> tuple[Side, ...]:
    """The benchmarks of a job: one, or both of a comparison of two specs."""
    return (job.head,) if job.base is None else (job.head, job.base)


class Problem(_Message, frozen=True, kw_only=True):
    """An error on a host, as it is shown."""

    code: str
    message: str
    hint: str = ""
    exit_status: int = ExitStatus.RUN_FAILED


class Missing(_Message, frozen=True, kw_only=True):
    """A file that a host lacks, and how much of it is there already, in bytes.

    Attributes:
        recording: the digest of the recording that it belongs to; empty for a file of a bundle.
    """

    recording: str
    file: SentFile
    offset: int


class Prepared(_Message, frozen=True, kw_only=True):
    """The answer to a job that is offered.

    Attributes:
        missing: files to be sent before the job is offered again.
        problems: why this host cannot run it.
        played: whether it has been run there already.
    """

    missing: tuple[Missing, ...] = ()
    problems: tuple[Problem, ...] = ()
    played: bool = False


class Played(_Message, frozen=True, kw_only=True):
    """A run that has ended.

    Attributes:
        outcome: of its verdict; empty where there is none.
        problem: why it failed.
        size: of the archive of its folder, in bytes; 0 if it has none.
        sha256: of the archive.
        seconds: that it took on its host.
    """

    identity: str
    outcome: str = ""
    problem: Problem | None = None
    size: int = 0
    sha256: str = ""
    seconds: float = 0.0


class Request(_Message, frozen=True, kw_only=True):
    """What is asked of a host.

    Attributes:
        what: ``prepare`` takes a job; ``put`` a piece of a file, sent along; ``play`` a job;
            ``piece`` reads an archive; ``drop`` removes it.
    """

    what: Literal["prepare", "put", "play", "piece", "drop"]
    job: Job | None = None
    missing: Missing | None = None
    identity: str = ""
    offset: int = 0
    size: int = 0


def encode(message: msgspec.Struct) -> bytes:
    """The JSON of a message."""
    return msgspec.json.encode(message)


def decode(content: bytes, kind: type[T]) -> T:
    """Read a message; a `Problem` in its place is raised.

    Raises:
        R2bspecError: the host answered with a problem.
    """
    if content[:1] == b"!":
        raise error_of(msgspec.json.decode(content[1:], type=Problem))
    return msgspec.json.decode(content, type=kind)


def problem_of(error: R2bspecError) -> Problem:
    """An error as it travels."""
    return Problem(
        code=error.code, message=str(error), hint=error.hint, exit_status=int(error.exit_code)
    )


_HANDLED: Final[dict[str, type[R2bspecError]]] = {
    each.code: each for each in (HostFullError, HostLostError, TransferError)
}


def error_of(problem: Problem) -> R2bspecError:
    """An error that has travelled; those that a client handles have their class again."""
    kind = _HANDLED.get(problem.code, R2bspecError)
    error = kind(problem.message, hint=problem.hint, code=problem.code)
    known = {each.value: each for each in ExitStatus}
    error.exit_code = known.get(problem.exit_status, ExitStatus.RUN_FAILED)
    return error


def failed(problem: Problem) -> bytes:
    """The answer that raises a problem where it is decoded."""
    return b"!" + msgspec.json.encode(problem)


def as_dict(message: msgspec.Struct) -> dict[str, Any]:
    """A message as plain values, for Dask's own messages."""
    found: dict[str, Any] = msgspec.to_builtins(message)
    return found
