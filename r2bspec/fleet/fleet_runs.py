"""The runs of one client on a fleet: each is made once, whatever happens to hosts meanwhile.

Each host has a loop: a generator that takes the next run that its host may make, sends it,
waits, fetches the folder, and takes the next. It yields the calls that its host is to answer, and
all loops take their steps in one thread (`FleetRuns.play`). So a host has nothing to do only
for the time of a fetch, and nothing is sent or fetched while it plays. A loop whose host is lost
gives its run back and ends; the host gets a new one when it returns.

Nothing is counted twice: the identity of a run is that of its suite, folder, host, attempt and
content. A host plays an identity once, and keeps the result until the client has it. A run that
was given back is made by whichever host is free, and what a lost host made of it meanwhile counts
only if that host is asked for the same identity again.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import hashlib
import queue
import time
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

from r2bspec.diagnostics.quote import time_text
from r2bspec.errors import R2bspecError
from r2bspec.execute.identity.identify_graph import graph_identity
from r2bspec.fleet import errors
from r2bspec.fleet.bundle import Bundle, Job, make_bundle
from r2bspec.fleet.client import FleetClient
from r2bspec.fleet.hosts import Host
from r2bspec.fleet.journal import Journal, State
from r2bspec.fleet.messages import Call, HostState, RunEnded, Steps
from r2bspec.fleet.transfer import MAX_TRANSFERS, fetch, offer, run_folders
from r2bspec.plan.canonical_json import plan_hash
from r2bspec.plan.plan import Plan
from r2bspec.plan.prepared_benchmark import PreparedBenchmark
from r2bspec.plan.time_estimate import estimate_pairs, estimate_time

_POLL_S: Final = 1.0
_POLLS_A_SECOND: Final = 50.0
"""Hosts whose state is asked for in a second: the answer of the scheduler has all of them."""
_INVALID: Final = "invalid"
_NO_CALL: Final = Call("", ())


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
    head: PreparedBenchmark
    hosts: frozenset[str]
    base: PreparedBenchmark | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def sides(self) -> list[PreparedBenchmark]:
        """What is sent."""
        return [self.head] if self.base is None else [self.head, self.base]


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

    @property
    def silent_s(self) -> float:
        """How much longer than it can take the answer of a host may take."""
        return 6 * self.lost_s


class EndedRun(NamedTuple):
    """A run that has ended, with its folder in place or an error."""

    run: FleetRun
    host: str
    error: R2bspecError | None


class RunStatus(NamedTuple):
    """What a run does, for the table."""

    name: str
    host: str
    text: str


@dataclass(eq=False)
class _RunEntry:
    """A run, and what happened to it so far."""

    run: FleetRun
    bundle: Bundle
    attempt: int = 1
    losses: int = 0
    refused: dict[str, R2bspecError] = field(default_factory=dict)
    since: float = field(default_factory=time.monotonic)
    status: tuple[str, str] = ("", "waiting for a host")
    ended: bool = False
    code: tuple[str, ...] = ()

    @property
    def hosts(self) -> frozenset[str]:
        return self.run.hosts - set(self.refused)


@dataclass(eq=False)
class _HostLoop:
    """What is under way on a host, over one connection."""

    host: Host
    connection: int
    steps: Steps
    answer: concurrent.futures.Future[Any] | None = None
    call: Call = _NO_CALL
    since: float = 0.0

    def is_others(self, state: HostState) -> bool:
        """Whether the host plays for another client, who is waited for."""
        own = next((job.identity for job in self.call.args if isinstance(job, Job)), "")
        return state.identity not in ("", own)


@dataclass(eq=False)
class FleetRuns:
    """Makes the runs of one suite.

    Attributes:
        root: the folder of the suite.
        on_note: is told of losses and repetitions, in a line.
        on_tick: is told every second what runs and hosts do.
    """

    client: FleetClient
    root: Path
    journal: Journal
    limits: FleetLimits
    on_note: Callable[[str], None]
    on_tick: Callable[[list[RunStatus], Mapping[str, Host]], None]
    _entries: list[_RunEntry] = field(default_factory=list)
    _waiting: list[_RunEntry] = field(default_factory=list)
    _loops: dict[str, _HostLoop] = field(default_factory=dict)
    _answered: queue.Queue[_HostLoop] = field(default_factory=queue.Queue)
    _ended: deque[EndedRun] = field(default_factory=deque)
    _looked: float = 0.0
    _silent: set[str] = field(default_factory=set)
    _counted: dict[str, Path] = field(default_factory=dict)

    def play(self, runs: Sequence[FleetRun]) -> Generator[EndedRun, None, None]:
        """Make the runs; each is yielded when it has ended, in whatever order.

        Closing the iterator starts no further run.
        """
        self._counted = run_folders(self.root)
        bundles: dict[tuple[int, int], Bundle] = {}
        codes: dict[int, str] = {}
        for run in runs:
            key = (id(run.head), id(run.base))
            try:
                bundle = bundles.get(key) or make_bundle(run.sides)
            except (R2bspecError, OSError) as error:
                failure = (
                    error if isinstance(error, R2bspecError) else errors.TransferError(str(error))
                )
                yield EndedRun(run, "", failure)
                continue
            bundles[key] = bundle
            self._entries.append(_RunEntry(run, bundle, code=_code_of(run, codes)))
        self._waiting = list(self._entries)
        left = len(self._entries)
        try:
            while left:
                self._look_after_hosts()
                with contextlib.suppress(queue.Empty):
                    loop = self._answered.get(timeout=0 if self._ended else _POLL_S)
                    if loop.answer is not None and loop.answer.done():
                        self._go_on(loop)
                while self._ended:
                    left -= 1
                    yield self._ended.popleft()
        finally:
            for loop in self._loops.values():
                if loop.answer is not None:
                    loop.answer.cancel()

    def _look_after_hosts(self) -> None:
        """Begin loops of hosts that came, end those of hosts that left, give up runs."""
        now = time.monotonic()
        if now - self._looked < max(_POLL_S, len(self.client.hosts) / _POLLS_A_SECOND):
            return
        self.client.refresh()
        self._looked = time.monotonic()
        for loop in list(self._loops.values()):
            present = self.client.hosts.get(loop.host.name)
            is_same = present is not None and present.address == loop.host.address
            if not is_same or loop.connection != self.client.connections:
                self._lose(loop, errors.HostLostError(f"the host {loop.host.name} left the fleet"))
            elif present is not None and loop.is_others(present.state):
                loop.since = now
            elif now - loop.since > loop.call.within_s + self.limits.silent_s:
                self._silent.add(loop.host.address)
                silence = time_text(now - loop.since)
                text = f"the host {loop.host.name} has not answered for {silence}"
                self._lose(loop, errors.HostLostError(text))
        hosts = {
            name: host
            for name, host in self.client.hosts.items()
            if host.address not in self._silent
        }
        for name, host in hosts.items():
            if name not in self._loops and any(name in entry.hosts for entry in self._waiting):
                loop = _HostLoop(host, self.client.connections, self._serve(host))
                self._loops[name] = loop
                self._step(loop, loop.steps.__next__)
        unended = (entry for entry in self._entries if not entry.ended)
        self.on_tick([RunStatus(entry.run.name, *entry.status) for entry in unended], hosts)
        for entry in list(self._waiting):
            if entry.hosts & set(hosts):
                entry.since = now
            elif now - entry.since > self.limits.lost_s:
                self._waiting.remove(entry)
                names = ", ".join(sorted(entry.hosts))
                text = f"no host that may make the run is in the fleet: {names}"
                self._end(entry, "", errors.HostLostError(text))

    def _go_on(self, loop: _HostLoop) -> None:
        """Give a loop the answer that it waits for."""
        answer, loop.answer = loop.answer, None
        assert answer is not None  # noqa: S101 - see the caller
        try:
            value = answer.result()
        except R2bspecError as error:
            failed = error
            self._step(loop, lambda: loop.steps.throw(failed))
        except Exception as error:
            # Cancelled, killed, closed: Dask says in many ways that the worker is gone.
            how = f": {error}" if str(error) else ""
            text = f"the host {loop.host.name} left the fleet{how}"
            self._lose(loop, errors.HostLostError(text))
        else:
            self._step(loop, lambda: loop.steps.send(value))

    def _lose(self, loop: _HostLoop, lost: errors.HostLostError) -> None:
        if loop.answer is not None:
            loop.answer.cancel()
            loop.answer = None
        self._step(loop, lambda: loop.steps.throw(lost))

    def _step(self, loop: _HostLoop, step: Callable[[], Call]) -> None:
        """Go on with a loop, and submit the next call that it yields."""
        try:
            call = step()
        except StopIteration:
            del self._loops[loop.host.name]
            return
        try:
            answer = self.client.submit(loop.host, call)
        except Exception as error:  # a connection that was lost just now
            self._lose(loop, errors.HostLostError(f"the scheduler is lost: {error}"))
            return
        loop.answer, loop.call, loop.since = answer, call, time.monotonic()
        answer.add_done_callback(lambda _: self._answered.put(loop))

    def _serve(self, host: Host) -> Steps:
        """Play one run after the other on a host, until there is none or the host is lost."""
        while entry := next(
            (waiting for waiting in self._waiting if host.name in waiting.hosts), None
        ):
            self._waiting.remove(entry)
            try:
                if (differs := host.facts.version_error) is not None:
                    raise errors.HostRefusesError(
                        str(differs), hint=differs.hint, code=differs.code
                    )
                error = yield from self._play_on(host, entry)
            except errors.HostLostError as lost:
                self._give_back(entry, host, lost)
                return
            except (errors.HostFullError, errors.HostRefusesError, errors.TransferError) as refusal:
                self._refuse(entry, host, refusal)
                continue
            except R2bspecError as failed:
                error = failed
            except Exception as crash:
                error = errors.TransferError(f"the run cannot be stored: {crash}")
            self._end(entry, host.name, error)

    def _play_on(self, host: Host, entry: _RunEntry) -> Steps:
        """Make a run on a host, again if it is invalid; returns why it failed, or None.

        Raises:
            HostLostError: the host left; the run is to be made again.
            HostFullError: the host has no room.
            HostRefusesError: the host cannot make it.
        """
        while True:
            job = self._job(entry, host.name)
            played: RunEnded = yield from self._play_and_fetch(host, entry, job)
            error = played.problem.error if played.problem is not None else None
            again = self._is_made_again(entry, played)
            state: State = "invalid" if again else "failed" if error is not None else "done"
            self._write(entry, host, state, job.identity, str(error or played.outcome))
            with contextlib.suppress(R2bspecError):  # a host that is lost drops it later
                yield Call("drop", (job.identity,))
            if not again:
                return error
            self.on_note(f"{entry.run.name} on {host.name} is invalid and made again")
            entry.attempt += 1

    def _is_made_again(self, entry: _RunEntry, played: RunEnded) -> bool:
        return played.outcome == _INVALID and entry.attempt <= self.limits.retry_invalid

    def _play_and_fetch(self, host: Host, entry: _RunEntry, job: Job) -> Steps:
        """Have a job played and its folder here, whatever the host removed for other clients.

        A host that has played the job and still has it answers at once.

        Raises:
            R2bspecError: as `_play_on`.
        """
        for number in range(MAX_TRANSFERS):
            try:
                entry.status = (host.name, "being sent")
                yield from offer(host, job, entry.bundle)
                self._write(entry, host, "sent", job.identity)
                entry.status = (host.name, "playing")
                played: RunEnded = yield Call("play", (job,), _longest_s(entry.run.head.plan, job))
                folder = entry.run.folder
                if self._is_made_again(entry, played):
                    folder = folder.with_name(f"{folder.name}.invalid-{entry.attempt}")
                if played.size:
                    entry.status = (host.name, "being fetched")
                    yield from fetch(host, job, played, self.root, folder, self._counted)
                elif played.problem is None:
                    raise errors.FalseAnswerError(host.name, "it has nothing of the run")
            except errors.TransferError:
                if number == MAX_TRANSFERS - 1:
                    raise
            else:
                return played
        return None

    def _job(self, entry: _RunEntry, host: str) -> Job:
        run, bundle = entry.run, entry.bundle
        words = (
            *(self.journal.suite, run.folder.relative_to(self.root), host, entry.attempt),
            *(bundle.digest, *(plan_hash(side.plan) for side in run.sides), *entry.code),
        )
        return Job(
            identity=hashlib.sha256("\0".join(map(str, words)).encode()).hexdigest()[:32],
            name=run.name,
            head=bundle.sides[0],
            base=bundle.sides[1] if run.base is not None else None,
            bundle=bundle.digest,
            files=bundle.files,
            recordings=bundle.recordings,
            **run.options,
        )

    def _give_back(self, entry: _RunEntry, host: Host, lost: errors.HostLostError) -> None:
        """Let a run be made again, unless its hosts are lost again and again."""
        self._write(entry, host, "lost", reason=str(lost))
        entry.losses += 1
        entry.since = time.monotonic()
        if entry.losses > self.limits.losses:
            text = f"the host of the run left the fleet {entry.losses} times, {host.name} at last"
            hint = "The run may take more memory than its host has: try it on that machine alone."
            self._end(entry, host.name, errors.HostLostError(text, hint=hint))
            return
        entry.status = ("", "waiting for a host")
        self._waiting.insert(0, entry)
        self.on_note(f"{lost}; {entry.run.name} will be made again")

    def _refuse(self, entry: _RunEntry, host: Host, error: R2bspecError) -> None:
        """Let another host make a run, if there is one."""
        entry.refused[host.name] = error
        state: State = "full" if isinstance(error, errors.HostFullError) else "refused"
        self._write(entry, host, state, reason=str(error))
        if entry.hosts:
            self.on_note(f"{host.name}: {error}")
            entry.status = ("", "waiting for a host")
            self._waiting.insert(0, entry)
            # Another host may have nothing to do, and is asked at once.
            self._looked = 0.0
        elif len(entry.refused) == 1:
            self._end(entry, host.name, error)
        else:
            parts = "; ".join(f"{name}: {why}" for name, why in sorted(entry.refused.items()))
            self._end(entry, "", errors.NoHostError(f"no host can make the run: {parts}"))

    def _end(self, entry: _RunEntry, host: str, error: R2bspecError | None) -> None:
        entry.ended = True
        self._ended.append(EndedRun(entry.run, host, error))

    def _write(
        self, entry: _RunEntry, host: Host, state: State, identity: str = "", reason: str = ""
    ) -> None:
        self.journal.write(
            run=str(entry.run.folder.relative_to(self.root)),
            host=host.name,
            identity=identity,
            attempt=entry.attempt,
            state=state,
            reason=reason,
        )


def _longest_s(plan: Plan, job: Job) -> float:
    """More seconds than a run takes on the slowest of hosts."""
    estimate = estimate_pairs(plan, job.pairs) if job.compares else estimate_time(plan)
    limits_ns = [step.timeout_ns for step in plan.setup]
    limits_ns += [probe.timeout_ns for probe in plan.ready]
    limits_ns += [step.timeout_ns for step in plan.after_ready]
    return 10 * max(estimate.at_most_s, estimate.seconds) + sum(limits_ns) / 1e9


def _code_of(run: FleetRun, known: dict[int, str]) -> tuple[str, ...]:
    """What the graphs of a run are made of here: other code is another run.

    As for bundles, sides that several runs have in common are looked at once.
    """
    for side in run.sides:
        if id(side) not in known:
            known[id(side)] = graph_identity(side.plan, side.base_dir).digest
    return tuple(known[id(side)] for side in run.sides)
