"""Deployments on the hosts of a fleet: starts on several of them at once, pairs on one.

Costs of different machines say nothing of deployments, so all hosts are of one class. Even of two
such machines one is a little faster: what is compared with each other stays on one host, which are
the starts of a round of the race and all pairs of a comparison.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from r2bspec.compare.report_input import read_folder
from r2bspec.errors import R2bspecError, UsageError
from r2bspec.fleet.client import FleetClient
from r2bspec.fleet.errors import FleetError, HostRefusesError
from r2bspec.fleet.fleet_runs import EndedRun, FleetLimits, FleetRun, FleetRuns
from r2bspec.fleet.hosts import ALL, ANY, HostFacts, place
from r2bspec.fleet.journal import Journal
from r2bspec.fleet.security import FleetAddress
from r2bspec.judge.result import Result
from r2bspec.plan.plan import Plan
from r2bspec.plan.this_machine import SchedulingFacts
from r2bspec.tune.machine import TuningError
from r2bspec.tune.trials import Comparing, Playing, RealMachine

_LIMITS: Final = FleetLimits(retry_invalid=0)
"""An invalid start is repeated by `RealMachine`, on whichever host is free."""


@dataclass(frozen=True)
class FleetHosts:
    """The hosts of a search.

    Attributes:
        client: is connected to their fleet.
        names: of the hosts, sorted.
        facts: of the first of them; those of the others are alike.
    """

    client: FleetClient
    names: tuple[str, ...]
    facts: HostFacts

    @property
    def scheduling(self) -> SchedulingFacts:
        """Its CPUs; a worker does not say what else its user may ask for."""
        return SchedulingFacts(cpus=tuple(range(self.facts.cores)))

    @property
    def class_text(self) -> str:
        """What they have in common."""
        return _class_text(self.facts)

    @property
    def description(self) -> dict[str, object]:
        """What a result says of the machine."""
        return {"cpu": self.facts.cpu, "cores": self.facts.cores, "hosts": list(self.names)}


@contextlib.contextmanager
def fleet_hosts(address: FleetAddress, plan: Plan, names: Sequence[str]) -> Iterator[FleetHosts]:
    """The hosts of a fleet on which a plan can be searched, for as long as the context lasts.

    Args:
        address: of the fleet.
        plan: of the spec, with what it requires.
        names: of hosts, or ``all`` or ``any`` for all that fit.

    Raises:
        FleetError: the fleet cannot be reached.
        NoHostError: a host is not in it, or none fits.
        TuningError: the hosts are of several classes.
    """
    named = () if set(names) & {ALL, ANY} else names
    with FleetClient(address) as client:
        client.wait_for_hosts(named)
        facts = {name: host.facts for name, host in client.hosts.items()}
        found = hosts_of_one_class(plan, facts, named or (ANY,))
        yield FleetHosts(client, found, facts[found[0]])


def hosts_of_one_class(
    plan: Plan, facts: Mapping[str, HostFacts], names: Sequence[str]
) -> tuple[str, ...]:
    """The hosts that fit a plan, sorted.

    Raises:
        NoHostError: a host is not in the fleet, or does not fit.
        TuningError: they are of several classes.
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
        raise TuningError(
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
class FleetMachine(RealMachine):
    """Real ROS 2 on hosts of one class.

    Attributes:
        fleet: the hosts.
        journal: of the runs.
        root: the folder of the journal, in which `folder` is.
        tell: is called with a line when a host is lost.
    """

    fleet: FleetHosts
    journal: Journal
    root: Path
    tell: Callable[[str], None]

    @property
    def width(self) -> int:
        """A start on each host."""
        return len(self._present)

    @property
    def _present(self) -> tuple[str, ...]:
        """The hosts that are in the fleet now; all, where none is: they may come back."""
        return tuple(filter(self.fleet.client.hosts.__contains__, self.fleet.names)) or (
            self.fleet.names
        )

    def play(self, runs: Sequence[Playing]) -> Iterator[Result | R2bspecError]:
        """See `RealMachine`; a run whose hosts are lost has a `FleetError`.

        Raises:
            FleetError: no host is left.
            UsageError: the files of the spec cannot be sent.
        """
        hosts = self._present
        planned = [
            FleetRun(
                name=run.folder.name,
                folder=run.folder,
                head=run.benchmark,
                hosts=frozenset((hosts[run.round % len(hosts)],) if run.round else hosts),
                options={"anatomy": run.anatomy},
            )
            for run in runs
        ]
        ended = {each.run.folder: each for each in self._made(planned)}
        for run in runs:
            error = ended[run.folder].error
            is_lost = isinstance(error, FleetError) and not self.fleet.client.hosts
            # What no host has seen is no fault of a deployment: files that are too large to send.
            is_ours = isinstance(error, UsageError) and not isinstance(error, HostRefusesError)
            if error is not None and (is_lost or is_ours):
                raise error
            yield error or read_folder(run.folder).result

    def play_pairs(self, comparing: Comparing) -> Result:
        """See `RealMachine`."""
        # A transport is a part of the load, and a lever.
        options: dict[str, Any] = {"compares": True, "force": True, "against": comparing.against}
        run = FleetRun(
            name=comparing.folder.name,
            folder=comparing.folder,
            head=comparing.head,
            base=comparing.base,
            hosts=frozenset(self._present),
            options={**options, "pairs": comparing.pairs},
        )
        (ended,) = self._made([run])
        if ended.error is not None:
            raise ended.error
        return read_folder(comparing.folder).result

    def _made(self, runs: Sequence[FleetRun]) -> list[EndedRun]:
        making = FleetRuns(
            self.fleet.client, self.root, self.journal, _LIMITS, self.tell, lambda *_: None
        )
        with contextlib.closing(making.play(runs)) as playing:
            return list(playing)
