"""The levers of one process of the graph: its executor, and what the kernel does with it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any, Final

import msgspec

from r2bspec.diagnostics.diagnostic import Path, format_path
from r2bspec.language.spec import Container, StartedProcess
from r2bspec.language.spec_tune import LeverGroup, Tune
from r2bspec.plan.plan import ProcessPlan
from r2bspec.plan.this_machine import SchedulingFacts
from r2bspec.plan.tuning_space import Lever, Setting, assignment

ON_REQUEST: Final[Mapping[str, str]] = {
    "cpus": "pinned processes keep CPUs from others, and others may be on theirs",
    "scheduling": "real time runs before every other program of the machine",
    "nice": "who waits for whom changes little unless the CPUs are all busy",
    "environment": "what OMP_NUM_THREADS and MALLOC_ARENA_MAX do depends on a node's libraries",
}
"""Why a group is no lever unless `tune.levers` names it."""

_NICE: Final = 10
_PRIORITY: Final = 40
_VARIABLES: Final = {"OMP_NUM_THREADS": (1, 2), "MALLOC_ARENA_MAX": (1, 2)}


class TunedProcess(msgspec.Struct, frozen=True):
    """A process whose settings the spec can state.

    Attributes:
        path: of the node or the container.
        settings: as they are.
        plan: of it in the first placement that has it.
        places: the placements that have it.
        own_executor: whether its program makes its executor itself.
    """

    path: Path
    settings: StartedProcess
    plan: ProcessPlan
    places: tuple[int, ...]
    own_executor: bool = False

    @property
    def name(self) -> str:
        """The name of the node or the container."""
        return str(self.path[-1])

    def key(self, *keys: str) -> str:
        """The path of a key of it."""
        return format_path((*self.path, *keys))

    def changed(self, values: Mapping[str, Any]) -> tuple[str, ...]:
        """Assignments for those of some settings that it does not have already."""
        return tuple(
            assignment((*self.path, key), value)
            for key, value in values.items()
            if getattr(self.settings, key) != value
        )


class ProcessLevers:
    """What can be varied of each process.

    Attributes:
        left_out: what was not made a lever, and why.
    """

    def __init__(self, tune: Tune, facts: SchedulingFacts) -> None:
        self._tune = tune
        self._facts = facts
        self.left_out: list[str] = []

    def varies(self, *groups: LeverGroup) -> bool:
        """Whether one of these groups is varied."""
        asked: Collection[str] = self._tune.levers
        return any(group in asked if asked else group not in ON_REQUEST for group in groups)

    def levers(self, process: TunedProcess) -> Iterator[Lever]:
        """The levers of a process; some have one setting only."""
        if self.varies("executor", "threads"):
            yield from self._executor(process)
        if self.varies("nice"):
            yield self._nice(process)
        if self.varies("cpus"):
            yield from self._cpus(process)
        if self.varies("scheduling"):
            yield self._scheduling(process)
        if self.varies("environment"):
            yield from self._environment(process)

    def _executor(self, process: TunedProcess) -> Iterator[Lever]:
        now = process.settings
        if process.plan.role == "container" and isinstance(now, Container):
            threaded, today = "component_container_mt", (now.executable, now.threads)
            counts = self._thread_counts(default=today == (threaded, 0))
            ways = [("component_container", 0), *((threaded, count) for count in counts)]
            ways.append(("component_container_isolated", 0))
            yield _executor_lever(process, "executable", "executable", today, ways)
        elif process.plan.role == "host" and process.own_executor:
            self.left_out.append(f"threads of {process.name}: its program has its own executor")
        elif process.plan.role == "host":
            now_threaded = (now.executor, now.threads)
            counts = self._thread_counts(default=now_threaded == ("multi_threaded", 0))
            hosts = [("single_threaded", 0), *(("multi_threaded", count) for count in counts)]
            yield _executor_lever(process, "threads", "executor", now_threaded, hosts)

    def _thread_counts(self, *, default: bool) -> list[int]:
        """2, 4, 8, ... and the limit; if an executor has the default now, not what that is."""
        cores = len(self._facts.cpus)
        most = self._tune.limits.threads or cores
        counts = {count for count in (2, 4, 8, 16, 32, 64) if count < most} | {most}
        return sorted(counts - ({1, cores} if default else {1}))

    def _nice(self, process: TunedProcess) -> Lever:
        now = process.settings.nice
        lowest = self._facts.lowest_nice
        values = [0, _NICE] if now <= 0 else [0, _NICE, 19]
        if lowest < 0:
            values.append(max(-_NICE, lowest))
        else:
            self.left_out.append(
                "nice below 0: it is not permitted; raise the limit for this user in "
                "/etc/security/limits.d, or with 'docker run --cap-add SYS_NICE'"
            )
        others = (
            Setting(
                text=str(value),
                sets=(assignment((*process.path, "nice"), value),),
                for_others=""
                if value >= 0
                else f"{process.name} gets more processor time than others (nice {value})",
            )
            for value in values
        )
        return Lever.of(process.key("nice"), str(now), others)

    def _cpus(self, process: TunedProcess) -> Iterator[Lever]:
        """Halves of the CPUs, so that two processes can have CPUs of their own."""
        cpus = self._facts.cpus
        if len(cpus) < 2:
            self.left_out.append("cpus: this machine has only one")
            return
        half = (len(cpus) + 1) // 2
        others = (
            Setting(
                text=_cpus_text(part),
                sets=(assignment((*process.path, "cpus"), list(part)),),
                for_others=f"{process.name} runs on {_cpus_text(part)} only, and shares it with "
                "what else is there",
            )
            for part in (cpus[:half], cpus[half:])
        )
        yield Lever.of(process.key("cpus"), _cpus_text(process.settings.cpus), others)

    def _scheduling(self, process: TunedProcess) -> Lever:
        now = process.settings.scheduling
        policy, priority = (now.policy, now.priority) if now is not None else (None, 0)
        highest = self._facts.realtime_priority
        ways = [("other", 0), ("batch", 0)]
        if highest:
            ways.append(("fifo", min(_PRIORITY, highest)))
        else:
            self.left_out.append(
                "scheduling, real time: it is not permitted; raise the limit 'rtprio' for this "
                "user in /etc/security/limits.d, or with 'docker run --ulimit rtprio=99'"
            )
        others = []
        for name, level in ways:
            path = (*process.path, "scheduling")
            sets = [assignment((*path, "policy"), name)]
            if level or priority:
                sets.append(assignment((*path, "priority"), level))
            realtime = f"{process.name} runs before every usual program of the machine"
            others.append(
                Setting(
                    text=_policy_text(name, level),
                    sets=tuple(sets),
                    for_others=realtime if level else "",
                )
            )
        today = _policy_text(policy or "other", priority)
        return Lever.of(process.key("scheduling"), today, others)

    def _environment(self, process: TunedProcess) -> Iterator[Lever]:
        env: Mapping[str, str] = getattr(process.settings, "env", {})
        for variable, values in _VARIABLES.items():
            now = env.get(variable, "unset")
            path = (*process.path, "env", variable)
            others = (Setting(text=str(value), sets=(assignment(path, value),)) for value in values)
            yield Lever.of(process.key("env", variable), now, others)


def _executor_lever(
    process: TunedProcess,
    name: str,
    kind_key: str,
    today: tuple[str, int],
    ways: Iterable[tuple[str, int]],
) -> Lever:
    """The lever of a kind of executor or container, and of the number of its threads."""
    others = (
        Setting(
            text=_executor_text(kind, threads),
            sets=process.changed({kind_key: kind, "threads": threads}),
        )
        for kind, threads in ways
    )
    return Lever.of(process.key(name), _executor_text(*today), others)


def _executor_text(kind: str, threads: int) -> str:
    if kind == "single_threaded":
        return "single-threaded"
    if kind == "multi_threaded":
        return f"{threads} threads" if threads else "multi-threaded"
    return f"{kind}, {threads} threads" if threads else kind


def _cpus_text(cpus: tuple[int, ...]) -> str:
    if not cpus:
        return "all CPUs"
    return f"{'CPU' if len(cpus) == 1 else 'CPUs'} {', '.join(map(str, cpus))}"


def _policy_text(policy: str, priority: int) -> str:
    return f"{policy}, priority {priority}" if priority else policy
