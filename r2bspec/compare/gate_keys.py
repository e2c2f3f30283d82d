"""The gate of a plan, key by key: what a verdict depends on, and which change of it is weaker.

A field of a plan that is neither in `GATE_FIELDS` nor free (`is_free`) is reported as a weaker gate
under its own name, until it is added to one of them.

Numbers and ranks have an order: less is weaker (`float`), or more is (`neg`). Of anything else no
change is known to be harmless, so each one counts as weaker. Objectives are compared in
`r2bspec.compare.objective_strength`.

Inputs, data, preprocessors and playback decide how hard the graph has to work, monitors what is
seen of it: the load. No change of it is known to be harmless, except that a monitor may be added or
get another name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from operator import neg
from typing import Any, Final

import msgspec

from r2bspec.compare.gate_change import (
    GateChange,
    GateKey,
    difference_change,
    field_changes,
    rank,
    rate_text,
    spec_of,
    value_text,
)
from r2bspec.compare.objective_strength import implies, objective_changes, subjects
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.benchmark_defaults import default_starts
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.quantities import Duration, Share, Size
from r2bspec.language.spec import Pacing
from r2bspec.plan.comparability import change_of, diff_plans
from r2bspec.plan.plan import CallPlan, GatePlan, MonitorPlan, Plan, PlayPlan
from r2bspec.plan.prepared_benchmark import PreparedBenchmark


def _window_text(end_ns: int | None) -> str:
    return str(Duration(end_ns)) if end_ns is not None else "the end"


DATA_KEYS: Final[Mapping[str, str | GateKey]] = {
    "source": "bag",
    "kind": "bag",
    "sha256": "bag",
    "start_ns": GateKey("data", ("data_loader", "window"), text=_window_text),
    "end_ns": GateKey("data", ("data_loader", "window"), text=_window_text),
}
"""Fields of `DatasetPlan` that have not the name of the key that sets them, with that key."""


def input_keys(name: str) -> dict[str, str | GateKey]:
    """Fields of `InputPlan`, likewise, of an input with this name."""
    return {
        "type": "format",
        "source": "from",
        "bag_topic": "from",
        "later_ns": GateKey(f"input {name}", ("playback", "timeline", "translations", name)),
        "slop_ns": "pairing",
        "recorded_rate": "rate",
    }


MONITOR_KEYS: Final[Mapping[str, str]] = {
    "type": "format",
    "ratio_inputs": "ratio",
    "ratio_outputs": "ratio",
}
"""Fields of `MonitorPlan`, likewise."""


FREE_MONITOR_FIELDS: Final[Mapping[str, Any]] = {
    "name": "",
    "label": "",
    "taps": (),
}
"""What changes no verdict, and its value in a comparison: words, and the topics on the path, which
are those of the graph."""


TIMELINE_KEYS: Final[Mapping[str, str]] = {
    "speed": "timeline.speed",
    "recorded": "record_timeline",
    "shift_tf": "tf",
}
"""Fields of `TimelinePlan`, with the key below ``playback`` that sets each."""


def monitor_names(base: Plan, head: Plan) -> dict[str, str]:
    """The name in the head of each monitor of the base that the head has.

    A monitor that only has another name is the same one.
    """
    names = {monitor.name for monitor in head.monitors}
    kept = {monitor.name: monitor.name for monitor in base.monitors if monitor.name in names}
    new = [monitor for monitor in head.monitors if monitor.name not in kept]
    for monitor in base.monitors:
        same = [other for other in new if _content(other) == _content(monitor)]
        if monitor.name not in kept and same:
            kept[monitor.name] = same[0].name
            new.remove(same[0])
    return kept


def _content(monitor: MonitorPlan) -> MonitorPlan:
    """A monitor without what is free to change."""
    return msgspec.structs.replace(monitor, **FREE_MONITOR_FIELDS)


def input_names(side: PreparedBenchmark) -> dict[str, str]:
    """The name in the document of each playback input, by its topic."""
    spec = spec_of(side)
    topics = [input_.topic for input_ in side.plan.inputs]
    names = list(spec.playback.inputs) if spec is not None else topics
    return dict(zip(topics, names, strict=True))


def _monitors(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    """Monitors that are gone or observe something else, and new ones."""
    names = monitor_names(base.plan, head.plan)
    of_head = {monitor.name: monitor for monitor in head.plan.monitors}
    for monitor in base.plan.monitors:
        name = f"monitor {monitor.name}"
        if monitor.name not in names:
            yield GateChange(name, ("monitors", monitor.name), monitor.topic, "")
            continue
        now = of_head[names[monitor.name]]
        path = ("monitors", now.name)
        yield from field_changes(_content(monitor), _content(now), name, path, MONITOR_KEYS)
    for name, monitor in of_head.items():
        if name not in names.values():
            path = ("monitors", name)
            yield GateChange(f"monitor {name}", path, "", monitor.topic, weaker=False)


def _inputs(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    """Inputs that are gone, new, or have other messages."""
    before, after = ({input_.topic: input_ for input_ in side.plan.inputs} for side in (base, head))
    names = input_names(base) | input_names(head)
    for topic in before | after:
        name, path = f"input {names[topic]}", ("playback", "inputs", names[topic])
        was, now = before.get(topic), after.get(topic)
        if was is None or now is None:
            texts = ("" if input_ is None else input_.source for input_ in (was, now))
            yield GateChange.between(name, path, texts)
            continue
        yield from field_changes(was, now, name, path, input_keys(names[topic]))


def call_keys(call: CallPlan) -> dict[str, str]:
    """Fields of `CallPlan`, as in `DATA_KEYS`."""
    kind, request = ("action", "goal") if call.accepted else ("service", "request")
    return {
        "name": kind,
        "target": f"{kind}.name",
        "type": f"{kind}.type",
        "request": f"{kind}.{request}",
        "source": "from",
        "accepted": kind,
        "feedback": "feedback",
    }


def _calls(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    """Calls that are gone, new, or have another request."""
    before, after = (
        {call.name: call for call in side.plan.called.values()} for side in (base, head)
    )
    for call in before | after:
        name, path = f"call {call}", ("playback", "calls", call)
        was, now = before.get(call), after.get(call)
        if was is None or now is None:
            texts = ("" if one is None else one.target for one in (was, now))
            yield GateChange.between(name, path, texts)
        else:
            yield from field_changes(was, now, name, path, call_keys(now))


def _data(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    """Other recordings, or another part of them."""
    before, after = (side.plan.datasets or (side.plan.dataset,) for side in (base, head))
    if len(before) != len(after):
        sources = (
            ", ".join(dataset.source for dataset in datasets) for datasets in (before, after)
        )
        yield GateChange.between("data", ("data_loader", "bags"), sources)
        return
    path = ("data_loader",)
    for was, now in zip(before, after, strict=True):
        # A digest that was not there before makes no other recording possible.
        order = None if was.sha256 and now.sha256 else bool
        keys = {**DATA_KEYS, "sha256": GateKey("data", (*path, "bag"), order)}
        yield from field_changes(was, now, "data", path, keys)


def _timeline(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    was, now = base.plan.timeline, head.plan.timeline
    if was is not None and now is not None:
        yield from field_changes(was, now, "playback", ("playback",), TIMELINE_KEYS)
    elif base.plan.playback_mode == head.plan.playback_mode:
        yield from _playback_key("timeline").changes(was, now)


def _playback_key(name: str, order: Callable[[Any], float] | None = None) -> GateKey:
    return GateKey("playback", ("playback", name), order)


def _preprocessors(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    """What prepares the inputs is part of the load, unlike the graph."""
    preparing = {
        process.name
        for process in (*base.plan.processes, *head.plan.processes)
        if process.phase == "preprocess" and process.role != "loader"
    }
    for difference in diff_plans(base.plan, head.plan):
        if difference.path[0] == "processes" and str(difference.path[1]) in preparing:
            path = ("preprocessors", str(difference.path[1]).removeprefix("preprocess."))
            yield difference_change(difference, "preprocessors", path)
    external = (
        sorted(node.name for node in side.plan.external if node.phase == "preprocess")
        for side in (base, head)
    )
    yield from GateKey("preprocessors", ("preprocessors",)).changes(*external)


_Rule = Callable[[PreparedBenchmark, PreparedBenchmark], Iterator[GateChange]]


def _budget_text(budget_ns: int) -> str:
    return str(Duration(budget_ns)) if budget_ns else "none"


def _benchmark_key(
    name: str,
    order: Callable[[Any], float],
    text: Callable[[Any], object] = value_text,
    key: str = "",
) -> GateKey:
    return GateKey(name, ("benchmark", *(key or name).split(".")), order, text)


GATE_KEYS: Final[Mapping[str, GateKey]] = {
    "confidence": _benchmark_key("confidence", float, Share, "gate.confidence"),
    "inconclusive": _benchmark_key("gate.inconclusive", rank("pass", "report", "fail")),
    "confirm": _benchmark_key("gate.confirm", rank(True, False)),
    # A budget of none is longer than any.
    "time_budget_ns": _benchmark_key("gate.time_budget", lambda ns: ns or math.inf, _budget_text),
    "interference": _benchmark_key("gate.interference", rank("tolerate", "note")),
}
"""Fields of `GatePlan`; others, and keys of ``gate`` in a document, are without an order."""

PLAY_KEYS: Final[Mapping[str, GateKey]] = {
    "duration_ns": _benchmark_key("duration", float, Duration),
    "iterations": _benchmark_key("iterations", float),
    "max_iterations": _benchmark_key("max_iterations", float),
}
"""Fields of `PlayPlan` other than its rate."""

SEARCH_KEYS: Final[Mapping[str, GateKey]] = {
    "min_hz": _benchmark_key("search", neg, rate_text, "search.min"),
    "max_hz": _benchmark_key("search", float, rate_text, "search.max"),
    "precision": _benchmark_key("search", neg, Share, "search.precision"),
    "probe_ns": _benchmark_key("search", float, Duration, "search.probe"),
    "confirm_ns": _benchmark_key("search", float, Duration, "search.confirm"),
    "confidence": _benchmark_key("search", float, Share, "search.confidence"),
}
"""Fields of `SearchPlan` other than its conditions."""


def plan_changes(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    """Every difference of two plans that a verdict may depend on, in the order of `GATE_FIELDS`."""
    compared: set[_Rule] = set()
    for field, rule in GATE_FIELDS.items():
        if isinstance(rule, GateKey):
            yield from rule.changes(getattr(base.plan, field), getattr(head.plan, field))
        elif rule not in compared:
            compared.add(rule)
            yield from rule(base, head)
    named: set[str] = set(GATE_FIELDS)
    for difference in diff_plans(base.plan, head.plan):
        field = str(difference.path[0])
        if field not in named and not is_free(field):
            named.add(field)
            yield difference_change(difference, field, difference.path)


def _plays(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    path = ("benchmark", "rates")
    before, after = ({play.rate_hz: play for play in side.plan.play} for side in (base, head))
    if before.keys() != after.keys():
        texts = (", ".join(map(rate_text, sorted(plays))) or "none" for plays in (before, after))
        yield GateChange.between("rates", path, texts, weaker=not before.keys() <= after.keys())
    pairs = [(before[rate_hz], after[rate_hz]) for rate_hz in before if rate_hz in after]
    if not pairs:
        pairs = list(zip(base.plan.play[:1], head.plan.play[:1], strict=False))
    was, now = base.plan.play_at_peak, head.plan.play_at_peak
    if was is not None and now is not None:
        pairs.append((was, now))
    elif was != now and base.plan.objectives == head.plan.objectives:
        texts = ("at the peak rate" if play is not None else "" for play in (was, now))
        yield GateChange.between("rates", path, texts, weaker=now is None)
    for pair in pairs:
        # Two that play as many as `iterations` say are compared by these alone.
        whole = any(play.max_iterations for play in pair)
        first, second = (_played(play, whole=whole) for play in pair)
        yield from field_changes(first, second, "*", ("benchmark",), PLAY_KEYS)


def _played(play: PlayPlan, *, whole: bool) -> PlayPlan:
    """A play at any rate, with the most iterations that it may have."""
    most = max(play.iterations, play.max_iterations) if whole else 0
    return msgspec.structs.replace(play, rate_hz=0.0, max_iterations=most)


def _starts(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    if all(_has_default_starts(side.plan) for side in (base, head)):
        return  # they follow from the iterations, which are compared as such
    yield from _benchmark_key("starts", float).changes(base.plan.starts, head.plan.starts)


def _has_default_starts(plan: Plan) -> bool:
    plays = (*plan.play, *((plan.play_at_peak,) if plan.play_at_peak else ()))
    return any(plan.starts == default_starts(play.iterations) for play in plays)


def _search(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    was, now = base.plan.search, head.plan.search
    path = ("benchmark", "search")
    if was is not None and now is not None:
        yield from _conditions(base, head)
        alike = msgspec.structs.replace(now, holds=was.holds)
        yield from field_changes(was, alike, "search", path, SEARCH_KEYS)
    elif was != now:
        texts = (
            "" if search is None else f"up to {rate_text(search.max_hz)}" for search in (was, now)
        )
        yield GateChange.between("search", path, texts, weaker=now is None)


def _conditions(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    """Conditions of a probe that one side has, and the other does not imply."""
    was = _located(base, monitor_names(base.plan, head.plan))
    now = _located(head, {monitor.name: monitor.name for monitor in head.plan.monitors})
    for before, after, weaker in ((was, now, True), (now, was, False)):
        for condition, subject in before:
            same = [other for other, about in after if about == subject]
            if not any(implies(other, condition) for other in same):
                texts = condition.text, same[0].text if same else ""
                path = ("benchmark", "search", "holds")
                yield GateChange.between(
                    "search", path, texts if weaker else reversed(texts), weaker=weaker
                )


def _located(
    side: PreparedBenchmark, monitors: Mapping[str, str]
) -> list[tuple[Requirement, tuple[str, str]]]:
    """The conditions of the search, each with the monitors that it is about."""
    conditions = side.plan.search.holds if side.plan.search is not None else ()
    return [
        (condition, subject)
        for condition in conditions
        for subject in subjects(condition, side, monitors)
    ]


def _gate(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    path = ("benchmark", "gate")
    yield from field_changes(base.plan.gate, head.plan.gate, "gate.*", path, GATE_KEYS)
    # Keys of the document that no plan has.
    was, now = (spec.benchmark.gate if (spec := spec_of(side)) else None for side in (base, head))
    for field in was.__struct_fields__ if was is not None and now is not None else ():
        if not {field, f"{field}_ns"} & set(GatePlan.__struct_fields__):
            key = GateKey(f"gate.{field}", (*path, field))
            yield from key.changes(getattr(was, field), getattr(now, field))


def _longer_is_weaker(duration: Duration) -> float:
    return -duration.ns


def _segment_text(segment_bytes: int) -> str:
    return str(Size(segment_bytes)) if segment_bytes else "the default"


def _processes(base: PreparedBenchmark, head: PreparedBenchmark) -> Iterator[GateChange]:
    """The graph is free to change, but neither its memory limits nor what prepares its inputs."""
    yield from _memory_limits(base.plan, head.plan)
    yield from _preprocessors(base, head)


def _memory_limits(base: Plan, head: Plan) -> Iterator[GateChange]:
    """Limits of resident memory; a process that has no limit has an infinite one."""
    limits = [
        {
            process.name: process.memory_limit_bytes
            for process in plan.processes
            if process.phase == "measure"
        }
        for plan in (base, head)
    ]
    for name in limits[0] | limits[1]:
        was, now = (limit.get(name, 0) or math.inf for limit in limits)
        if was != now:
            texts = (str(Size(int(limit))) if limit < math.inf else "" for limit in (was, now))
            path: Path = ("graph", "nodes", name, "memory_limit")
            yield GateChange.between(f"memory_limit {name}", path, texts, weaker=now > was)


GATE_FIELDS: Final[Mapping[str, _Rule | GateKey]] = {
    "objectives": lambda base, head: objective_changes(
        base, head, monitor_names(base.plan, head.plan)
    ),
    "monitors": _monitors,
    "inputs": _inputs,
    "calls": _calls,
    "dataset": _data,
    "datasets": _data,
    "playback_mode": _playback_key("mode"),
    "buffer": _playback_key("buffer"),
    "unpaired": _playback_key("unpaired", rank("drop", "refuse")),
    "clock": _playback_key("clock"),
    "timeline": _timeline,
    "play": _plays,
    "play_at_peak": _plays,
    "starts": _starts,
    "search": _search,
    **{name: _benchmark_key(name, _longer_is_weaker, str) for name in Pacing.__struct_fields__},
    "anatomy": GateKey("anatomy", ("benchmark", "anatomy")),
    "gate": _gate,
    "transport": GateKey("transport", ("transport",)),
    "segment_bytes": GateKey("transport", ("transport", "segment"), text=_segment_text),
    "harness": lambda base, head: field_changes(
        base.plan.harness, head.plan.harness, "harness", ("harness",), {}
    ),
    "requires": GateKey("requires", ("requires",)),
    "processes": _processes,
    "external": _processes,
}
"""The fields of a plan that a verdict depends on, with the key of each, or what compares it."""

FREE_FIELDS: Final = frozenset({"generator", "name", "title", "description", "labels"})
"""Texts, which may change, and the version of the compiler; specs are matched by path or name."""


def is_free(field: str) -> bool:
    """Whether a field of a plan may change without a word: a text, or one that shows the graph.

    Raises:
        KeyError: the field has no key in `plan.comparability`.
    """
    return field not in GATE_FIELDS and (field in FREE_FIELDS or change_of(field) == "graph")
