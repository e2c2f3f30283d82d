"""The worker of a host: a Dask worker with one slot, which is quiet while a run plays.

Its one task at a time is Dask's resource `SLOT`; what it does is the plugin `HostService`; what it
is travels when it registers, and what it does with every heartbeat. It has no HTTP server, and
without TLS it listens on the loopback interface only: whoever reaches a worker runs programs there.

Dask's defaults wake a process about 200 times a second for its own statistics. None of them is
needed here, so this worker keeps two timers: the heartbeat, every few seconds, and a sign of life
every minute.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from r2bspec.fleet.host_service import HostService
from r2bspec.fleet.messages import FACTS, SLOT
from r2bspec.fleet.security import FleetAddress, quiet_logs

HEARTBEAT_S: Final = 10.0

_QUIET: Final[dict[str, Any]] = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": False,
    "distributed.worker.http.routes": [],
    "distributed.diagnostics.nvml": False,
    "distributed.admin.tick.interval": "1h",
    "distributed.admin.tick.limit": "2h",
    "distributed.admin.tick.cycle": "1h",
    "distributed.admin.system-monitor.interval": "1h",
    "distributed.admin.system-monitor.disk": False,
    "distributed.admin.system-monitor.gil.enabled": False,
}
"""Settings of Dask; timers that have no setting are removed from the worker."""

_TIMERS: Final = frozenset({"heartbeat", "keep-alive"})
_RECONNECT_S: Final = 2.0


@dataclass(frozen=True, kw_only=True)
class WorkerSettings:
    """How a worker takes part in a fleet.

    Attributes:
        heartbeat_s: between heartbeats.
        listen: where the worker listens (`security.listen_address`); anywhere if empty.
    """

    address: FleetAddress
    scratch: Path
    heartbeat_s: float = HEARTBEAT_S
    listen: str = ""


def run_worker(
    service: HostService, settings: WorkerSettings, on_state: Callable[[str], None]
) -> None:
    """Serve a fleet until a signal ends this process; reconnects when the scheduler is gone.

    Args:
        service: of this host.
        settings: of the worker.
        on_state: is told what changes, in a line.
    """
    import dask

    dask.config.set(_QUIET)
    quiet_logs()
    asyncio.run(_serve(service, settings, on_state))


async def _serve(
    service: HostService, settings: WorkerSettings, on_state: Callable[[str], None]
) -> None:
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    on_state(told := f"connecting to {settings.address.scheduler}")
    while not ended.is_set():
        worker = _make_worker(service, settings)
        try:
            starting = asyncio.ensure_future(worker)
            while not (starting.done() or ended.is_set()):
                # Dask would try again and again without a word.
                refusal = await asyncio.to_thread(settings.address.refusal)
                if refusal is not None and str(refusal) != told:
                    on_state(f"not in the fleet: {(told := str(refusal))}; {refusal.hint}")
                await _first(starting, ended, _RECONNECT_S)
            if not starting.done():
                starting.cancel()
                break
            starting.result()
            on_state(told := f"{service.facts.name} is in the fleet of {worker.scheduler.address}")
            await _first(asyncio.ensure_future(worker.finished()), ended)
            if not ended.is_set():
                on_state(told := "the scheduler is gone; connecting again")
        except Exception as error:  # Dask raises many kinds, and any of them may pass
            text = f"not in the fleet: {error}"
            if text != told:
                on_state(told := text)
        finally:
            if ended.is_set():
                service.close()
            with contextlib.suppress(Exception):
                await worker.close(timeout=30, executor_wait=ended.is_set())
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(ended.wait(), _RECONNECT_S)
    service.close()


async def _first(
    task: asyncio.Future[Any], ended: asyncio.Event, timeout_s: float | None = None
) -> None:
    """Wait for a task, or for the end, or for a time."""
    stop = asyncio.ensure_future(ended.wait())
    await asyncio.wait({task, stop}, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
    stop.cancel()


def _make_worker(service: HostService, settings: WorkerSettings) -> Any:
    from distributed import Worker

    heartbeat_s = settings.heartbeat_s

    class QuietWorker(Worker):
        """A worker with two timers, whose heartbeats keep their interval."""

        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            for name in set(self.periodic_callbacks) - _TIMERS:
                self.periodic_callbacks.pop(name).stop()

        async def heartbeat(self) -> None:
            await super().heartbeat()
            # The scheduler asks for two a second in a small fleet.
            self.periodic_callbacks["heartbeat"].callback_time = heartbeat_s * 1000

        def start_http_server(self, *_: Any, **__: Any) -> None:
            """Serve nothing: no dashboard, no metrics, and no port for them."""
            self.http_server = None  # type: ignore[assignment] # it is tested when it is closed

    return QuietWorker(
        settings.address.scheduler,
        nthreads=1,
        name=service.facts.name,
        resources={SLOT: 1},
        memory_limit=0,
        dashboard=False,
        local_directory=str(settings.scratch),
        security=settings.address.security(),
        plugins=(service,),
        startup_information={FACTS: lambda _: msgspec.to_builtins(service.facts)},
        metrics={FACTS: lambda _: service.state()},
        heartbeat_interval=f"{heartbeat_s}s",
        **({"host": settings.listen} if settings.listen else {}),
    )
