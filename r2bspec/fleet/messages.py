"""What passes between the clients and the hosts of a fleet, so that neither needs the other's code.

The only function that clients submit to Dask is `on_host`. It takes bytes and returns bytes: a
`Call` and an `Answer` as MessagePack, which are data, and are checked against the types in
`METHODS` where they arrive. Dask itself still pickles the name of the function and what it says to
its own parts (`r2bspec.fleet.security`).
"""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Generator
from typing import Annotated, Any, Final, NamedTuple

import msgspec

from r2bspec.diagnostics.quote import quote
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.fleet import errors
from r2bspec.fleet.bundle import Count, Identity, Job, SentFile, Sha256

PLUGIN: Final = "r2bspec"
"""The name of the service of a host among the plugins of its worker."""

SLOT: Final = "r2bspec-host"
"""The resource of which each host has one."""

FACTS: Final = "r2bspec"
"""Under this key a worker describes its host when it registers, and its state in heartbeats."""

_ANNOUNCE_S: Final = 0.5

_MAX_TEXT: Final = 10_000
"""The most characters of an error of a host that are shown."""

_KINDS: Final = (
    errors.HostFullError,
    errors.HostLostError,
    errors.HostRefusesError,
    errors.TransferError,
    R2bspecError,
)
"""What clients tell apart of the errors of a host: the first that it is one of."""


class Problem(msgspec.Struct, frozen=True, kw_only=True):
    """An error of a host, or why a run failed, as it is shown.

    Attributes:
        kind: the name of one of `_KINDS`.
        is_of_host: whether nothing was played, because the spec is not valid on this host.
    """

    code: Annotated[str, msgspec.Meta(pattern=r"^R2B\d{3}\Z")]
    message: str
    hint: str = ""
    exit_status: int = ExitStatus.RUN_FAILED
    kind: str = ""
    is_of_host: bool = False

    @classmethod
    def of(cls, error: R2bspecError) -> Problem:
        """An error as it travels."""
        return cls(
            code=error.code,
            message=str(error),
            hint=error.hint,
            exit_status=error.exit_code,
            kind=next(kind.__name__ for kind in _KINDS if isinstance(error, kind)),
        )

    @property
    def error(self) -> R2bspecError:
        """The error of a client."""
        kind = next((kind for kind in _KINDS if kind.__name__ == self.kind), R2bspecError)
        error = kind(self.message[:_MAX_TEXT], hint=self.hint[:_MAX_TEXT], code=self.code)
        error.exit_code = next(
            (status for status in ExitStatus if status == self.exit_status), ExitStatus.RUN_FAILED
        )
        return error


class RunEnded(msgspec.Struct, frozen=True, kw_only=True):
    """A run that has ended.

    Attributes:
        outcome: of its verdict; empty where there is none.
        problem: why it failed.
        size: of the archive of its folder, in bytes; 0 if it has none.
        sha256: of the archive.
    """

    outcome: str = ""
    problem: Problem | None = None
    size: Count = 0
    sha256: str = ""


_Seconds = Annotated[float, msgspec.Meta(ge=0, le=1e9)]


class FleetRunState(msgspec.Struct, frozen=True, kw_only=True):
    """How far a run is, for the tables of clients.

    Attributes:
        phase: in words.
        left_s: the estimated rest; None where it is unknown.
        p99_ns: of the latest latencies; None before the first.
    """

    name: str = ""
    phase: str = ""
    left_s: _Seconds | None = None
    p99_ns: Count | None = None


class HostState(FleetRunState, frozen=True, kw_only=True, omit_defaults=True):
    """What a host does, as it says with its heartbeats.

    Attributes:
        identity: of the run that it plays; empty if it plays none.
    """

    state: str = "idle"
    identity: str = ""


METHODS: Final[dict[str, tuple[Any, Any]]] = {
    "prepare": (tuple[Job], dict[Sha256, Count]),
    "put": (tuple[SentFile, Count, bytes], None),
    "play": (tuple[Job], RunEnded),
    "read": (tuple[Identity, Count, Count], bytes),
    "drop": (tuple[Identity], None),
}
"""What clients may ask of `r2bspec.fleet.host_service.HostService`: arguments, and the answer."""


class Call(NamedTuple):
    """One of `METHODS` that a host is to call.

    Attributes:
        within_s: how long the answer may take, besides what any answer may.
    """

    method: str
    args: tuple[Any, ...]
    within_s: float = 0.0


Steps = Generator[Call, Any, Any]


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """What a host says to a request: a value, or why it has none.

    Attributes:
        request: the digest of the request, so that it is the answer to no other one.
    """

    request: str
    value: msgspec.Raw = msgspec.Raw(b"\xc0")
    problem: Problem | None = None


_NOT_DECODED: Final = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)


def request_of(call: Call) -> bytes:
    """A call as it travels; no two requests are alike."""
    return msgspec.msgpack.encode((secrets.token_hex(8), call.method, call.args))


def read_request(request: bytes) -> tuple[str, tuple[Any, ...]]:
    """The method that a client asks for, and its arguments.

    Raises:
        FleetError: it is no request.
    """
    try:
        _, method, args = msgspec.msgpack.decode(request, type=tuple[str, str, msgspec.Raw])
        if method not in METHODS:
            raise errors.FleetError(f"hosts do nothing that is called {quote(method)}")
        return method, msgspec.msgpack.decode(args, type=METHODS[method][0])
    except _NOT_DECODED as error:
        raise errors.FleetError(f"this is no request of a client: {error}") from error


def answer_of(request: bytes, value: Any = None, problem: Problem | None = None) -> bytes:
    """The answer to a request as it travels."""
    raw = msgspec.Raw(msgspec.msgpack.encode(value))
    return msgspec.msgpack.encode(Answer(request=_digest(request), value=raw, problem=problem))


def read_answer(host: str, method: str, request: bytes, content: Any) -> Any:
    """The value that a host answers to a request.

    Raises:
        FalseAnswerError: it is no answer, or that to another request.
        R2bspecError: the host says why it has none.
    """
    try:
        answer = msgspec.msgpack.decode(content, type=Answer)
        if answer.request != _digest(request):
            raise errors.FalseAnswerError(host, "its answer is that to another request")
        if answer.problem is not None:
            raise answer.problem.error
        return msgspec.msgpack.decode(answer.value, type=METHODS[method][1])
    except (*_NOT_DECODED, TypeError) as error:
        raise errors.FalseAnswerError(host, f"its answer is none: {error}") from error


def _digest(request: bytes) -> str:
    return hashlib.sha256(request).hexdigest()


def on_host(request: bytes) -> bytes:
    """Have the host of this worker answer a request.

    A run is announced in a heartbeat of its own, because the next one may be far.
    """
    from distributed import get_worker

    worker: Any = get_worker()
    worker.loop.add_callback(worker.loop.call_later, _ANNOUNCE_S, worker.heartbeat)
    answer: bytes = worker.plugins[PLUGIN].answer(request)
    return answer
