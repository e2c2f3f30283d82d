"""What passes between the clients and the hosts of a fleet, so that neither needs the other's code.

The only function that clients submit to Dask is `on_host`. It calls a method of the service of a
host by its name, which must be one of `METHODS`.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, Final, NamedTuple

import msgspec

from r2bspec.errors import ExitStatus, R2bspecError

PLUGIN: Final = "r2bspec"
"""The name of the service of a host among the plugins of its worker."""

SLOT: Final = "r2bspec-host"
"""The resource of which each host has one."""

FACTS: Final = "r2bspec"
"""Under this key a worker describes its host when it registers, and its state in heartbeats."""

METHODS: Final = ("prepare", "put", "play", "read", "drop")
"""What clients may ask of `r2bspec.fleet.host_service.HostService`."""

_ANNOUNCE_S: Final = 0.5


class Problem(msgspec.Struct, frozen=True, kw_only=True):
    """Why a run failed, as it is shown.

    Attributes:
        is_of_host: whether nothing was played, because the spec is not valid on this host.
    """

    code: str
    message: str
    hint: str = ""
    exit_status: int = ExitStatus.RUN_FAILED
    is_of_host: bool = False

    @property
    def error(self) -> R2bspecError:
        """The error of a client."""
        error = R2bspecError(self.message, hint=self.hint, code=self.code)
        statuses = (status for status in ExitStatus if status == self.exit_status)
        error.exit_code = next(statuses, ExitStatus.RUN_FAILED)
        return error


class Played(msgspec.Struct, frozen=True, kw_only=True):
    """A run that has ended.

    Attributes:
        outcome: of its verdict; empty where there is none.
        problem: why it failed.
        size: of the archive of its folder, in bytes; 0 if it has none.
        sha256: of the archive.
    """

    outcome: str = ""
    problem: Problem | None = None
    size: int = 0
    sha256: str = ""


class RunState(msgspec.Struct, frozen=True, kw_only=True):
    """How far a run is, for the tables of clients.

    Attributes:
        phase: in words.
        left_s: the estimated rest; None where it is unknown.
        p99_ns: of the latest latencies; None before the first.
    """

    name: str
    phase: str = ""
    left_s: float | None = None
    p99_ns: int | None = None


class Call(NamedTuple):
    """One of `METHODS` that a host is to call."""

    method: str
    args: tuple[Any, ...]


Steps = Generator[Call, Any, Any]


def on_host(method: str, *args: Any) -> Any:
    """Call one of `METHODS` on the host of this worker.

    A run is announced in a heartbeat of its own, because the next one may be far.
    """
    from distributed import get_worker

    worker: Any = get_worker()
    worker.loop.add_callback(worker.loop.call_later, _ANNOUNCE_S, worker.heartbeat)
    return worker.plugins[PLUGIN].answer(method, *args)
