"""What a first spec plays and measures, from nodes and a recording.

Which topics the graph reads and answers follows from its wiring, as far as that is known. What is
not known is said, and nothing is guessed; `draft_text` writes the spec.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from dataclasses import replace as replace_value
from pathlib import Path

from msgspec.structs import replace

from r2bspec.authoring.input_roles import input_keys, latched_inputs, lead_of
from r2bspec.bags.recorded_times import TopicTimes, read_times
from r2bspec.bags.recording import BagIndex, TimeWindow, TopicInfo
from r2bspec.interop.spec_text import Block, document, identifier, unique_name
from r2bspec.language.load_spec import load_spec
from r2bspec.language.names import MESSAGE_TYPE, TOPIC
from r2bspec.plan.installed_packages import installed_fields
from r2bspec.plan.wiring.build_wiring import build_wiring
from r2bspec.plan.wiring.companion_files import read_companion_files
from r2bspec.plan.wiring.wiring import PhaseWiring

_COMMON = frozenset({"/rosout", "/parameter_events", "/tf", "/tf_static", "/clock"})
TRANSFORMS = {"/tf": "publish_tf", "/tf_static": "publish_tf_static"}
"""The keys with which recorded transforms are published."""
LONGEST_WINDOW_NS = 10_000_000_000
_MOST_MONITORS = 10
_MOST_FIELDS = 8
_ENOUGH_FOR_RATE = 10
"""With so many messages in the window, their rate is that of the input."""
_OFFERED = r"^(?!lifecycle_msgs/)\w+/(srv|action)/\w+$"
"""Types of services and actions that are a node's own."""


@dataclass(slots=True)
class DraftNodes:
    """The nodes and containers of a spec, and what the sources do not tell.

    Attributes:
        nodes: entries of ``graph.nodes``.
        containers: entries of ``containers``.
        variables: variables that the nodes refer to, with their values.
        environment: environment variables that the nodes refer to.
        topics: absolute names of topics that the nodes are remapped to.
        unknown: what nothing says, one line each.
        is_absolute: whether the nodes have absolute namespaces, as launch files and running
            systems do; the namespace of the benchmark is then the root.
    """

    nodes: Block = field(default_factory=Block)
    containers: Block = field(default_factory=Block)
    variables: dict[str, object] = field(default_factory=dict)
    environment: list[str] = field(default_factory=list)
    topics: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    is_absolute: bool = False

    @property
    def keys(self) -> set[str]:
        """The names of nodes and containers so far."""
        return {entry.key for entry in (*self.nodes.entries, *self.containers.entries)}


@dataclass(frozen=True, slots=True)
class DraftRecording:
    """A recording for a first spec.

    Attributes:
        written: how the spec names it.
        index: the index of the recording, or of its larger part if it has a gap.
        window: that part; None without a gap.
        path: where it is; None for a dataset that is not made yet.
        needed_ns: the window has what was recorded so long after the beginning of the index.
    """

    written: str
    index: BagIndex
    window: TimeWindow | None = None
    path: Path | None = None
    needed_ns: int = 0

    @property
    def used(self) -> TimeWindow:
        """The part that a spec uses."""
        start_ns = self.window.start_ns if self.window else 0
        last_ns = self.index.duration_ns - LONGEST_WINDOW_NS
        if last_ns > 0:
            if self.needed_ns >= last_ns:
                end_ns = self.window.end_ns if self.window else None
                return TimeWindow(start_ns=start_ns + last_ns, end_ns=end_ns)
            if self.needed_ns >= LONGEST_WINDOW_NS:
                start_ns += self.needed_ns
            return TimeWindow(start_ns=start_ns, end_ns=start_ns + LONGEST_WINDOW_NS)
        return self.window or TimeWindow()

    def times(self, topics: Mapping[str, TopicInfo]) -> dict[str, TopicTimes]:
        """Return the times of the used messages, by the names of the inputs."""
        if self.path is None:
            return {}
        names = {info.name for info in topics.values()}
        # The index of one part has its own beginning; windows are of the whole recording.
        times = read_times(self.path, self.index, names, self.used) or {}
        return {name: times[info.name] for name, info in topics.items() if info.name in times}


@dataclass(slots=True)
class Draft:
    """A spec in the making, of what sources tell.

    Attributes:
        name: the name of the benchmark.
        nodes: the nodes; without any, a relay takes their place if there is a recording.
        recording: the recording; None for a graph with a source of its own.
        base_dir: the folder of the spec.
        namespace: the namespace of the benchmark, absolute and without a slash at its end.
        inputs: topics of the graph that are played, with the recorded topic of each.
        outputs: topics to monitor, with their types.
        lead: the input that makes the steps; empty without inputs.
        keys: of each input, how it is played.
        transforms: recorded topics of transforms that are published.
        calls: entries of ``playback.calls``: the services and actions of nodes without outputs.
        measured: what is known of the nodes.
        lacks_topics: whether the nodes may have topics, or have outputs, that are not known.
    """

    name: str
    nodes: DraftNodes
    recording: DraftRecording | None
    base_dir: Path
    inputs: dict[str, TopicInfo] = field(default_factory=dict)
    lead: str = ""
    keys: dict[str, dict[str, object]] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    transforms: list[str] = field(default_factory=list)
    calls: Block = field(default_factory=Block)
    unknown: list[str] = field(default_factory=list)
    lacks_topics: bool = False
    namespace: str = field(init=False)
    measured: PhaseWiring = field(init=False)

    def __post_init__(self) -> None:
        """Find out what the nodes and the recording tell of inputs and outputs."""
        self.unknown += self.nodes.unknown
        self.namespace = "" if self.nodes.is_absolute else "/r2b"
        if not self.nodes.nodes:
            self._add_placeholder()
        self.measured = self._wiring()
        self.unknown += self._doubts()
        interfaces = [node.interface for node in self.measured.nodes]
        self.lacks_topics = any(
            interface.may_subscribe_more or interface.may_publish_more for interface in interfaces
        )
        if self.recording is not None:
            self._select_inputs()
            self._select_lead()
        self._select_transforms()
        self._select_outputs()
        if self.recording is not None and not self.inputs:
            unused = self.recording.written
            self.unknown.append(f"what {unused} is for: no node reads a topic of it")
            self.recording, self.transforms = None, []
        self._add_missing_source()

    def _add_placeholder(self) -> None:
        """Without nodes, a relay of the largest topic shows the recording in use."""
        entry = Block.of({"python": "r2bspec.nodes.RelayNode"})
        topics = [each for each in _data_topics(self.recording) if each.type]
        if topics:
            main = max(topics, key=lambda each: (each.max_message_bytes or 0, each.count))
            entry.add("parameters", {"format": main.type})
            entry.add("remappings", {"input": main.name.lstrip("/"), "output": "relayed"})
        above = ["A node that copies its input, in place of yours: see 'r2bspec init --list'."]
        self.nodes.nodes.add("relay", entry, above)
        self.unknown.append("the node under test: 'relay' takes its place")

    def _add_missing_source(self) -> None:
        """What nodes subscribe to and nothing publishes has to come from outside."""
        needs = self._open_subscriptions()
        missing = {
            topic: kind for topic, kind in needs.items() if kind and topic not in self.inputs
        }
        if not missing or self.measured.possible_publishers:
            return
        entry = Block.of({"external": True, "publishes": Block.of(dict(sorted(missing.items())))})
        above = [
            "What publishes these topics must already run. A recording of them replaces it:",
            "'r2bspec init --from-bag BAG' with the same sources.",
        ]
        self.nodes.nodes.add(unique_name("source", self.nodes.keys), entry, above)
        self.unknown.append(f"the publishers of {', '.join(sorted(missing))}")

    def _wiring(self) -> PhaseWiring:
        """Return what is known of the nodes, from a spec that has nothing else."""
        top = self.head()
        top.add("containers", self.nodes.containers)
        top.add("playback", {"mode": "live"})
        top.add("graph", Block.of({"nodes": self.nodes.nodes}))
        top.add("monitors", {"any": {"topic": "/rosout", "format": "rcl_interfaces/msg/Log"}})
        loaded = load_spec(document(top, []), file=str(self.base_dir / f"{self.name}.r2b.yaml"))
        if loaded.spec is None:
            return PhaseWiring("measure", (), ())
        files = read_companion_files(loaded.spec, self.base_dir)
        return build_wiring(loaded.spec, companion_files=files).measure

    def _doubts(self) -> list[str]:
        """Return why nodes may have more topics or other profiles than are known, a line each."""
        unread = [
            f"which quality of service {node.key} requests of {topic}: line {line} says it in a "
            "way that is not read"
            for node in self.measured.nodes
            for topic, line in node.interface.unread_qos.items()
        ]
        return unread + [
            f"whether {node.key} {does} other topics: {why}"
            for node in self.measured.nodes
            for does, why in (
                ("subscribes to", node.interface.may_subscribe_more),
                ("publishes", node.interface.may_publish_more),
            )
            if why
        ]

    def _select_inputs(self) -> None:
        playable = _data_topics(self.recording)
        recorded = {f"/{each.name.lstrip('/')}": each for each in playable}
        needs = self._open_subscriptions()
        for topic, kind in needs.items():
            match = recorded.get(topic) or recorded.get(topic.removeprefix(self.namespace))
            if match is not None and kind and not match.type:
                match = replace(match, type=kind)
                self.unknown.append(f"whether {match.name} is {kind}: the recording names no type")
            if match is not None and match.type and kind in {"", match.type}:
                self.inputs[topic] = match
        for topic, kind in needs.items():
            if topic not in self.inputs:
                self._match_by_type(topic, kind, [each for each in playable if each.type])
        recorded = {topic: each for topic, each in recorded.items() if each.type}
        uncertain = bool(self.measured.possible_subscribers)
        if uncertain:
            named = {topic: recorded[topic] for topic in self.nodes.topics if topic in recorded}
            produced = self._topics(is_publisher=True).keys() | self.inputs.keys()
            more = {topic: info for topic, info in named.items() if topic not in produced}
            self.inputs |= more
            if more:
                shown = ", ".join(more)
                self.unknown.append(
                    f"whether the nodes read or write {shown}: they are inputs here, because the "
                    "recording has them"
                )
        if not self.inputs and recorded and (uncertain or not self._offered()):
            self.inputs = {f"{self.namespace}{name}": each for name, each in recorded.items()}
            self.unknown.append(
                "which topics the nodes subscribe to: all of the recording are inputs; remove "
                "those that the graph publishes itself"
            )

    def _select_lead(self) -> None:
        answered = {
            endpoint.topic
            for node in self.measured.nodes
            for endpoint in self.measured.endpoints_of(node.name)
            if endpoint.own_name in node.interface.publishing and not endpoint.is_publisher
        }
        if not self.inputs or self.recording is None:
            return
        latched = [self.inputs[topic].first_ns or 0 for topic in latched_inputs(self.inputs)]
        needed_ns = max(latched, default=0) - self.recording.index.start_ns
        self.recording = replace_value(self.recording, needed_ns=needed_ns)
        times = self.recording.times(self.inputs)
        for topic, each in times.items():
            if len(each.recorded_ns) >= _ENOUGH_FOR_RATE:
                self.inputs[topic] = replace(self.inputs[topic], rate_hz=each.rate_hz)
        self.lead = lead_of(self.inputs, answered)
        self.keys = input_keys(self.inputs, times, self.lead)
        others = [topic for topic, keys in self.keys.items() if keys.get("rate") == "recorded"]
        if others and self.lead not in answered:
            self.unknown.append(
                f"which input the outputs answer: {self.lead} makes the steps here, and "
                f"{' and '.join(others)} are played between them"
            )

    def _match_by_type(self, topic: str, kind: str, recorded: list[TopicInfo]) -> None:
        """Take the recorded topic of this type whose name has most words of a subscription.

        Of several, it is that whose name is most like those taken before, as of the same camera.
        """
        used = {input_.name for input_ in self.inputs.values()}
        taken = {word for name in used for word in _words(name)}
        words = _words(topic.removeprefix(self.namespace))
        same = [each for each in recorded if each.type == kind and each.name not in used]
        common = [len(words & _words(candidate.name)) for candidate in same]
        most = max(common, default=0)
        close = [each for each, number in zip(same, common, strict=True) if number == most]
        close.sort(key=lambda candidate: -len(taken & _words(candidate.name)))
        if not close:
            has = [
                f"{each.name} as {each.serialization}, which cannot be played"
                for each in (self.recording.index.topics.values() if self.recording else ())
                if each.type == kind and each.serialization != "cdr"
            ]
            what = f"has {' and '.join(has)}" if has else f"has no {kind or 'such topic'}"
            self.unknown.append(f"what {topic} gets: the recording {what}")
            return
        self.inputs[topic] = close[0]
        if len(close) > 1:
            others = ", ".join(candidate.name for candidate in close[1:5])
            self.unknown.append(f"whether {topic} is {close[0].name}; as well possible: {others}")

    def _open_subscriptions(self) -> dict[str, str]:
        """Topics that nodes subscribe to and no node publishes, with their types."""
        published = self._topics(is_publisher=True)
        subscribed = self._topics(is_publisher=False)
        return {topic: kind for topic, kind in subscribed.items() if topic not in published}

    def _select_transforms(self) -> None:
        """Publish the recorded transforms that nodes read and no node publishes."""
        endpoints = [each for each in self.measured.endpoints if each.is_node]
        published = {endpoint.topic for endpoint in endpoints if endpoint.is_publisher}
        needed = TRANSFORMS.keys() & {endpoint.topic for endpoint in endpoints} - published
        recorded = self.recording.index.topics.values() if self.recording else ()
        there = {f"/{topic.name.lstrip('/')}" for topic in recorded if topic.count}
        self.transforms = sorted(needed & there)
        if needed and not needed & there:
            self.unknown.append(
                f"what publishes {' and '.join(sorted(needed))}, which a node reads"
            )
        possible = sorted(TRANSFORMS.keys() & there - needed - published)
        if possible and self.measured.possible_subscribers:
            keys = " and ".join(f"'{TRANSFORMS[topic]}: true'" for topic in possible)
            self.unknown.append(f"whether the nodes need the recorded transforms: {keys}")

    def _topics(self, *, is_publisher: bool) -> dict[str, str]:
        """Return the topics that nodes publish, or to which they subscribe, with their types."""
        return {
            endpoint.topic: endpoint.type
            for endpoint in self.measured.endpoints
            if endpoint.is_node
            and endpoint.is_publisher is is_publisher
            and endpoint.topic not in _COMMON
        }

    def _select_outputs(self) -> None:
        published = {
            topic: kind
            for topic, kind in self._topics(is_publisher=True).items()
            if kind and topic not in self.inputs
        }
        last = {
            topic: kind
            for topic, kind in published.items()
            if not any(reader.is_node for reader in self.measured.subscriptions(topic))
        }
        self.outputs = dict(list((last or published).items())[:_MOST_MONITORS])
        left_out = len(last or published) - len(self.outputs)
        if left_out > 0:
            self.unknown.append(f"{left_out} more topics are published and not monitored here")
        if not self.outputs:
            self._select_calls()
        if not self.outputs and not self.calls:
            self.outputs = {"/rosout": "rcl_interfaces/msg/Log"}
            self.lacks_topics = True
            self.unknown.append(
                "what the nodes publish: the monitor is on /rosout until you name an output; "
                "'r2bspec interfaces' finds out what nodes publish. Of services and actions, the "
                "answers are measured: 'playback.calls' instead of inputs and monitors"
            )

    def _offered(self) -> dict[str, str]:
        """Return the services and actions of the nodes, with their types if known."""
        return {
            node.names.resolve(name).name: kind
            for node in self.measured.nodes
            for name, kind in node.interface.services.items()
            if re.search(TOPIC.pattern, name) and re.search(_OFFERED, kind)
        }

    def _select_calls(self) -> None:
        names: set[str] = set()
        for offered, kind in list(self._offered().items())[:_MOST_MONITORS]:
            key, end = ("action", "_Goal") if "/action/" in kind else ("service", "_Request")
            named = self.own_name(offered)
            fields = list((installed_fields(f"{kind}{end}") or {}).items())
            shown = ", ".join(f"{name} ({type_name})" for name, type_name in fields[:_MOST_FIELDS])
            shown += ", ..." if len(fields) > _MOST_FIELDS else ""
            what = "goal" if key == "action" else "request"
            above = [
                f"'{what}: {{FIELD: VALUE}}' sets fields other than to their defaults: {shown}"
            ]
            called = Block.of({key: {"name": named, "type": kind}})
            self.calls.add(unique_name(identifier(named), names), called, above if shown else [])

    def head(self) -> Block:
        """Return the first keys of the spec."""
        top = Block.of({"r2bspec": 1, "name": self.name})
        if self.nodes.is_absolute:
            top.add(
                "namespace", "/", ["Names of topics and nodes are those of the running system."]
            )
        top.add("environment", self.nodes.environment)
        top.add("variables", Block.of(self.nodes.variables))
        return top

    def own_name(self, topic: str) -> str:
        """Return a topic as the spec writes it: relative where that is the same."""
        inside = f"{self.namespace}/"
        return topic.removeprefix(inside) if topic.startswith(inside) else topic


def _data_topics(recording: DraftRecording | None) -> list[TopicInfo]:
    return [
        each
        for name, each in (recording.index.topics.items() if recording else ())
        if f"/{name.lstrip('/')}" not in _COMMON
        and each.count
        and each.serialization == "cdr"
        and (not each.type or re.search(MESSAGE_TYPE.pattern, each.type))
        and re.search(TOPIC.pattern, each.name)
    ]


def _words(topic: str) -> set[str]:
    """Return the words of a topic's name: of ``left/image_rect`` left, image and rect."""
    return set(re.split(r"[/_]", topic.lower())) - {""}
