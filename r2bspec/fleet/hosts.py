"""What a host is, and which hosts make a run: requirements of the spec against what they are."""

from __future__ import annotations

import platform
import socket
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec

from r2bspec._version import __version__
from r2bspec.diagnostics.quote import time_text
from r2bspec.errors import R2bspecError
from r2bspec.fleet.errors import NoHostError, VersionDiffersError
from r2bspec.fleet.messages import HostState
from r2bspec.judge.measure.units import show
from r2bspec.plan.plan import Plan
from r2bspec.plan.this_machine import MachineFacts, gpus, ros_distro, unmet

ALL: Final = "all"
ANY: Final = "any"


HostName = Annotated[str, msgspec.Meta(pattern=r"^(?!\.)[^/,\x00-\x1f\x7f]{1,200}\Z")]
"""It names a folder, and is listed by commas."""


class HostFacts(MachineFacts, frozen=True, kw_only=True):
    """A host, as it describes itself when it joins a fleet.

    Attributes:
        doctor: what `r2bspec doctor` warns of there, by the name of the check.
        allows: what specs may do there besides running what is installed: ``commands``,
            ``python``.
    """

    name: HostName
    cpu: str = ""
    memory_bytes: int = 0
    rmw: str = ""
    os: str = ""
    r2bspec: str = ""
    python: str = ""
    doctor: dict[str, str] = msgspec.field(default_factory=dict)
    allows: tuple[str, ...] = ()

    @property
    def version_error(self) -> R2bspecError | None:
        """Why this client cannot use the host, if it has another version."""
        if self.r2bspec == __version__:
            return None
        return VersionDiffersError(
            f"the host {self.name} has r2bspec {self.r2bspec}, and this one is {__version__}",
            hint="Install the same version on both: they measure and judge alike only then.",
        )


class Host(NamedTuple):
    """A host that is in the fleet now.

    Attributes:
        address: of its worker; another one after the worker was restarted.
        state: what it did when it was last heard of.
        seen_s: seconds since then.
    """

    address: str
    facts: HostFacts
    state: HostState
    seen_s: float = 0.0

    @property
    def name(self) -> str:
        """The name of the host."""
        return self.facts.name

    @property
    def figures(self) -> tuple[str, str]:
        """What is left of its run, and the p99 so far; empty where they are not known."""
        left_s, p99_ns = self.state.left_s, self.state.p99_ns
        return (
            time_text(left_s) if left_s is not None else "",
            show(p99_ns / 1e9, "s") if p99_ns is not None else "",
        )


def describe_host(
    name: str, labels: Mapping[str, str], *, allows: tuple[str, ...] = (), doctor: bool = True
) -> HostFacts:
    """Describe this machine.

    Args:
        name: in the fleet; that of the machine if empty.
        labels: of its owner.
        allows: see `HostFacts`.
        doctor: whether to run the checks of `r2bspec doctor`, which take a moment.
    """
    from r2bspec.execute.processes.machine import describe_machine, describe_versions

    machine = describe_machine()
    return HostFacts(
        name=name or socket.gethostname(),
        arch=machine["architecture"],
        cpu=machine["cpu"],
        cores=machine["cores"],
        memory_bytes=machine["memory_bytes"],
        gpus=tuple(machine["gpus"]) or gpus(),
        ros_distro=ros_distro(),
        rmw=describe_versions().get("rmw", ""),
        os=machine["os"],
        labels=dict(labels),
        r2bspec=__version__,
        python=platform.python_version(),
        doctor=_warnings() if doctor else {},
        allows=allows,
    )


def _warnings() -> dict[str, str]:
    from r2bspec.doctor.all_checks import examine
    from r2bspec.doctor.checkup import System

    checks = examine(System(runs=Path("runs")))
    return {check.name: check.found for check in checks if check.status != "ok"}


class Placement(NamedTuple):
    """A run of a plan: on `host`, or on any of `hosts` if it is empty; or why it has none."""

    host: str
    hosts: frozenset[str]
    error: R2bspecError | None = None


def place(
    plan: Plan,
    facts: Mapping[str, HostFacts],
    names: Sequence[str],
    expected: Collection[str] = (),
) -> Iterator[Placement]:
    """The runs of a plan on a fleet, sorted by host.

    Args:
        plan: of the benchmark.
        facts: of the hosts that are in the fleet, by name.
        names: ``all`` for a run on every host that fits, ``any`` for one run on any of them, or
            the names of hosts.
        expected: with ``all``, hosts that were in the fleet when the suite was begun.
    """
    lacks = {name: unmet(plan.requires or None, host) for name, host in facts.items()}
    fitting = {name for name, what in lacks.items() if not what}
    errors = {name: host.version_error for name, host in facts.items()}
    usable = frozenset(name for name in fitting if errors[name] is None)
    is_all, is_any = tuple(names) == (ALL,), tuple(names) == (ANY,)
    absent = set(expected) - set(facts) if is_all else set()
    if (is_all or is_any) and not fitting:
        yield from (Placement(name, frozenset({name})) for name in sorted(absent))
        yield Placement("", frozenset(), _nothing_fits(lacks))
    elif is_any:
        yield Placement("", usable, None if usable else errors[min(fitting)])
    else:
        for name in sorted(fitting | absent) if is_all else names:
            error = errors.get(name)
            if name not in facts and name not in expected:
                present = ", ".join(sorted(facts)) or "none"
                error = NoHostError(f"no host {name!r} is in the fleet; its hosts: {present}")
            elif lacks.get(name):
                error = _nothing_fits({name: lacks[name]})
            yield Placement(name, frozenset({name} if error is None else ()), error)


def _nothing_fits(lacks: Mapping[str, Sequence[str]]) -> R2bspecError:
    """Every host, with what it lacks."""
    if not lacks:
        return NoHostError(
            "no host is in the fleet", hint="Start workers with 'r2bspec fleet worker'."
        )
    parts = "; ".join(f"{name}: {', '.join(what)}" for name, what in sorted(lacks.items()))
    return NoHostError(
        f"no host is what the spec requires: {parts}",
        hint="Change 'requires' in the spec, or add a host that fits.",
    )
