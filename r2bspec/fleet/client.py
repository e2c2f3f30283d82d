"""The client's side of a fleet: which hosts there are, and requests to one of them.

A request is one task of Dask, bound to the worker of one host and to its slot. So requests of
several clients to a host are answered in turn, and none moves to another host by itself: what
happens to a run whose host is lost is decided by the client, which knows what it has.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeVar

import msgspec

from r2bspec.fleet.errors import FleetError, HostLostError
from r2bspec.fleet.host_facts import HostFacts, read_facts
from r2bspec.fleet.host_messages import FACTS, SLOT, Request, decode, encode
from r2bspec.fleet.security import FleetAddress, quiet_logs, require_distributed

if TYPE_CHECKING:
    from distributed.security import Security

_POLL_S: Final = 1.0
_CONNECT_S: Final = 10.0


T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Host:
    """A host that is in the fleet now.

    Attributes:
        address: of its worker; another one after the worker was restarted.
        state: what it did when it was last heard of.
        seen_s: seconds since then.
    """

    address: str
    facts: HostFacts
    state: dict[str, Any]
    seen_s: float = 0.0

    @property
    def name(self) -> str:
        """The name of the host."""
        return self.facts.name


class FleetClient:
    """A connection to the scheduler of a fleet, which is made anew when it was lost."""

    def __init__(self, address: FleetAddress) -> None:
        """Connect.

        Raises:
            FleetError: the scheduler does not answer.
        """
        require_distributed()
        quiet_logs()
        self._address = address
        self._lock = threading.Lock()
        self._hosts: dict[str, Host] = {}
        self._client = self._connect()
        self.refresh()

    def __enter__(self) -> FleetClient:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(Exception):
            self._client.close(timeout=2)

    @property
    def hosts(self) -> dict[str, Host]:
        """The hosts at the last `refresh`, by their names."""
        return self._hosts

    def refresh(self) -> bool:
        """Ask the scheduler which hosts there are; False if it does not answer.

        A scheduler that was restarted knows nothing of this client, which then connects anew.
        """
        try:
            if self._client.status != "running":
                self._reconnect()
            info = self._client.sync(self._identity)
        except Exception:  # Dask raises many kinds; whatever it was, there is no answer
            self._hosts = {}
            return False
        found = (_host(address, worker) for address, worker in info["workers"].items())
        self._hosts = {each.name: each for each in found if each is not None}
        return True

    async def _identity(self) -> Any:
        asked = self._client.scheduler.identity(n_workers=-1)
        return await asyncio.wait_for(asked, _CONNECT_S)

    def _connect(self) -> Any:
        from distributed import Client

        security = self._address.security()
        try:
            # Client would wait for ever for a server that is no scheduler.
            asyncio.run(asyncio.wait_for(_identity(self._address, security), _CONNECT_S))
            return Client(  # type: ignore[no-untyped-call]
                self._address.scheduler,
                security=security,
                timeout=_CONNECT_S,
                set_as_default=False,
                name="r2bspec",
            )
        except Exception as error:  # what a server that is none says may be taken for anything
            reason = str(error) or f"nothing that a scheduler says within {_CONNECT_S:g} s"
            raise FleetError(
                f"the scheduler {self._address.scheduler} does not answer: {reason}",
                hint="Start one with 'dask scheduler', and workers with 'r2bspec fleet worker'.",
            ) from error

    def _reconnect(self) -> None:
        with self._lock:
            if self._client.status == "running":
                return
            with contextlib.suppress(Exception):
                self._client.close(timeout=1)
            self._client = self._connect()

    def ask(
        self,
        host: Host,
        request: Request,
        kind: type[T],
        piece: bytes = b"",
        *,
        check: Callable[[], None] = lambda: None,
    ) -> T:
        """Ask a host, and wait for its answer.

        Args:
            host: to be asked.
            request: what is asked.
            kind: of the answer.
            piece: of a file, with ``put``.
            check: is called while waiting, and may raise to give up.

        Raises:
            HostLostError: the host or the scheduler left meanwhile.
            R2bspecError: the host answered with a problem.
        """
        return decode(self._ask(host, request, piece, check), kind)

    def read_piece(self, host: Host, identity: str, offset: int, size: int) -> bytes:
        """Read a piece of the archive of a run.

        Raises:
            HostLostError: as `ask`.
            R2bspecError: the host answered with a problem.
        """
        request = Request(what="piece", identity=identity, offset=offset, size=size)
        answer = self._ask(host, request, b"", lambda: None)
        if answer[:1] != b"=":
            decode(answer, dict)
        return answer[1:]

    def _ask(self, host: Host, request: Request, piece: bytes, check: Callable[[], None]) -> bytes:
        from distributed import Future

        from r2bspec.fleet.worker import answer

        client = self._client
        future: Future[bytes] | None = None
        try:
            future = client.submit(
                answer,
                encode(request),
                piece,
                key=f"r2bspec-{request.what}-{secrets.token_hex(8)}",
                workers=[host.address],
                resources={SLOT: 1},
                allow_other_workers=False,
                pure=False,
                retries=0,
            )
            while True:
                check()
                with contextlib.suppress(TimeoutError):
                    found = future.result(timeout=_POLL_S * max(1.0, len(self._hosts) / 50))
                    assert isinstance(found, bytes)  # noqa: S101 - `answer` returns them
                    return found
                now = self._hosts.get(host.name)
                if client is not self._client or now is None or now.address != host.address:
                    raise HostLostError(f"the host {host.name} left the fleet")
        except (HostLostError, KeyboardInterrupt):
            raise
        except Exception as error:
            if type(error).__module__.startswith("r2bspec"):
                raise
            # Cancelled, killed, closed: Dask says in many ways that the worker is gone.
            raise HostLostError(f"the host {host.name} left the fleet: {error}") from error
        finally:
            if future is not None:
                with contextlib.suppress(Exception):
                    future.cancel()  # type: ignore[no-untyped-call]


async def _identity(address: FleetAddress, security: Security | None) -> Any:
    """What a scheduler says of itself."""
    from distributed.comm.core import connect
    from distributed.core import send_recv

    options: dict[str, Any] = {}
    if security is not None:
        options = security.get_connection_args("client")  # type: ignore[no-untyped-call]
    comm = await connect(  # type: ignore[no-untyped-call]
        address.scheduler, timeout=_CONNECT_S, **options
    )
    try:
        return await send_recv(comm, op="identity", n_workers=0)
    finally:
        comm.abort()


def _host(address: str, worker: dict[str, Any]) -> Host | None:
    """A worker of r2bspec; None for any other one."""
    try:
        facts = read_facts(worker[FACTS])
    except (KeyError, msgspec.ValidationError):
        return None
    state = worker.get("metrics", {}).get(FACTS, {})
    seen_s = max(0.0, time.time() - float(worker.get("last_seen", time.time())))
    return Host(address=address, facts=facts, state=state, seen_s=seen_s)
