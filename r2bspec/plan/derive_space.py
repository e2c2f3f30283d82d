"""The deployments of a graph that can be tried, from its spec, its wiring and the machine.

Nothing is executed, and nothing is read. Each setting is a list of assignments, so that a
deployment is checked like every spec; a setting that this module knows to be refused is left out.

Without `tune.levers` only that is varied which changes nothing for other programs of the machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import msgspec

from r2bspec.diagnostics.diagnostic import Path, format_path
from r2bspec.diagnostics.quote import quoted_list
from r2bspec.language.quantities import Size
from r2bspec.language.spec import Container, QoS, Spec, StartedProcess
from r2bspec.language.spec_graph import PROCESS_KEYS
from r2bspec.language.variables import assigned_path, parse_path, paths_overlap
from r2bspec.plan.placements import Placement, find_placements, typical_bytes
from r2bspec.plan.plan import ProcessPlan
from r2bspec.plan.process_levers import ON_REQUEST, ProcessLevers, TunedProcess
from r2bspec.plan.this_machine import SchedulingFacts
from r2bspec.plan.tuning_space import Lever, Setting, TuningSpace, assignment, value_text
from r2bspec.plan.wiring.wiring import NodeWiring, Wiring

PLACEMENT: Final = "graph.placement"
"""The lever on which those of processes depend."""

_MAX_PROCESSES: Final = 12
"""Processes with levers of their own: the search is for the few that matter."""

_SEGMENT_MESSAGES: Final = (6, 96)
"""Sizes of segments, in messages; by default one holds 24 of the largest."""
_LARGE_MESSAGE: Final = 64 * 1024

_PROCESS_KEYS: Final = (*PROCESS_KEYS, "env", "executable")


def derive_space(
    spec: Spec, wiring: Wiring, facts: SchedulingFacts, *, largest_message_bytes: int = 0
) -> TuningSpace:
    """All deployments that a search may try.

    Args:
        spec: without errors.
        wiring: of it.
        facts: of the machine on which the deployments run.
        largest_message_bytes: of the recorded messages; 0 if it is not known.
    """
    return _Space(spec, wiring, facts, largest_message_bytes).derived()


class _Space:
    def __init__(
        self, spec: Spec, wiring: Wiring, facts: SchedulingFacts, largest_message_bytes: int
    ) -> None:
        self._spec = spec
        self._wiring = wiring
        self._facts = facts
        self._largest_message_bytes = largest_message_bytes
        self._of_process = ProcessLevers(spec.tune, facts)
        self._varies = self._of_process.varies
        self._left_out: list[str] = []

    def derived(self) -> TuningSpace:
        """The levers: of the placement, of each process, of all of them, and the user's own."""
        placements, left_out = find_placements(
            self._spec,
            self._wiring,
            by_placement=self._varies("placement"),
            by_containers=self._varies("containers"),
        )
        self._left_out += left_out
        placement = Lever(name=PLACEMENT, settings=tuple(each.setting for each in placements))
        movers = self._overlapping(placement)
        if movers:
            # The processes of other placements than today's are not known: own values make them.
            placements = placements[:1]
        levers = [placement]
        processes = self._processes(placements)
        today_only = dict.fromkeys(movers, (0,))
        for process in self._busiest(processes):
            only_with = _only_with(process.places, placements) | today_only
            levers += [
                msgspec.structs.replace(lever, only_with=only_with)
                for lever in self._of_process.levers(process)
            ]
        levers += self._intra_process(placements)
        levers += self._qos()
        levers += self._transport()
        own = list(self._own(processes, placements))
        levers = [lever for lever in levers if not self._overlapping(lever)]
        varied = [lever for lever in (*levers, *own) if len(lever.settings) > 1]
        names = {lever.name for lever in varied}
        return TuningSpace(
            levers=tuple(
                msgspec.structs.replace(
                    lever,
                    only_with={name: at for name, at in lever.only_with.items() if name in names},
                )
                for lever in varied
            ),
            left_out=tuple(
                dict.fromkeys((*self._left_out, *self._of_process.left_out, *self._not_asked()))
            ),
        )

    def _overlapping(self, lever: Lever) -> list[str]:
        """The keys of `tune.values` that set what a lever sets, a part of it, or more than it."""
        paths = [parse_path(lever.name)]
        paths += [assigned_path(each) for setting in lever.settings for each in setting.sets]
        return [
            name
            for name in self._spec.tune.values
            # What is no path is an error of its own.
            if (own := parse_path(name)) and any(paths_overlap(path, own) for path in paths)
        ]

    def _not_asked(self) -> Iterator[str]:
        for group, why in ON_REQUEST.items() if not self._spec.tune.levers else ():
            yield f"{group}: {why}; name it in 'tune.levers' to vary it"
        if not self._spec.tune.levers:
            yield (
                "rmw: RMW_IMPLEMENTATION is of the environment; 'r2bspec run SPEC --against "
                "env:RMW_IMPLEMENTATION=NAME' compares another one that is installed"
            )
        if self._varies("qos"):
            yield (
                "qos: 'qos' of a node states what its code has; what changes it is a parameter "
                "'qos_overrides...', if the spec has one"
            )

    def _processes(self, placements: Sequence[Placement]) -> list[TunedProcess]:
        """Every process of some placement that has settings in the spec, by its first one."""
        found: dict[Path, tuple[StartedProcess, ProcessPlan, list[int]]] = {}
        for place, placement in enumerate(placements):
            for plan in placement.processes:
                owner = _owner(plan, self._spec, placement.containers)
                if owner is not None:
                    path, settings = owner
                    found.setdefault(path, (settings, plan, []))[2].append(place)
        kept = set(self._spec.tune.keep)
        programs = {node.key for node in self._wiring.measure.nodes if node.start.style == "main"}
        return [
            TunedProcess(
                path,
                settings,
                plan,
                tuple(places),
                own_executor=any(node.node in programs for node in plan.nodes),
            )
            for path, (settings, plan, places) in found.items()
            if kept.isdisjoint(node.node for node in plan.nodes)
        ]

    def _busiest(self, processes: Sequence[TunedProcess]) -> list[TunedProcess]:
        """Those whose nodes have the most traffic, in their order."""
        phase = self._wiring.measure
        nodes = {node.key: node.name for node in phase.nodes}
        traffic = {
            process.path: sum(
                typical_bytes(end.type)
                for node in process.plan.nodes
                for end in phase.endpoints_of(nodes.get(node.node, ""))
            )
            for process in processes
        }
        first = sorted(processes, key=lambda process: -traffic[process.path])[:_MAX_PROCESSES]
        if len(processes) > _MAX_PROCESSES:
            self._left_out.append(
                f"{len(processes) - _MAX_PROCESSES} processes have no levers of their own: only "
                f"the {_MAX_PROCESSES} with the most traffic have; 'tune.values' adds others"
            )
        return [process for process in processes if process in first]

    def _intra_process(self, placements: Sequence[Placement]) -> Iterator[Lever]:
        """One lever for all components: both sides of a topic need it."""
        nodes = [node for node in self._wiring.measure.nodes if node.role == "container"]
        free = [node for node in nodes if node.key not in self._spec.tune.keep]
        refused = [node.key for node in free if self._keeps_all(node)]
        if refused:
            self._left_out.append(
                f"intra_process of {quoted_list(refused)}: 'history: keep_all' does not permit it"
            )
        able = [node for node in free if node.key not in refused]
        places = tuple(
            place
            for place, placement in enumerate(placements)
            if any(
                sum(node.node in {each.key for each in able} for node in process.nodes) > 1
                for process in placement.processes
            )
        )
        if not self._varies("intra_process") or not places:
            return
        on = [node.key for node in able if node.node.intra_process]
        today = "on" if len(on) == len(able) else f"on for {len(on)} nodes" if on else "off"
        others = (
            Setting(
                text=text,
                sets=tuple(
                    assignment((*node.path, "intra_process"), value)
                    for node in able
                    if node.node.intra_process != value
                ),
            )
            for text, value in (("off", False), ("on", True))
        )
        only_with = _only_with(places, placements)
        yield Lever.of("intra_process", today, others, only_with=only_with)

    def _keeps_all(self, node: NodeWiring) -> bool:
        profiles: Iterable[QoS] = (*node.interface.qos.values(), *node.node.qos.values())
        return any(profile.history == "keep_all" for profile in profiles)

    def _qos(self) -> Iterator[Lever]:
        """Depths that the spec overrides already: that of another topic the code may not permit."""
        for node in self._wiring.measure.nodes if self._varies("qos") else ():
            if node.key in self._spec.tune.keep or node.node.parameter_sources:
                continue
            for name, now in node.node.parameters.items():
                if not name.startswith("qos_overrides."):
                    continue
                path = (*node.path, "parameters", name)
                values: tuple[Any, ...] = ()
                if name.endswith(".depth"):
                    values = (1, 10, 100)
                elif name.endswith(".subscription.reliability") and now == "reliable":
                    # Such a subscription matches every publisher.
                    values = ("best_effort",)
                yield Lever.of(format_path(path), value_text(now), _settings(path, values))

    def _transport(self) -> Iterator[Lever]:
        """The transport of all processes, the player and the monitors included."""
        if not self._varies("transport"):
            return
        now = self._spec.transport
        today: str = now.kind if now.segment is None else f"{now.kind}, segments of {now.segment}"
        settings = [Setting(text=today)]
        settings += [
            Setting(text=kind, sets=(f"transport={kind}",))
            for kind in ("shared_memory", "udp")
            if kind != now.kind
        ]
        if now.kind == "shared_memory" and self._largest_message_bytes >= _LARGE_MESSAGE:
            for messages in _SEGMENT_MESSAGES:
                mebibytes = -(-messages * self._largest_message_bytes // 2**20)
                size = Size(mebibytes * 2**20)
                if size != now.segment:
                    text = f"shared_memory, segments of {size}"
                    value = f"{{kind: shared_memory, segment: {size}}}"
                    settings.append(Setting(text=text, sets=(f"transport={value}",)))
        yield Lever(name="transport", settings=tuple(settings))

    def _own(
        self, processes: Sequence[TunedProcess], placements: Sequence[Placement]
    ) -> Iterator[Lever]:
        """The levers of `tune.values`."""
        places = {process.path: process.places for process in processes}
        for name, values in self._spec.tune.values.items():
            path = parse_path(name)
            now = _value_in(self._spec, path)
            if isinstance(now, Mapping | msgspec.Struct):
                now = None
            today = value_text(now) if now is not None else "as it is"
            length = 2 if path[:1] == ("containers",) else 3
            of_process = len(path) > length and path[length] in _PROCESS_KEYS
            where = places.get(path[:length]) if of_process else None
            only_with = _only_with(where, placements) if where is not None else {}
            yield Lever.of(name, today, _settings(path, values), only_with=only_with)


def _settings(path: Path, values: Iterable[object]) -> Iterator[Setting]:
    """Each value of a key as a setting."""
    for value in values:
        yield Setting(text=value_text(value), sets=(assignment(path, value),))


def _owner(
    plan: ProcessPlan, spec: Spec, containers: Mapping[str, Container]
) -> tuple[Path, StartedProcess] | None:
    """The part of the spec that has the settings of a process; None if there is none."""
    if plan.container:
        return ("containers", plan.container), containers[plan.container]
    node = spec.graph.nodes.get(plan.name)
    # A launch file starts processes that are not r2bspec's.
    if node is None or node.kind.by_others:
        return None
    return ("graph", "nodes", plan.name), node


def _only_with(
    places: Sequence[int], placements: Sequence[Placement]
) -> dict[str, tuple[int, ...]]:
    return {PLACEMENT: tuple(places)} if len(places) < len(placements) else {}


def _value_in(value: Any, path: Path) -> Any:
    """What a spec has at a path; None if it has nothing there."""
    for step in path:
        if isinstance(value, msgspec.Struct):
            fields = dict(zip(value.__struct_encode_fields__, value.__struct_fields__, strict=True))
            value = getattr(value, fields[str(step)]) if step in fields else None
        elif isinstance(value, Mapping):
            value = value.get(step)
        elif isinstance(value, tuple) and isinstance(step, int) and step < len(value):
            value = value[step]
        else:
            return None
    return value
