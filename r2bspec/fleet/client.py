"""A client's connection to a fleet: which hosts there are, and tasks for one of them.

A task of Dask is bound to the worker of one host and to its slot, a resource. So tasks of several
clients for a host are done in turn, and none moves to another host by itself: what becomes of a
run whose host is lost is decided by the client, which knows what the host has been sent.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import secrets
import time
from collections.abc import Collection
from typing import Any, Final

import msgspec

from r2bspec.fleet.errors import FalseAnswerError, FleetError
from r2bspec.fleet.hosts import Host, HostFacts
from r2bspec.fleet.messages import FACTS, SLOT, Call, HostState, on_host, read_answer, request_of
from r2bspec.fleet.security import FleetAddress, quiet_logs, require_distributed

_CONNECT_S: Final = 10.0
_JOIN_S: Final = 30.0
"""For so long the first hosts are waited for: workers start with their scheduler."""


class FleetClient:
    """A connection to the scheduler of a fleet, which is made anew when it was lost.

    Attributes:
        hosts: at the last `refresh`, by their names.
        connections: how many there were: a task of an earlier one is lost.
    """

    def __init__(self, address: FleetAddress) -> None:
        """Connect.

        Raises:
            FleetError: the scheduler does not answer.
        """
        require_distributed()
        quiet_logs()
        self._address = address
        self.hosts: dict[str, Host] = {}
        self.connections = 0
        self._client = self._connect()
        self.refresh()

    def __enter__(self) -> FleetClient:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(Exception):
            self._client.close(timeout=2)

    def refresh(self) -> bool:
        """Ask the scheduler which hosts there are; False if it does not answer.

        A scheduler that was restarted knows nothing of this client, which then connects anew.
        """
        try:
            if self._client.status != "running":
                with contextlib.suppress(Exception):
                    self._client.close(timeout=1)
                self._client = self._connect()
            info = self._client.sync(self._identity)
        except Exception:  # Dask raises many kinds; whatever it was, there is no answer
            self.hosts = {}
            return False
        hosts = (_host(address, worker) for address, worker in info["workers"].items())
        self.hosts = {host.name: host for host in hosts if host is not None}
        return True

    def wait_for_hosts(self, named: Collection[str] = ()) -> None:
        """Wait a moment for a first host, or for those that are named."""
        deadline = time.monotonic() + _JOIN_S
        while time.monotonic() < deadline:
            if self.hosts.keys() >= set(named) if named else self.hosts:
                return
            time.sleep(0.5)
            self.refresh()

    def submit(self, host: Host, call: Call) -> concurrent.futures.Future[Any]:
        """Have a host do something; cancelling takes back what waits."""
        client = self._client
        request = request_of(call)
        task = client.submit(
            on_host,
            request,
            key=f"r2bspec-{call.method}-{secrets.token_hex(8)}",
            workers=[host.address],
            resources={SLOT: 1},
            allow_other_workers=False,
            pure=False,
            retries=0,
        )

        async def gathered(task: Any) -> Any:
            try:
                answer = await client.gather(task, asynchronous=True)
            except TypeError as error:  # it is a pickle: see `deserializers`
                raise FalseAnswerError(host.name, f"its answer is none: {error}") from error
            return read_answer(host.name, call.method, request, answer)

        return asyncio.run_coroutine_threadsafe(gathered(task), client.loop.asyncio_loop)

    async def _identity(self) -> Any:
        answer = self._client.scheduler.identity(n_workers=-1)
        return await asyncio.wait_for(answer, _CONNECT_S)

    def _connect(self) -> Any:
        from distributed import Client

        security = self._address.security()
        self.connections += 1
        try:
            # Client would wait for ever for a server that is no scheduler.
            asyncio.run(asyncio.wait_for(_greet(self._address.scheduler, security), _CONNECT_S))
            client: Any = Client(  # type: ignore[no-untyped-call]
                self._address.scheduler,
                security=security,
                timeout=_CONNECT_S,
                set_as_default=False,
                name="r2bspec",
                deserializers=["msgpack"],
            )
        except Exception as error:  # what a server that is none says may be taken for anything
            if (refusal := self._address.refusal()) is not None:
                raise refusal from error
            reason = str(error) or f"nothing that a scheduler says within {_CONNECT_S:g} s"
            raise FleetError(
                f"the scheduler {self._address.scheduler} does not answer: {reason}",
                hint="Start one with 'dask scheduler --host 127.0.0.1 --dashboard-address "
                "127.0.0.1:8787', and workers with 'r2bspec fleet worker'.",
            ) from error
        # Dask drops tasks of its own when a worker is lost, and asyncio would print a traceback for
        # each. What becomes of a task of ours is in its future.
        client.loop.asyncio_loop.set_exception_handler(lambda _loop, _context: None)
        return client


async def _greet(scheduler: str, security: Any) -> None:
    """See that a server answers as a scheduler does."""
    from distributed.comm.core import connect
    from distributed.core import send_recv

    options = security.get_connection_args("client") if security is not None else {}
    comm = await connect(scheduler, timeout=_CONNECT_S, **options)  # type: ignore[no-untyped-call]
    try:
        await send_recv(comm, op="identity", n_workers=0)
    finally:
        comm.abort()


def _host(address: str, worker: dict[str, Any]) -> Host | None:
    """A worker of r2bspec; None for any other one, and for one that takes the name of another."""
    try:
        facts = msgspec.convert(worker[FACTS], HostFacts)
        state = msgspec.convert(worker.get("metrics", {}).get(FACTS, {}), HostState)
    except (KeyError, msgspec.ValidationError):
        return None
    seen_s = max(0.0, time.time() - float(worker.get("last_seen", time.time())))
    # Dask sees that no two workers have one name.
    return Host(address, facts, state, seen_s) if facts.name == worker.get("name") else None
