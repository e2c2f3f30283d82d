"""The load on a graph and what is observed of it, key by key.

Inputs, data, preprocessors and playback decide how hard the graph has to work, monitors what is
seen of it. No change of them is known to be harmless, so each counts as a weaker gate, except that
a monitor may be added or get another name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from r2bspec.compare.gate_change import (
    GateChange,
    GateSide,
    Key,
    difference_texts,
    duration_text,
    rank,
    spec_of,
    value_text,
)
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.plan.comparability import diff_plans
from r2bspec.plan.plan import DatasetPlan, InputPlan, MonitorPlan, Plan

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
