"""The runs of one client on a fleet: each is made once, whatever happens to hosts meanwhile.

There is a thread for each host. It takes the next run that its host may play, sends it, waits,
fetches the folder, and takes the next. So a host has nothing to do only for the time of a fetch,
and nothing is sent or fetched while it plays. A thread whose host is lost gives its run back and
ends; the host gets a new one when it returns.
"""

from __future__ import annotations

import contextlib
import hashlib
import queue
import threading
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from r2bspec._version import __version__
from r2bspec.errors import R2bspecError
from r2bspec.execute.identity.identify_graph import graph_identity
from r2bspec.fleet.bundle import Bundle, SentSide, make_bundle, needs_of
from r2bspec.fleet.client import FleetClient, Host
from r2bspec.fleet.errors import HostFullError, HostLostError, NoHostError, TransferError
from r2bspec.fleet.fleet_history import FleetHistory
from r2bspec.fleet.host_messages import Job, Played, Request, error_of
from r2bspec.fleet.journal import Journal
from r2bspec.fleet.run_transfer import fetch, offer
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.record.baseline_file import CONFIRMATION_FOLDER

_POLL_S: Final = 1.0
_POLLS_A_SECOND: Final = 50.0
"""Hosts whose state is asked for in a second: the answer of the scheduler has all of them."""
_MAX_TRANSFERS: Final = 3
_INVALID: Final = "invalid"
_CONFIRM: Final = "-confirm"
"""Ends the identity of a run that confirms another one."""


@dataclass(frozen=True, kw_only=True)
class FleetRun:
    """A run to be made.

    Attributes:
        folder: where its run folder will be.
        hosts: the names of the hosts that may make it; any of them does.
        base: of a comparison in pairs, if it is another spec.
        options: further fields of its `Job`.
    """

    name: str
    folder: Path
    head: SentSide
    hosts: frozenset[str]
    base: SentSide | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class FleetLimits:
    """How patient a client is.

    Attributes:
        lost_s: how long runs wait for hosts that left.
        retry_invalid: how often an invalid run is made again, on the same host.
        losses: how often the host of one run may leave: a run that takes all memory of its host
            would end every worker that it is given to.
    """

    lost_s: float = 600.0
    retry_invalid: int = 1
    losses: int = 20


class Ended(NamedTuple):
    """A run that has ended, with its folder in place or an error."""

    run: FleetRun
    host: str
    error: R2bspecError | None


class RunStatus(NamedTuple):
    """What a run does, for the table."""

    name: str
    host: str
    text: str


@dataclass
class _Entry:
    """A run, and what happened to it so far."""

    run: FleetRun
    bundle: Bundle
    needs: tuple[str, ...]
    attempt: int = 1
    losses: int = 0
    refused: dict[str, R2bspecError] = field(default_factory=dict)
    since: float = field(default_factory=time.monotonic)
    ended: bool = False
    code: tuple[str, ...] = ()

    @property
    def hosts(self) -> frozenset[str]:
        return self.run.hosts - set(self.refused)


class FleetRuns:
    """Makes the runs of one suite."""

    def __init__(
        self,
        client: FleetClient,
        root: Path,
        journal: Journal,
        limits: FleetLimits,
        on_note: Callable[[str], None],
        on_tick: Callable[[list[RunStatus], Mapping[str, Host]], None],
        history: FleetHistory | None = None,
    ) -> None:
        """Begin.

        Args:
            client: of the fleet.
            root: the folder of the suite.
            journal: of the suite.
            limits: of patience.
            on_note: is told of losses and repetitions, in a line.
            on_tick: is told every second what runs and hosts do.
            history: judges runs, too.
        """
        self._client = client
        self._root = root
        self._journal = journal
        self._limits = limits
        self._on_note = on_note
        self._on_tick = on_tick
        self._history = history
        self._entries: list[_Entry] = []
        self._waiting: list[_Entry] = []
        self._changed = threading.Condition()
        self._ended: queue.Queue[Ended] = queue.Queue()
        self._closing = False
        self._looked = 0.0
        self._threads: dict[str, tuple[str, threading.Thread]] = {}
        self._status: dict[int, tuple[str, str]] = {}

    def play(self, runs: Sequence[FleetRun]) -> Generator[Ended, None, None]:
        """Make the runs; each is yielded when it has ended, in whatever order.

        First every run is offered to the hosts that may make it. One that none of them can make
        ends at once, before anything is played. Closing the iterator starts no further run.
        """
        bundles: dict[tuple[int, int], Bundle] = {}
        codes: dict[int, str] = {}
        for run in runs:
            try:
                bundle = _bundle(run, bundles)
            except (R2bspecError, OSError) as error:
                failure = error if isinstance(error, R2bspecError) else TransferError(str(error))
                yield Ended(run, "", failure)
                continue
            needs = tuple(needs_of(each.plan, bundle.digest) for each in _sides(run))
            self._entries.append(_Entry(run, bundle, needs, code=_code_of(run, codes)))
        left = len(self._entries)
        try:
            self._offer_all()
            with self._changed:
                self._waiting = [each for each in self._entries if not each.ended]
                self._changed.notify_all()
            while left:
                self._look_after_hosts()
                try:
                    found = self._ended.get(timeout=_POLL_S)
                except queue.Empty:
                    continue
                left -= 1
                yield found
        finally:
            with self._changed:
                self._closing = True
                self._changed.notify_all()

    def states(self) -> list[RunStatus]:
        """What every run that has not ended does, in their order."""
        rows = []
        for entry in self._entries:
            if not entry.ended:
                host, text = self._status.get(id(entry), ("", "waiting for a host"))
                rows.append(RunStatus(entry.run.name, host, text))
        return rows

    def _offer_all(self) -> None:
        """Offer every run to every host that may make it, all hosts at the same time.

        Of runs that need the same of a host, one is offered.
        """
        offering = []
        for host in list(self._client.hosts.values()):
            thread = threading.Thread(target=self._offer_to, args=(host,), daemon=True)
            thread.start()
            offering.append(thread)
        for thread in offering:
            while thread.is_alive():
                thread.join(_POLL_S)
                self._look_after_hosts()
        self._end_impossible()

    def _offer_to(self, host: Host) -> None:
        answers: dict[tuple[str, ...], R2bspecError | None] = {}
        for entry in self._entries:
            if host.name not in entry.hosts:
                continue
            if entry.needs not in answers:
                self._show(entry, host, "being checked there")
                try:
                    self._offer(host, entry, self._job(entry, host.name))
                    answers[entry.needs] = None
                except HostLostError:
                    return
                except R2bspecError as error:
                    answers[entry.needs] = error
                finally:
                    self._status.pop(id(entry), None)
            if (refusal := answers[entry.needs]) is not None:
                entry.refused[host.name] = refusal

    def _offer(self, host: Host, entry: _Entry, job: Job) -> None:
        """Send a run to a host, with what the host lacks.

        Raises:
            R2bspecError: the host cannot make it.
        """
        prepared = offer(self._client, host, job, entry.bundle, self._check)
        if prepared.problems:
            raise error_of(prepared.problems[0])

    def _end_impossible(self) -> None:
        """End the runs that every host has refused."""
        for entry in self._entries:
            if not entry.ended and entry.run.hosts and not entry.hosts:
                self._end(entry, "", _refusal(entry))

    def _job(self, entry: _Entry, host: str) -> Job:
        run, bundle = entry.run, entry.bundle
        words = (
            *(self._journal.suite, str(run.folder.relative_to(self._root)), host, entry.attempt),
            *(bundle.digest, *(plan_hash(each.plan) for each in _sides(run)), *entry.code),
        )
        identity = hashlib.sha256("\0".join(map(str, words)).encode()).hexdigest()[:32]
        return Job(
            version=__version__,
            identity=identity,
            name=run.name,
            head=bundle.sides[0],
            base=bundle.sides[1] if run.base is not None else None,
            bundle=bundle.digest,
            files=bundle.files,
            recordings=bundle.recordings,
            **run.options,
        )

    def _look_after_hosts(self) -> None:
        """Start threads for hosts that came, and give up runs whose hosts stay away."""
        now = time.monotonic()
        if now - self._looked < len(self._client.hosts) / _POLLS_A_SECOND:
            return
        self._looked = now
        self._client.refresh()
        hosts = self._client.hosts
        for name, host in hosts.items():
            known = self._threads.get(name)
            if known is not None and known[0] == host.address and known[1].is_alive():
                continue
            if any(name in each.hosts for each in self._waiting):
                thread = threading.Thread(target=self._serve, args=(host,), daemon=True)
                self._threads[name] = (host.address, thread)
                thread.start()
        self._on_tick(self.states(), hosts)
        with self._changed:
            for entry in list(self._waiting):
                if entry.hosts & set(hosts):
                    entry.since = time.monotonic()
                elif time.monotonic() - entry.since > self._limits.lost_s:
                    self._waiting.remove(entry)
                    names = ", ".join(sorted(entry.hosts))
                    text = f"no host that may make the run is in the fleet: {names}"
                    self._end(entry, "", HostLostError(text))

    def _serve(self, host: Host) -> None:
        """Play one run after the other on a host, until there is none or the host is lost."""
        while (entry := self._take(host)) is not None:
            try:
                error = self._play_on(host, entry)
            except HostLostError as lost:
                self._give_back(entry, host, lost)
                return
            except HostFullError as full:
                self._refused(entry, host, full)
                continue
            except R2bspecError as failed:
                error = failed
            except Exception as crash:
                error = TransferError(f"the run cannot be stored: {crash}")
            self._end(entry, host.name, error)

    def _take(self, host: Host) -> _Entry | None:
        with self._changed:
            while not self._closing:
                now = self._client.hosts.get(host.name)
                if now is None or now.address != host.address:
                    return None
                found = next((each for each in self._waiting if host.name in each.hosts), None)
                if found is not None:
                    self._waiting.remove(found)
                    return found
                if all(each.ended for each in self._entries):
                    return None
                self._changed.wait(_POLL_S)
        return None

    def _play_on(self, host: Host, entry: _Entry) -> R2bspecError | None:
        """Make a run on a host, again if it is invalid; returns why it failed, or None.

        Raises:
            HostLostError: the host left; the run is to be made again.
            HostFullError: the host has no room.
        """
        while True:
            job = self._job(entry, host.name)
            played = self._play_and_fetch(host, entry, job)
            error = error_of(played.problem) if played.problem is not None else None
            again = self._is_made_again(entry, played)
            if self._history is not None and error is None and not again:
                self._judge_by_history(host, entry, self._history)
            state = "invalid" if again else "failed" if error is not None else "done"
            self._write(entry, host, job, state, str(error or played.outcome))
            self._drop(host, job)
            if not again:
                return error
            self._on_note(f"{entry.run.name} on {host.name} is invalid and made again")
            entry.attempt += 1

    def _is_made_again(self, entry: _Entry, played: Played) -> bool:
        return played.outcome == _INVALID and entry.attempt <= self._limits.retry_invalid

    def _play_and_fetch(self, host: Host, entry: _Entry, job: Job) -> Played:
        """Have a job played and its folder here, whatever the host removed for other clients.

        A host that has played the job and still has it answers at once.

        Raises:
            R2bspecError: as `_play_on`.
        """
        number = 0
        while True:
            number += 1
            self._offer(host, entry, job)
            self._write(entry, host, job, "sent")
            self._show(entry, host, "being confirmed" if _confirms(job) else "playing")
            try:
                request = Request(what="play", job=job)
                played = self._client.ask(host, request, Played, check=self._check)
                if played.size:
                    self._show(entry, host, "being fetched")
                    target = self._target(entry, job, played)
                    fetch(self._client, host, played, self._root, target)
                return played
            except TransferError:
                if number == _MAX_TRANSFERS:
                    raise

    def _target(self, entry: _Entry, job: Job, played: Played) -> Path:
        folder = entry.run.folder
        if _confirms(job):
            return folder / CONFIRMATION_FOLDER
        if self._is_made_again(entry, played):
            return folder.with_name(f"{folder.name}.invalid-{entry.attempt}")
        return folder

    def _drop(self, host: Host, job: Job) -> None:
        """Let a host remove what is here; one that is lost does when it needs the room."""
        with contextlib.suppress(R2bspecError):
            self._client.ask(host, Request(what="drop", identity=job.identity), dict)

    def _judge_by_history(self, host: Host, entry: _Entry, history: FleetHistory) -> None:
        """Judge a run by earlier ones of its host; a failure is confirmed there by a second run."""
        folder = entry.run.folder
        plan = history.confirmation(folder, entry.run.head.plan)
        if plan is not None:
            job = self._job(entry, host.name)
            head = msgspec.structs.replace(job.head, plan=canonical_json(plan).decode())
            identity = f"{job.identity}{_CONFIRM}"
            job = msgspec.structs.replace(job, head=head, identity=identity)
            played = self._play_and_fetch(host, entry, job)
            if played.problem is not None:
                raise error_of(played.problem)
            self._drop(host, job)
        history.add(folder)

    def _give_back(self, entry: _Entry, host: Host, lost: HostLostError) -> None:
        with self._changed:
            self._status.pop(id(entry), None)
            if self._closing:
                return
            self._journal.write(self._place(entry), host.name, "", entry.attempt, "lost", str(lost))
            entry.losses += 1
            entry.since = time.monotonic()
            is_last = entry.losses > self._limits.losses
            if not is_last:
                self._waiting.insert(0, entry)
                self._changed.notify_all()
        if is_last:
            text = f"the host of the run left the fleet {entry.losses} times, {host.name} at last"
            hint = "The run may take more memory than its host has: try it on that machine alone."
            self._end(entry, host.name, HostLostError(text, hint=hint))
            return
        self._on_note(f"{host.name} is lost; {entry.run.name} will be made again")

    def _refused(self, entry: _Entry, host: Host, error: R2bspecError) -> None:
        """Let another host make a run, if there is one."""
        entry.refused[host.name] = error
        self._journal.write(self._place(entry), host.name, "", entry.attempt, "full", str(error))
        self._on_note(f"{host.name}: {error}")
        if not entry.hosts:
            self._end(entry, host.name, error)
            return
        with self._changed:
            self._status.pop(id(entry), None)
            self._waiting.insert(0, entry)
            self._changed.notify_all()

    def _end(self, entry: _Entry, host: str, error: R2bspecError | None) -> None:
        with self._changed:
            if entry.ended:
                return
            entry.ended = True
            self._ended.put(Ended(entry.run, host, error))
            self._changed.notify_all()

    def _check(self) -> None:
        if self._closing:
            raise HostLostError("the client ended")

    def _write(self, entry: _Entry, host: Host, job: Job, state: Any, reason: str = "") -> None:
        self._journal.write(
            self._place(entry), host.name, job.identity, entry.attempt, state, reason
        )

    def _place(self, entry: _Entry) -> str:
        return str(entry.run.folder.relative_to(self._root))

    def _show(self, entry: _Entry, host: Host, text: str) -> None:
        self._status[id(entry)] = (host.name, text)


def _confirms(job: Job) -> bool:
    return job.identity.endswith(_CONFIRM)


def _bundle(run: FleetRun, known: dict[tuple[int, int], Bundle]) -> Bundle:
    """The bundle of a run; runs of the same benchmark share it."""
    key = (id(run.head), id(run.base))
    if key not in known:
        known[key] = make_bundle(_sides(run))
    return known[key]


def _sides(run: FleetRun) -> list[SentSide]:
    return [run.head] if run.base is None else [run.head, run.base]


def _code_of(run: FleetRun, known: dict[int, str]) -> tuple[str, ...]:
    """What the graphs of a run are made of here: other code is another run.

    As for bundles, sides that several runs have in common are looked at once.
    """
    for side in _sides(run):
        if id(side) not in known:
            known[id(side)] = graph_identity(side.plan, side.base_dir).digest
    return tuple(known[id(side)] for side in _sides(run))


def _refusal(entry: _Entry) -> R2bspecError:
    """Why no host can make a run: the reason of the only host, or one line with all of them."""
    if len(entry.refused) == 1:
        return next(iter(entry.refused.values()))
    parts = "; ".join(f"{host}: {error}" for host, error in sorted(entry.refused.items()))
    return NoHostError(f"no host can make the run: {parts}")
