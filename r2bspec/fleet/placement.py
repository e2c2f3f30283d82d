"""Which hosts make which run: requirements of the spec against what the hosts are."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from r2bspec._version import __version__
from r2bspec.errors import R2bspecError
from r2bspec.fleet.errors import NoHostError, VersionDiffersError
from r2bspec.fleet.host_facts import HostFacts
from r2bspec.fleet.host_messages import PROTOCOL
from r2bspec.plan.host_match import unmet
from r2bspec.plan.plan import Plan

ALL: Final = "all"
ANY: Final = "any"


class Placement(NamedTuple):
    """A run of a plan: on `host`, or on any of `hosts` if it is empty; or why it has none."""

    host: str
    hosts: frozenset[str]
    error: R2bspecError | None = None


def place(
    plan: Plan,
    facts: Mapping[str, HostFacts],
    wanted: Sequence[str],
    expected: Collection[str] = (),
) -> Iterator[Placement]:
    """The runs of a plan on a fleet, sorted by host.

    Args:
        plan: of the benchmark.
        facts: of the hosts that are in the fleet, by name.
        wanted: ``all`` for a run on every host that fits, ``any`` for one run on any of them, or
            the names of hosts.
        expected: with ``all``, hosts that were in the fleet when the suite was begun.
    """
    lacks = {name: unmet(plan.requires or None, each.machine) for name, each in facts.items()}
    fitting = {name for name, found in lacks.items() if not found}
    if tuple(wanted) == (ALL,):
        yield from _on_each(sorted(fitting | (set(expected) - set(facts))), facts)
        if not fitting:
            yield Placement("", frozenset(), _nothing_fits(lacks))
    elif tuple(wanted) == (ANY,):
        usable = frozenset(name for name in fitting if _version_error(facts[name]) is None)
        if usable:
            yield Placement("", usable)
        elif fitting:
            yield Placement("", frozenset(), _version_error(facts[min(fitting)]))
        else:
            yield Placement("", frozenset(), _nothing_fits(lacks))
    else:
        for name in wanted:
            if name not in facts and name not in expected:
                known = ", ".join(sorted(facts)) or "none"
                error = NoHostError(f"no host {name!r} is in the fleet; its hosts: {known}")
                yield Placement(name, frozenset(), error)
            elif lacks.get(name):
                yield Placement(name, frozenset(), _nothing_fits({name: lacks[name]}))
            else:
                yield from _on_each([name], facts)


def _on_each(names: Sequence[str], facts: Mapping[str, HostFacts]) -> Iterator[Placement]:
    for name in names:
        error = _version_error(facts[name]) if name in facts else None
        yield Placement(name, frozenset() if error is not None else frozenset({name}), error)


def _version_error(facts: HostFacts) -> R2bspecError | None:
    if facts.r2bspec == __version__ and facts.protocol == PROTOCOL:
        return None
    return VersionDiffersError(
        f"the host {facts.name} has r2bspec {facts.r2bspec}, and this one is {__version__}",
        hint="Install the same version on both: they measure and judge alike only then.",
    )


def _nothing_fits(lacks: Mapping[str, Sequence[str]]) -> R2bspecError:
    """Every host, with what it lacks."""
    if not lacks:
        return NoHostError(
            "no host is in the fleet", hint="Start workers with 'r2bspec fleet worker'."
        )
    parts = "; ".join(f"{name}: {', '.join(found)}" for name, found in sorted(lacks.items()))
    return NoHostError(
        f"no host is what the spec requires: {parts}",
        hint="Change 'requires' in the spec, or add a host that fits.",
    )
