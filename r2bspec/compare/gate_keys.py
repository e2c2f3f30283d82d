"""The gate of a plan, key by key: what a verdict depends on, and which change of it is weaker.

`GATE_FIELDS` and `FREE_FIELDS` together have every field of a plan. A field that is in neither is
reported as a weaker gate under its own name, until somebody decides where it belongs.

Numbers and ranks have an order: less is weaker, or more is. Of anything else no change is known to
be harmless, so each one counts as weaker. Objectives are compared in
`r2bspec.compare.objective_strength`.

Inputs, data, preprocessors and playback decide how hard the graph has to work, monitors what is
seen of it: the load. No change of it is known to be harmless, except that a monitor may be added or
get another name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from r2bspec.compare.gate_change import (
    GateChange,
    GateSide,
    Key,
    difference_texts,
    duration_text,
    less_is_weaker,
    more_is_weaker,
    rank,
    rate_text,
    share_text,
    size_text,
    spec_of,
    unique,
    value_text,
)
from r2bspec.compare.objective_strength import implies, objective_changes, subjects
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.language.benchmark_defaults import default_starts
from r2bspec.language.requirement_grammar import Requirement
from r2bspec.plan.comparability import PlanDifference, diff_plans
from r2bspec.plan.plan import DatasetPlan, GatePlan, InputPlan, MonitorPlan, Plan, PlayPlan

DATA_KEYS: Final[Mapping[str, str]] = {
    "source": "bag",
    "kind": "bag",
    "sha256": "bag",
    "start_ns": "window",
    "end_ns": "window",
    "topics": "topics",
    "publish_tf": "publish_tf",
    "publish_tf_static": "publish_tf_static",
    "real_time": "real_time",
}
"""Fields of `DatasetPlan`, with the key that sets each."""


INPUT_KEYS: Final[Mapping[str, str]] = {
    "type": "format",
    "source": "from",
    "bag_topic": "from",
    "qos": "qos",
    "timestamp": "timestamp",
    "later_ns": "translations",
    "slop_ns": "pairing",
    "recorded_rate": "rate",
}
"""Fields of `InputPlan` other than its topic, with the key that sets each."""


MONITOR_KEYS: Final[Mapping[str, str]] = {
    "topic": "topic",
    "type": "format",
    "match": "match",
    "qos": "qos",
    "ratio_inputs": "ratio",
    "ratio_outputs": "ratio",
    "answers": "answers",
    "truth": "truth",
}
"""Fields of `MonitorPlan`, with the key that sets each."""


FREE_MONITOR_FIELDS: Final = ("name", "label", "taps")
"""What changes no verdict: words, and the topics on the path, which are those of the graph."""


TIMELINE_KEYS: Final[Mapping[str, Path]] = {
    "speed": ("timeline", "speed"),
    "recorded": ("record_timeline",),
    "shift_tf": ("tf",),
}
"""Fields of `TimelinePlan`, with the path below ``playback`` that sets each."""


def monitor_names(base: Plan, head: Plan) -> dict[str, str]:
    """The name in the head of each monitor of the base that the head has.

    A monitor that only has another name is the same one.
    """
    names = {each.name for each in head.monitors}
    kept = {each.name: each.name for each in base.monitors if each.name in names}
    new = [each for each in head.monitors if each.name not in kept]
    for monitor in base.monitors:
        same = [each for each in new if _content(each) == _content(monitor)]
        if monitor.name not in kept and same:
            kept[monitor.name] = same[0].name
            new.remove(same[0])
    return kept


def input_names(side: GateSide) -> dict[str, str]:
    """The name in the document of each playback input, by its topic."""
    spec = spec_of(side)
    topics = [each.topic for each in side.plan.inputs]
    names = list(spec.playback.inputs) if spec is not None else topics
    return dict(zip(topics, names, strict=True))


def monitor_changes(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    """Monitors that are gone or observe something else, and new ones."""
    names = monitor_names(base.plan, head.plan)
    of_head = {each.name: each for each in head.plan.monitors}
    for monitor in base.plan.monitors:
        name, path = f"monitor {monitor.name}", ("monitors", monitor.name)
        if monitor.name not in names:
            yield GateChange(name, path, monitor.topic, "", weaker=True)
            continue
        now = of_head[names[monitor.name]]
        for field in monitor.__struct_fields__:
            if field not in FREE_MONITOR_FIELDS:
                place = ("monitors", now.name, MONITOR_KEYS.get(field, field))
                yield from Key(name, place).changes(getattr(monitor, field), getattr(now, field))
    for name in of_head:
        if name not in names.values():
            topic = of_head[name].topic
            yield GateChange(f"monitor {name}", ("monitors", name), "", topic, weaker=False)


def _content(monitor: MonitorPlan) -> tuple[Any, ...]:
    fields = [name for name in monitor.__struct_fields__ if name not in FREE_MONITOR_FIELDS]
    return tuple(getattr(monitor, name) for name in fields)


def input_changes(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    """Inputs that are gone, new, or have other messages."""
    before = {each.topic: each for each in base.plan.inputs}
    after = {each.topic: each for each in head.plan.inputs}
    names = input_names(base) | input_names(head)
    for topic in dict.fromkeys((*before, *after)):
        key = f"input {names[topic]}"
        path: Path = ("playback", "inputs", names[topic])
        was, now = before.get(topic), after.get(topic)
        if was is None or now is None:
            before_text, after_text = ("" if each is None else each.source for each in (was, now))
            yield GateChange(key, path, before_text, after_text, weaker=True)
            continue
        yield from _input_fields(was, now, key, path)


def _input_fields(was: InputPlan, now: InputPlan, name: str, path: Path) -> Iterator[GateChange]:
    for field in was.__struct_fields__:
        place: Path = (*path, INPUT_KEYS.get(field, field))
        if field == "later_ns":
            place = ("playback", "timeline", "translations", path[-1])
        yield from Key(name, place).changes(getattr(was, field), getattr(now, field))


def data_changes(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    """Other recordings, or another part of them."""
    before, after = (each.plan.datasets or (each.plan.dataset,) for each in (base, head))
    if len(before) != len(after):
        was_text, now_text = (
            ", ".join(each.source for each in datasets) for datasets in (before, after)
        )
        yield GateChange("data", ("data_loader", "bags"), was_text, now_text, weaker=True)
        return
    for was, now in zip(before, after, strict=True):
        yield from _data_fields(was, now)


def _data_fields(was: DatasetPlan, now: DatasetPlan) -> Iterator[GateChange]:
    for field in was.__struct_fields__:
        text = _window_text if field in {"start_ns", "end_ns"} else value_text
        path = ("data_loader", DATA_KEYS.get(field, field))
        # A digest that was not there before makes no other recording possible.
        order = bool if field == "sha256" and not (was.sha256 and now.sha256) else None
        yield from Key("data", path, order, text).changes(getattr(was, field), getattr(now, field))


def _window_text(end_ns: int | None) -> str:
    return duration_text(end_ns) if end_ns is not None else "the end"


def playback_changes(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    """Messages that are played in another way."""
    was, now = base.plan, head.plan
    yield from _playback_key("mode").changes(was.playback_mode, now.playback_mode)
    yield from _playback_key("buffer").changes(was.buffer, now.buffer)
    unpaired = Key("playback", ("playback", "unpaired"), rank("drop", "refuse"))
    yield from unpaired.changes(was.unpaired, now.unpaired)
    yield from _playback_key("clock").changes(was.clock, now.clock)
    if was.timeline is None or now.timeline is None:
        if was.timeline != now.timeline and was.playback_mode == now.playback_mode:
            yield from _playback_key("timeline").changes(was.timeline, now.timeline)
        return
    for field in was.timeline.__struct_fields__:
        key = _playback_key(*TIMELINE_KEYS.get(field, (field,)))
        yield from key.changes(getattr(was.timeline, field), getattr(now.timeline, field))


def _playback_key(*path: str | int) -> Key:
    return Key("playback", ("playback", *path))


def preprocessor_changes(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    """What prepares the inputs is part of the load, unlike the graph."""
    preparing = _preprocessors(base.plan) | _preprocessors(head.plan)
    for difference in diff_plans(base.plan, head.plan):
        if difference.path[0] == "processes" and str(difference.path[1]) in preparing:
            path = ("preprocessors", str(difference.path[1]).removeprefix("preprocess."))
            yield GateChange("preprocessors", path, *difference_texts(difference), weaker=True)
    was_external, now_external = (
        sorted(each.name for each in side.plan.external if each.phase == "preprocess")
        for side in (base, head)
    )
    yield from Key("preprocessors", ("preprocessors",)).changes(was_external, now_external)


def _preprocessors(plan: Plan) -> set[str]:
    """The names of the processes that prepare the inputs."""
    return {
        each.name for each in plan.processes if each.phase == "preprocess" and each.role != "loader"
    }


_Text = Callable[[Any], str]
_Rule = Callable[[GateSide, GateSide], Iterator[GateChange]]


def _budget(budget_ns: int) -> float:
    """A time budget as a number: none is longer than any."""
    return budget_ns or math.inf


def _budget_text(budget_ns: int) -> str:
    return duration_text(budget_ns) if budget_ns else "none"


def _benchmark_key(name: str, order: Callable[[Any], float], text: _Text, key: str = "") -> Key:
    return Key(name, ("benchmark", *(key or name).split(".")), order, text)


GATE_KEYS: Final[Mapping[str, Key]] = {
    "confidence": _benchmark_key("confidence", less_is_weaker, share_text, "gate.confidence"),
    "inconclusive": _benchmark_key("gate.inconclusive", rank("pass", "report", "fail"), value_text),
    "confirm": _benchmark_key("gate.confirm", rank(True, False), value_text),
    "time_budget_ns": _benchmark_key("gate.time_budget", _budget, _budget_text, "gate.time_budget"),
    "interference": _benchmark_key(
        "gate.interference", rank("tolerate", "note", "strict"), value_text
    ),
}
"""Fields of `GatePlan`, and keys of ``gate`` in a document; others are without an order."""

PLAY_KEYS: Final[Mapping[str, Key]] = {
    "duration_ns": _benchmark_key("duration", less_is_weaker, duration_text),
    "iterations": _benchmark_key("iterations", less_is_weaker, value_text),
    "max_iterations": _benchmark_key("max_iterations", less_is_weaker, value_text),
}
"""Fields of `PlayPlan` other than its rate."""

SEARCH_KEYS: Final[Mapping[str, Key]] = {
    "min_hz": _benchmark_key("search", more_is_weaker, rate_text, "search.min"),
    "max_hz": _benchmark_key("search", less_is_weaker, rate_text, "search.max"),
    "precision": _benchmark_key("search", more_is_weaker, share_text, "search.precision"),
    "probe_ns": _benchmark_key("search", less_is_weaker, duration_text, "search.probe"),
    "confirm_ns": _benchmark_key("search", less_is_weaker, duration_text, "search.confirm"),
    "confidence": _benchmark_key("search", less_is_weaker, share_text, "search.confidence"),
}
"""Fields of `SearchPlan` other than its conditions."""


def plan_changes(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    """Every difference of two plans that a verdict may depend on, in the order of `GATE_FIELDS`."""
    for rule in dict.fromkeys(GATE_FIELDS.values()):
        yield from unique(rule(base, head))
    decided = GATE_FIELDS.keys() | FREE_FIELDS.keys()
    unknown: dict[str, PlanDifference] = {}
    for difference in diff_plans(base.plan, head.plan):
        if difference.path[0] not in decided:
            unknown.setdefault(str(difference.path[0]), difference)
    for name, difference in unknown.items():
        yield GateChange(name, difference.path, *difference_texts(difference), weaker=True)


def _objectives(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    return objective_changes(base, head, monitor_names(base.plan, head.plan))


def _plays(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    before, after = ({each.rate_hz: each for each in side.plan.play} for side in (base, head))
    if before.keys() != after.keys():
        was_text, now_text = (
            ", ".join(map(rate_text, sorted(plays))) or "none" for plays in (before, after)
        )
        weaker = not before.keys() <= after.keys()
        yield GateChange("rates", ("benchmark", "rates"), was_text, now_text, weaker)
    pairs = [(before[rate_hz], after[rate_hz]) for rate_hz in before if rate_hz in after]
    if not pairs:
        pairs = list(zip(base.plan.play[:1], head.plan.play[:1], strict=False))
    was, now = base.plan.play_at_peak, head.plan.play_at_peak
    if was is not None and now is not None:
        pairs.append((was, now))
    elif was != now and base.plan.objectives == head.plan.objectives:
        was_text, now_text = ("at the peak rate" if each is not None else "" for each in (was, now))
        path = ("benchmark", "rates")
        yield GateChange("rates", path, was_text, now_text, weaker=now is None)
    for pair in pairs:
        yield from _play_fields(*pair)


def _play_fields(was: PlayPlan, now: PlayPlan) -> Iterator[GateChange]:
    for field in was.__struct_fields__:
        before, after = getattr(was, field), getattr(now, field)
        if field == "rate_hz":
            continue
        if field == "max_iterations":
            if before == after == 0:
                continue  # as many as `iterations`, which are compared as such
            before, after = (max(each.iterations, each.max_iterations) for each in (was, now))
        key = PLAY_KEYS.get(field, Key(field, ("benchmark", field)))
        yield from key.changes(before, after)


def _starts(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    if all(_has_default_starts(side.plan) for side in (base, head)):
        return  # they follow from the iterations, which are compared as such
    key = _benchmark_key("starts", less_is_weaker, value_text)
    yield from key.changes(base.plan.starts, head.plan.starts)


def _has_default_starts(plan: Plan) -> bool:
    plays = (*plan.play, *((plan.play_at_peak,) if plan.play_at_peak else ()))
    return any(plan.starts == default_starts(each.iterations) for each in plays)


def _search(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    was, now = base.plan.search, head.plan.search
    if was is None or now is None:
        if was != now:
            was_text, now_text = (
                "" if each is None else f"up to {rate_text(each.max_hz)}" for each in (was, now)
            )
            path = ("benchmark", "search")
            yield GateChange("search", path, was_text, now_text, weaker=now is None)
        return
    for field in was.__struct_fields__:
        if field == "holds":
            yield from _conditions(base, head)
            continue
        key = SEARCH_KEYS.get(field, Key("search", ("benchmark", "search", field)))
        yield from key.changes(getattr(was, field), getattr(now, field))


def _conditions(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    """Conditions of a probe that one side has, and the other does not imply."""
    names = monitor_names(base.plan, head.plan)
    was = _located(base, names)
    now = _located(head, {each.name: each.name for each in head.plan.monitors})
    for before, after, weaker in ((was, now, True), (now, was, False)):
        for condition, subject in before:
            same = [each for each, other in after if other == subject]
            if not any(implies(each, condition) for each in same):
                own, other_text = condition.text, same[0].text if same else ""
                texts = (own, other_text) if weaker else (other_text, own)
                path = ("benchmark", "search", "holds")
                yield GateChange("search", path, *texts, weaker=weaker)


def _located(
    side: GateSide, monitors: Mapping[str, str]
) -> list[tuple[Requirement, tuple[str, str]]]:
    """The conditions of the search, each with the monitors that it is about."""
    conditions = side.plan.search.holds if side.plan.search is not None else ()
    return [(each, subject) for each in conditions for subject in subjects(each, side, monitors)]


def _gate(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    yield from _gate_fields(base.plan.gate, head.plan.gate)
    # Keys of the document that no plan has.
    specs = [spec_of(side) for side in (base, head)]
    if specs[0] is not None and specs[1] is not None:
        was, now = (each.benchmark.gate for each in specs if each is not None)
        for field in was.__struct_fields__:
            if not {field, f"{field}_ns"} & set(GatePlan.__struct_fields__):
                yield from _gate_key(field).changes(getattr(was, field), getattr(now, field))


def _gate_fields(was: GatePlan, now: GatePlan) -> Iterator[GateChange]:
    for field in was.__struct_fields__:
        yield from _gate_key(field).changes(getattr(was, field), getattr(now, field))


def _gate_key(field: str) -> Key:
    return GATE_KEYS.get(field, Key(f"gate.{field}", ("benchmark", "gate", field)))


def _timing(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    for name in ("warm_up", "start_timeout", "drain_timeout"):
        key = _benchmark_key(name, more_is_weaker, duration_text)
        yield from key.changes(*(getattr(side.plan, f"{name}_ns") for side in (base, head)))


def _transport(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    key = Key("transport", ("transport",))
    yield from key.changes(base.plan.transport, head.plan.transport)
    segment = Key("transport", ("transport", "segment"), None, _segment_text)
    yield from segment.changes(base.plan.segment_bytes, head.plan.segment_bytes)


def _segment_text(segment_bytes: int) -> str:
    return size_text(segment_bytes) if segment_bytes else "the default"


def _harness(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    was, now = base.plan.harness, head.plan.harness
    for field in was.__struct_fields__:
        key = Key("harness", ("harness", field))
        yield from key.changes(getattr(was, field), getattr(now, field))


def _requires(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    yield from Key("requires", ("requires",)).changes(base.plan.requires, head.plan.requires)


def _processes(base: GateSide, head: GateSide) -> Iterator[GateChange]:
    """The graph is free to change, but neither its memory limits nor what prepares its inputs."""
    yield from _memory_limits(base.plan, head.plan)
    yield from preprocessor_changes(base, head)


def _memory_limits(base: Plan, head: Plan) -> Iterator[GateChange]:
    """Limits of resident memory; a process that has no limit has an infinite one."""
    limits = [
        {each.name: each.memory_limit_bytes for each in plan.processes if each.phase == "measure"}
        for plan in (base, head)
    ]
    for name in dict.fromkeys((*limits[0], *limits[1])):
        was, now = (each.get(name, 0) or math.inf for each in limits)
        if was != now:
            was_text, now_text = (
                size_text(int(each)) if each < math.inf else "" for each in (was, now)
            )
            path = ("graph", "nodes", name, "memory_limit")
            yield GateChange(f"memory_limit {name}", path, was_text, now_text, weaker=now > was)


GATE_FIELDS: Final[Mapping[str, _Rule]] = {
    "objectives": _objectives,
    "monitors": monitor_changes,
    "inputs": input_changes,
    "dataset": data_changes,
    "datasets": data_changes,
    "playback_mode": playback_changes,
    "buffer": playback_changes,
    "unpaired": playback_changes,
    "timeline": playback_changes,
    "clock": playback_changes,
    "play": _plays,
    "play_at_peak": _plays,
    "starts": _starts,
    "search": _search,
    "warm_up": _timing,
    "start_timeout": _timing,
    "drain_timeout": _timing,
    "gate": _gate,
    "transport": _transport,
    "segment_bytes": _transport,
    "harness": _harness,
    "requires": _requires,
    "processes": _processes,
    "external": _processes,
}
"""The fields of a plan that a verdict depends on, with the rule that compares each."""

FREE_FIELDS: Final[Mapping[str, str]] = {
    "r2bspec_plan": "the version of the format",
    "generator": "the version of the compiler",
    "name": "a text; specs are matched by path or name",
    "title": "a text",
    "description": "a text",
    "labels": "texts; they select specs",
    "namespace": "of the graph; the topics of inputs and monitors are compared",
    "environment": "of the graph",
    "topics": "of the graph",
    "setup": "of the graph",
    "ready": "of the graph",
    "after_ready": "of the graph",
    "largest_message_bytes": "follows from the data",
    "phases": "follows from the other fields",
    "sustained_hz": "follows from the objectives",
}
"""The fields of a plan that may change, and why."""
