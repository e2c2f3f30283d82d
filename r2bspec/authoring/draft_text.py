"""The text of a first spec: what a draft knows as keys, and what it does not as comments."""

from __future__ import annotations

import math

from r2bspec.authoring.draft_spec import LONGEST_WINDOW_NS, TRANSFORMS, Draft, DraftRecording
from r2bspec.authoring.input_roles import input_qos
from r2bspec.bags.message_types import begins_with_header
from r2bspec.bags.offered_qos import offered_profile
from r2bspec.bags.recording import TimeWindow, TopicInfo
from r2bspec.diagnostics.quote import pluralize
from r2bspec.interop.spec_text import Block, document, identifier, unique_name
from r2bspec.judge.statistics.rule_of_three import min_sample_size
from r2bspec.language.benchmark_defaults import default_starts
from r2bspec.language.quantities import Duration
from r2bspec.plan.interim_looks import InterimLooks

_ITERATIONS = 10
_SHORTEST_ITERATION_S = 2.5
_LONGEST_ITERATION_S = 10.0
_LOST_PERCENT = (1, 5, 10)
"""Shares of lost messages that are proposed: the first that the messages of a run can confirm."""
_LOADED = "recorded"


def draft_text(draft: Draft, sources: list[str]) -> str:
    """Return the spec, with comments about the unknown parts.

    Args:
        draft: what is known.
        sources: what it was made from, for the comment at its head.
    """
    top = draft.head()
    if draft.recording is not None:
        top.add("data_loader", _data_loader(draft, draft.recording))
    top.add("containers", draft.nodes.containers)
    top.add("playback", _playback(draft))
    top.add("graph", Block.of({"nodes": draft.nodes.nodes}))
    names: set[str] = set()
    monitors = Block()
    for topic, kind in draft.outputs.items():
        entry = Block.of({"topic": draft.own_name(topic), "format": kind})
        if begins_with_header(kind) is False:
            entry.add("match", "order", after="its messages have no header")
        name = unique_name(identifier(draft.own_name(topic).strip("/~")), names)
        monitors.add(name if name[0].isalpha() else f"m{name}", entry)
    top.add("monitors", monitors)
    top.add("benchmark", _benchmark(draft))
    top.add("slos", _objectives(draft, [monitor.key for monitor in monitors.entries]))
    if draft.recording is not None and draft.outputs:
        top.below.append(
            "After a run, 'r2bspec judge RUN --suggest SPEC' proposes limits for latency."
        )
    head = [f"Written by 'r2bspec init' from {', '.join(sources)}."]
    if draft.unknown:
        head += [
            "",
            "Not known:",
            *(f"- {sentence}" for sentence in dict.fromkeys(draft.unknown)),
        ]
    return document(top, head)


def _data_loader(draft: Draft, recording: DraftRecording) -> Block:
    block = Block.of({"bag": recording.written})
    seconds = recording.index.duration_ns / 1e9
    above = ["Most of the recording lies on this side of a gap."] if recording.window else []
    used = recording.used
    if used.end_ns is not None and recording.index.duration_ns > LONGEST_WINDOW_NS:
        above += [f"The recording has {seconds:.1f} s; messages of the window are in memory."]
    if used != TimeWindow():
        end_of = {} if used.end_ns is None else {"end": str(Duration(used.end_ns))}
        block.add("window", {"start": str(Duration(used.start_ns)), **end_of}, above)
    topics = Block()
    for info in dict.fromkeys(draft.inputs.values()):
        topics.add(f"/{info.name.lstrip('/')}", _loaded(info), after=_described(info))
    loaded = {input_.name for input_ in draft.inputs.values()}
    loaded |= {name for topic in draft.transforms for name in (topic, topic.lstrip("/"))}
    others = [topic for topic in recording.index.topics.values() if topic.name not in loaded]
    above = ["Also recorded:", *(f"  {other.name} ({other.type_text})" for other in others)]
    block.add("topics", topics, above if others else [])
    for topic in draft.transforms:
        block.add(TRANSFORMS[topic], True, after="a node reads them")
    return block


def _playback(draft: Draft) -> Block:
    block = Block.of({"calls": draft.calls})
    if draft.calls and not draft.inputs:
        return block
    if draft.recording is None:
        above = ["Without a recording, the graph has a source of its own (or use --from-bag)."]
        block.add("mode", "live", above)
    elif _uses_clock(draft):
        block.add("clock", True, after="a node has 'use_sim_time: true'")
    inputs = Block()
    for topic, recorded in draft.inputs.items():
        entry = {"from": _loaded(recorded), "format": recorded.type}
        keys = draft.keys[topic]
        # What is published once is reliable and transient local in any case.
        profile = {} if keys.get("rate") == "once" else _profile(draft, topic, recorded)
        inputs.add(
            draft.own_name(topic), {**entry, **({"qos": profile} if profile else {}), **keys}
        )
    block.add("inputs", inputs)
    return block


def _uses_clock(draft: Draft) -> bool:
    """Return True if a node waits for /clock, which no node publishes."""
    nodes = draft.measured.nodes
    is_set = any(node.parameters.get("use_sim_time") is True for node in nodes)
    return is_set and not draft.measured.publishers("/clock")


def _profile(draft: Draft, topic: str, recorded: TopicInfo) -> dict[str, object]:
    """Return what of the quality of service of an input is no default."""
    asked = [end.qos for end in draft.measured.subscriptions(topic) if end.qos is not None]
    offered = offered_profile(recorded.qos)
    written = input_qos(offered, asked)
    if offered is not None and offered.reliability != written.get("reliability", "reliable"):
        draft.unknown.append(
            f"why {topic} was recorded as {offered.reliability}: a node requests it reliable"
        )
    return written


def _rate_hz(draft: Draft) -> float:
    rate_hz = draft.inputs[draft.lead].rate_hz if draft.lead else 0.0
    return float(f"{rate_hz:.3g}") if rate_hz > 0 else 10.0


def _effort(draft: Draft) -> tuple[float, int]:
    """The seconds of an iteration, and the lost messages in percent that a run can confirm."""
    rate_hz = _rate_hz(draft)
    seconds = _SHORTEST_ITERATION_S
    looks = InterimLooks.planned(_ITERATIONS, default_starts(_ITERATIONS))
    confidence = looks.confidence_at(len(looks))
    for percent in _LOST_PERCENT:
        needed = min_sample_size(percent / 100, confidence) or 1
        # Whole messages in each iteration, in steps of half a second.
        in_each = math.ceil(needed / _ITERATIONS)
        seconds = max(_SHORTEST_ITERATION_S, math.ceil(2 * in_each / rate_hz) / 2)
        if seconds <= _LONGEST_ITERATION_S:
            return seconds, percent
    return seconds, _LOST_PERCENT[-1]


def _benchmark(draft: Draft) -> Block:
    block = Block()
    has_rate = draft.recording is not None or bool(draft.calls)
    seconds, percent = _effort(draft) if has_rate else (_SHORTEST_ITERATION_S, 0)
    is_long = seconds > _SHORTEST_ITERATION_S
    above = [f"Long enough to confirm that at most {percent} % are lost."] if is_long else []
    block.add("duration", f"{seconds:g} s", above)
    block.add("iterations", _ITERATIONS)
    if has_rate:
        of_calls = "How often it is called, whether or not earlier calls are answered."
        above = ["The rate of the recording." if draft.inputs else of_calls]
        block.add("rates", [f"{_rate_hz(draft):g} Hz"], above)
    return block


def _objectives(draft: Draft, monitors: list[str]) -> Block | None:
    _, percent = _effort(draft)
    has_load = draft.recording is not None or draft.calls
    if not has_load or "/rosout" in draft.outputs:
        return None
    rate = f"{_rate_hz(draft):g} Hz"
    # Of several outputs the first: the others may not answer each input.
    calls = [entry.key for entry in draft.calls.entries]
    named = calls or (monitors[:1] if len(monitors) > 1 else [])
    required = f"drop_rate <= {percent} %"
    requirements = [f"{prefix}{required}" for prefix in [f"{name}." for name in named] or [""]]
    objective = Block.of({"at": rate})
    above = []
    if not calls:
        above = ["'r2bspec gate' also judges: work.graph.p50 <= 105 % of baseline"]
    objective.add("require", requirements, above)
    return Block.of({"keeps_up": objective})


def _loaded(topic: TopicInfo) -> str:
    return f"{_LOADED}/{topic.name.lstrip('/')}"


def _described(topic: TopicInfo) -> str:
    size = topic.max_message_bytes
    shown = f", at most {size:,} bytes" if size else ""
    rate = f"{topic.rate_hz:.4g} Hz, " if topic.rate_hz else ""
    return f"{rate}{pluralize(topic.count, 'message')}{shown}"
