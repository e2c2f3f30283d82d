"""The runs of a suite on a fleet: each is a task of Dask.

Dask gives a task to one of the hosts that fit, one at a time to a host (the resource ``r2bspec``),
and to another host if a host is lost. Beyond that, a run whose hosts have all left is submitted
again when a host that fits is in the fleet, because Dask knows workers by their addresses.
Connections are as Dask is configured, with TLS if `distributed.comm.tls` says so.
"""

from __future__ import annotations

import contextlib
import logging
import re
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from r2bspec._version import __version__
from r2bspec.errors import ExitStatus, R2bspecError, UsageError
from r2bspec.extras import install_command
from r2bspec.fleet.archive import FleetError, HostLostError, HostRunError, NoHostError, unpack
from r2bspec.fleet.host import HostFacts, Job, Played, describe_host, play
from r2bspec.plan.plan import Plan
from r2bspec.plan.this_machine import unmet

ALL: Final = "all"
ANY: Final = "any"
LOG_FILE: Final = "fleet.log"
"""In a run folder: what `r2bspec run` said on the host."""

_RESOURCE: Final = "r2bspec"
_CONNECT_S: Final = 10.0
_JOIN_S: Final = 30.0
"""For so long a first host is waited for: workers start with their scheduler."""
_RETURN_S: Final = 600.0
"""For so long a run waits for a host after all that fit have left."""
_POLL_S: Final = 0.5
_RETRIES: Final = 2
"""Of a task that fails by itself, as where the disk of a host is full."""
_ERROR: Final = re.compile(r"^error\[(R2B\d{3})[^\]]*\]: (.*)$", re.MULTILINE)


class Host(NamedTuple):
    """A host that is in the fleet now; it has no facts if it has no r2bspec."""

    name: str
    address: str
    facts: HostFacts | None

    def lacks(self, plan: Plan) -> tuple[str, ...]:
        """Return clauses on what keeps this host from playing a run; empty if it fits."""
        if self.facts is None:
            return ("it has no r2bspec",)
        if self.facts.version != __version__:
            return (f"it has r2bspec {self.facts.version}, not {__version__}",)
        return unmet(plan.requires or None, self.facts.machine)


class Placement(NamedTuple):
    """The host of a run: the host of this name, or any that fits if it is empty."""

    host: str
    error: R2bspecError | None = None


def place(plan: Plan, wanted: Sequence[str], hosts: Iterable[Host]) -> list[Placement]:
    """Return the runs of a plan: a single run, or a run for each host.

    Args:
        plan: the plan of the benchmark.
        wanted: ``any`` for a run on any host that fits, ``all`` for one on each of them, or the
            names of hosts.
        hosts: those in the fleet.
    """
    lacks = {host.name: host.lacks(plan) for host in hosts}
    if list(wanted) in ([ALL], [ANY]):
        fitting = sorted(name for name, what in lacks.items() if not what)
        if not fitting:
            return [Placement("", _nothing_fits(lacks))]
        return [Placement("")] if wanted[0] == ANY else [Placement(name) for name in fitting]
    lacks = {name: lacks.get(name, ("it is not in the fleet",)) for name in wanted}
    return [
        Placement(name, _nothing_fits({name: what}) if what else None)
        for name, what in lacks.items()
    ]


@dataclass(eq=False)
class FleetRun:
    """A run to be played on a fleet.

    Attributes:
        folder: where its run folder will be.
        host: the name of the only host that may make it; empty if any may.
        plan: says what a host must have.
    """

    name: str
    folder: Path
    host: str
    plan: Plan
    job: Job


class EndedRun(NamedTuple):
    """A run that has ended, with its folder in place or an error."""

    run: FleetRun
    host: str
    error: R2bspecError | None


@dataclass
class _Task:
    """A run that is under way.

    Attributes:
        future: the future of Dask; None while no host that fits is in the fleet.
        addresses: the addresses of the workers that may make it.
        since: since when none of them is in the fleet; 0 while there is one.
    """

    run: FleetRun
    future: Any = None
    addresses: frozenset[str] = frozenset()
    since: float = 0.0


class Fleet:
    """A connection to the scheduler of a fleet.

    Attributes:
        hosts: by the addresses of their workers, at the last look.
    """

    def __init__(self, scheduler: str) -> None:
        """Connect, and wait a moment for a first host.

        Raises:
            FleetError: the scheduler does not answer.
            UsageError: Dask distributed is not installed.
        """
        try:
            from distributed import Client
        except ImportError as error:
            raise UsageError(
                "a fleet needs Dask distributed, which is not installed",
                hint=install_command("fleet"),
                code=FleetError.code,
            ) from error
        # What matters of it is an error of r2bspec.
        logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)
        try:
            self._client: Any = Client(  # type: ignore[no-untyped-call]
                scheduler, timeout=_CONNECT_S, set_as_default=False, name="r2bspec"
            )
        except Exception as error:  # Dask raises many kinds
            raise FleetError(
                f"the scheduler {scheduler} does not answer: {error}",
                hint="Start one with 'dask scheduler --host 127.0.0.1'; 'r2bspec docs fleet' says "
                "how to start workers, and how to set up TLS.",
            ) from error
        self.hosts: dict[str, Host] = {}
        with contextlib.suppress(TimeoutError):
            self._client.wait_for_workers(1, timeout=_JOIN_S)
        self._look()

    def __enter__(self) -> Fleet:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(Exception):
            self._client.close(timeout=2)

    def _look(self) -> list[str]:
        """Ask for the hosts of the fleet; return the names of those that have left."""
        workers = self._client.scheduler_info(n_workers=-1)["workers"]
        gone = [host.name for address, host in self.hosts.items() if address not in workers]
        new = [address for address in workers if address not in self.hosts]
        told = self._client.run(describe_host, workers=new, on_error="return") if new else {}
        self.hosts = {address: host for address, host in self.hosts.items() if address in workers}
        for address, facts in told.items():
            if isinstance(facts, dict):
                described = msgspec.convert(facts, HostFacts)
            elif isinstance(facts, ImportError | AttributeError):
                described = None
            else:
                continue  # it has left again
            self.hosts[address] = Host(str(workers[address]["name"]), address, described)
        return gone

    def play(
        self, runs: Sequence[FleetRun], on_note: Callable[[str], None]
    ) -> Generator[EndedRun, None, None]:
        """Play runs, and yield them as they end; closing cancels the others.

        Args:
            runs: each with a host that fits.
            on_note: is told of hosts that have left.
        """
        tasks = [_Task(run) for run in runs]
        try:
            while tasks:
                with contextlib.suppress(Exception):  # a scheduler that is gone ends the tasks
                    for name in self._look():
                        on_note(f"the host {name} has left the fleet; its run is placed again")
                for task in list(tasks):
                    ended = self._advance(task)
                    if ended is not None:
                        tasks.remove(task)
                        yield ended
                time.sleep(_POLL_S)
        finally:
            for task in tasks:
                self._cancel(task)

    def _advance(self, task: _Task) -> EndedRun | None:
        if task.future is not None and task.future.done():
            return _ended(task)
        if task.future is not None and not task.addresses.isdisjoint(self.hosts):
            return None
        run = task.run
        addresses = [
            host.address
            for host in self.hosts.values()
            if run.host in {"", host.name} and not host.lacks(run.plan)
        ]
        if addresses:
            self._cancel(task)
            task.addresses, task.since = frozenset(addresses), 0.0
            task.future = self._client.submit(
                play,
                run.job,
                workers=addresses,
                resources={_RESOURCE: 1},
                retries=_RETRIES,
                pure=False,
            )
        elif not task.since:
            task.since = time.monotonic()
        elif time.monotonic() - task.since > _RETURN_S:
            self._cancel(task)
            return EndedRun(run, "", HostLostError("every host that fits has left the fleet"))
        return None

    def _cancel(self, task: _Task) -> None:
        if task.future is not None:
            with contextlib.suppress(Exception):
                task.future.cancel()
            task.future = None


def _ended(task: _Task) -> EndedRun:
    run = task.run
    host = run.host
    try:
        played: Played = task.future.result()
        host = played.host
        _keep(run, played)
    except R2bspecError as error:
        return EndedRun(run, host, error)
    except Exception as error:  # the worker was lost again and again, or the connection is
        kind = type(error).__name__
        if kind in {"KilledWorker", "CancelledError", "FutureCancelledError", "CommClosedError"}:
            text = f"the hosts of {run.name}, or the scheduler, were lost: {error or kind}"
            return EndedRun(run, host, HostLostError(text))
        return EndedRun(run, host, FleetError(f"{run.name} failed on its host: {kind}: {error}"))
    return EndedRun(run, host, None)


def _keep(run: FleetRun, played: Played) -> None:
    """Put the run folder of a host in its place.

    Raises:
        HostRunError: the run ended without a result.
        ArchiveError: the archive cannot be unpacked.
    """
    run.folder.mkdir(parents=True, exist_ok=True)
    if played.archive:
        unpack(played.archive, run.folder)
    log = run.folder / LOG_FILE
    log.write_text(played.log, encoding="utf-8")
    errors = _ERROR.findall(played.log)
    if played.archive and not errors:
        return
    code, message = errors[-1] if errors else ("R2B690", played.log.strip().rpartition("\n")[2])
    statuses = {int(status): status for status in ExitStatus}
    raise HostRunError(
        f"the run on {played.host} failed: {message}",
        status=statuses.get(played.status, ExitStatus.RUN_FAILED),
        code=code,
        hint=f"Its complete output is in {log}.",
    )


def _nothing_fits(lacks: Mapping[str, Sequence[str]]) -> R2bspecError:
    if not lacks:
        return NoHostError("no host is in the fleet", hint="Start workers: 'r2bspec docs fleet'.")
    parts = "; ".join(f"{name}: {', '.join(what)}" for name, what in sorted(lacks.items()))
    return NoHostError(
        f"no host can make the run: {parts}",
        hint="Change 'requires' in the spec, or add a host that fits.",
    )
