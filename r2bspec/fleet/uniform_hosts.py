"""Runs of a search for a deployment, which are compared with each other: on hosts of one class.

Costs of different machines say nothing of deployments. Even of two machines of one class one is a
little faster: what is compared with each other stays on one host, which are the runs of a group
and all pairs of a comparison. All others are made on whichever host is free.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from r2bspec.compare.report_input import read_folder
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.fleet.client import FleetClient
from r2bspec.fleet.errors import FleetError, HostRefusesError, HostsDifferError
from r2bspec.fleet.fleet_runs import EndedRun, FleetLimits, FleetRun, FleetRuns
from r2bspec.fleet.hosts import ALL, ANY, HostFacts, place
from r2bspec.fleet.journal import Journal
from r2bspec.fleet.security import FleetAddress
from r2bspec.judge.result import Result
from r2bspec.plan.plan import Plan
from r2bspec.plan.prepared_benchmark import PlannedPairs, PlannedRun
from r2bspec.plan.this_machine import SchedulingFacts

_LIMITS: Final = FleetLimits(retry_invalid=0)
"""An invalid run is repeated by the search, on whichever host is free."""


@contextlib.contextmanager
def uniform_hosts(
    address: FleetAddress, plan: Plan, names: Sequence[str]
) -> Iterator[UniformHosts]:
    """The hosts of a fleet on which a plan can be tried, for as long as the context lasts.

    Args:
        address: of the fleet.
        plan: of the spec, with what it requires.
        names: of hosts, or ``all`` or ``any`` for all that fit.

    Raises:
        FleetError: the fleet cannot be reached.
        NoHostError: a host is not in it, or none fits.
        HostsDifferError: the hosts are of several classes.
    """
    named = () if set(names) & {ALL, ANY} else names
    with FleetClient(address) as client:
        client.wait_for_hosts(named)
        facts = {name: host.facts for name, host in client.hosts.items()}
        found = hosts_of_one_class(plan, facts, named or (ANY,))
        yield UniformHosts(client, found, facts[found[0]])


def hosts_of_one_class(
    plan: Plan, facts: Mapping[str, HostFacts], names: Sequence[str]
) -> tuple[str, ...]:
    """The hosts that fit a plan, sorted.

    Raises:
        NoHostError: a host is not in the fleet, or does not fit.
        HostsDifferError: they are of several classes.
    """
    classes: dict[tuple[object, ...], set[str]] = {}
    for placement in place(plan, facts, names):
        if placement.error is not None:
            raise placement.error
        for name in placement.hosts:
            classes.setdefault(_class_of(facts[name]), set()).add(name)
    if len(classes) > 1:
        groups = sorted(sorted(group) for group in classes.values())
        parts = "; ".join(
            f"{', '.join(group)} ({_class_text(facts[group[0]])})" for group in groups
        )
        largest = max(groups, key=len)
        raise HostsDifferError(
            f"the hosts are of {len(classes)} classes, and costs of different machines cannot be "
            f"compared: {parts}",
            hint=f"Name hosts of one class: --hosts {','.join(largest)}",
        )
    return tuple(sorted(*classes.values()))


def _class_of(facts: HostFacts) -> tuple[object, ...]:
    return facts.arch, facts.cpu, facts.cores, facts.gpus, facts.ros_distro, facts.rmw


def _class_text(facts: HostFacts) -> str:
    known = (facts.arch, facts.cpu, f"{facts.cores} CPUs", *facts.gpus, facts.ros_distro, facts.rmw)
    return ", ".join(filter(None, known))


@dataclass
class UniformHosts:
    """Hosts of one class, which make the runs of a search (`r2bspec.tune.trials.Player`).

    Attributes:
        client: is connected to their fleet.
        names: of the hosts, sorted.
        facts: of the first of them; those of the others are alike.
    """

    client: FleetClient
    names: tuple[str, ...]
    facts: HostFacts
    _journal: Journal | None = field(default=None, init=False)
    _root: Path = field(default_factory=Path, init=False)
    _tell: Callable[[str], None] = field(default=print, init=False)

    @property
    def scheduling(self) -> SchedulingFacts:
        """Their CPUs; a worker does not say what else its user may ask for."""
        return SchedulingFacts(cpus=tuple(range(self.facts.cores)))

    @property
    def class_text(self) -> str:
        """What they have in common."""
        return _class_text(self.facts)

    @property
    def description(self) -> dict[str, object]:
        """What a result says of the machine."""
        return {"cpu": self.facts.cpu, "cores": self.facts.cores, "hosts": list(self.names)}

    @property
    def width(self) -> int:
        """A run on each host."""
        return len(self._present)

    @property
    def _present(self) -> tuple[str, ...]:
        """The hosts that are in the fleet now; all, where none is: they may come back."""
        return tuple(filter(self.client.hosts.__contains__, self.names)) or self.names

    @contextlib.contextmanager
    def keep_journal(self, folder: Path, tell: Callable[[str], None]) -> Iterator[None]:
        """Make runs below a folder, which gets their journal, for as long as the context lasts.

        Args:
            folder: of the search.
            tell: is called with a line when a host is lost.

        Raises:
            UsageError: another client makes runs in this folder.
        """
        with contextlib.closing(Journal(folder)) as journal:
            self._journal, self._root, self._tell = journal, folder, tell
            yield

    def state_of(self, error: R2bspecError) -> Literal["broken", "refused", "invalid"]:
        """Whether an error ended a run because of its host, which says nothing of the run."""
        if isinstance(error, FleetError):
            return "invalid"
        return "refused" if isinstance(error, HostRefusesError) else "broken"

    def play(self, runs: Sequence[PlannedRun]) -> Iterator[Result | R2bspecError]:
        """Make runs; one whose hosts are lost has a `FleetError`.

        Raises:
            FleetError: no host is left.
            UsageError: the files of the spec cannot be sent.
        """
        hosts = self._present
        placed = [
            FleetRun(
                name=run.folder.name,
                folder=run.folder,
                head=run.benchmark,
                hosts=frozenset((hosts[run.group % len(hosts)],) if run.group else hosts),
                options={"anatomy": run.anatomy},
            )
            for run in runs
        ]
        ended = {each.run.folder: each for each in self._made(placed)}
        for run in runs:
            error = ended[run.folder].error
            is_lost = isinstance(error, FleetError) and not self.client.hosts
            # What no host has seen is no fault of a deployment: files that are too large to send.
            is_ours = isinstance(error, UsageError) and not isinstance(error, HostRefusesError)
            if error is not None and (is_lost or is_ours):
                raise error
            yield error or read_folder(run.folder).result

    def play_pairs(self, planned: PlannedPairs) -> Result:
        """Make a comparison, whose error is raised."""
        # A transport is a part of the load, and a lever.
        options: dict[str, Any] = {"compares": True, "force": True, "against": planned.against}
        run = FleetRun(
            name=planned.folder.name,
            folder=planned.folder,
            head=planned.head,
            base=planned.base,
            hosts=frozenset(self._present),
            options={**options, "pairs": planned.pairs},
        )
        (ended,) = self._made([run])
        if ended.error is not None:
            raise ended.error
        return read_folder(planned.folder).result

    def _made(self, runs: Sequence[FleetRun]) -> list[EndedRun]:
        assert self._journal is not None  # noqa: S101 - see `keep_journal`
        making = FleetRuns(
            self.client, self._root, self._journal, _LIMITS, self._tell, lambda *_: None
        )
        with contextlib.closing(making.play(runs)) as playing:
            return list(playing)
