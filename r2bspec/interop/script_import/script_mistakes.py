"""Mistakes in scripts of ros2_benchmark that its runs do not show, and what they do to a result.

Each check is a method that yields findings: what is wrong, at its place in the script. The help of
a finding is what the page of its code says that it does to the figures. A check says nothing where
the script does not determine the answer.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator
from typing import Final

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.interop.script_import.benchmark_script import BenchmarkScript, Settings
from r2bspec.interop.script_import.launch_actions import topic_in
from r2bspec.interop.script_import.launch_parts import NodeAction, Remapping
from r2bspec.interop.script_import.node_roles import HARNESS_PACKAGES, divide_by_role, played_inputs
from r2bspec.interop.script_import.values import PlacedDict
from r2bspec.plan.wiring.node_interface import catalogue_nodes

_WORDS: Final = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
_ABSOLUTE_NAMES: Final = frozenset({"/tf", "/tf_static", "/clock", "/rosout", "/parameter_events"})


def find_mistakes(script: BenchmarkScript) -> list[Diagnostic]:
    """The mistakes of a script, sorted by place."""
    return sorted(dict.fromkeys(_Mistakes(script).all()), key=lambda finding: finding.sort_key)


class _Mistakes:
    def __init__(self, script: BenchmarkScript) -> None:
        self.script = script
        self.config = script.config
        self.settings = Settings(script, [])
        self.mode = self.settings.mode if self.settings.is_mode_known else ""
        self.graph = divide_by_role(script.parts, script.docstring, self.settings.namespace)
        self.inputs = played_inputs(self.graph.player)

    def all(self) -> Iterator[Diagnostic]:
        yield from self.crossed_sides()
        yield from self.names_used_twice()
        yield from self.remappings_without_effect()
        yield from self.unknown_parameters()
        yield from self.number_of_formats()
        yield from self.sleeps()
        if self.script.clients and self.graph.player is None:
            # It calls and measures by itself, and uses no monitor and no search of the tool.
            return
        yield from self.monitors_without_results()
        yield from self.shared_prefixes()
        yield from self.buffers_without_source()
        yield from self.monitored_inputs()
        yield from self.one_message()
        yield from self.latency_of_two_messages()
        yield from self.tolerant_search()
        yield from self.counted_transforms()

    def crossed_sides(self) -> Iterator[Diagnostic]:
        for member in self.script.parts.members:
            for remapping in member.remappings:
                owner = remapping.node or (member.name if isinstance(member, NodeAction) else "")
                side = _side(remapping.source) or _side(owner)
                if side and _side(remapping.target) not in {"", side}:
                    yield _finding(
                        "R2B720",
                        f"{owner!r} gets {remapping.target!r} as its {side} {remapping.source!r}",
                        remapping.place,
                    )
        for input_ in self.inputs:
            side = _side(input_.source)
            if side and _side(input_.topic) not in {"", side}:
                yield _finding(
                    "R2B720",
                    f"the {side} buffer {input_.source!r} is played on {input_.topic!r}",
                    input_.player.source.place_of("remappings"),
                )

    def names_used_twice(self) -> Iterator[Diagnostic]:
        seen: dict[tuple[str, str], NodeAction] = {}
        for node in self.script.parts.nodes:
            key = (node.namespace, node.name)
            if key in seen:
                yield _finding(
                    "R2B721",
                    f"two nodes are named {node.namespace}/{node.name}; the other one is in line "
                    f"{seen[key].source.place.line}",
                    node.source.place_of("name"),
                )
            seen.setdefault(key, node)

    def remappings_without_effect(self) -> Iterator[Diagnostic]:
        for node in self.script.parts.nodes:
            for remapping in node.remappings:
                text = self._without_effect(node, remapping)
                if text:
                    is_identity = remapping.source == remapping.target
                    yield _finding(
                        "R2B722",
                        text,
                        remapping.place,
                        Severity.INFO if is_identity else None,
                    )

    @staticmethod
    def _without_effect(node: NodeAction, remapping: Remapping) -> str:
        source, namespace = remapping.source, node.namespace.rstrip("/")
        is_outside = source.startswith("/") and not source.startswith(f"{namespace}/")
        if is_outside and node.namespace and source not in _ABSOLUTE_NAMES:
            is_listed = node.package in HARNESS_PACKAGES or catalogue_nodes(node.package)
            when = "cannot match" if is_listed else "matches only if its code has the absolute name"
            return (
                f"the remapping of {source!r} of {node.name!r} {when}: in the namespace "
                f"{node.namespace}, a relative topic of that name is {namespace}{source}"
            )
        if source == remapping.target:
            return f"{source!r} of {node.name!r} is remapped to itself"
        return ""

    def unknown_parameters(self) -> Iterator[Diagnostic]:
        for node in self.script.parts.nodes:
            listed = catalogue_nodes(node.package).get(node.plugin)
            if listed is None or listed.parameters is None:
                continue
            default = node.source.place_of("parameters")
            for source in node.parameters:
                places = source.places if isinstance(source, PlacedDict) else {}
                for name in source if isinstance(source, dict) else ():
                    if str(name) not in listed.parameters:
                        yield _finding(
                            "R2B723",
                            f"{node.plugin} has no parameter {name!r}",
                            places.get(name, default),
                        )

    def monitors_without_results(self) -> Iterator[Diagnostic]:
        monitors = {_index(node): node for node in reversed(self.graph.monitors)}
        for index, number in Counter(map(_index, self.graph.monitors)).items():
            if number > 1:
                yield _finding(
                    "R2B724",
                    f"{number} monitors have the index {index}, and so one service name",
                    monitors[index].source.place_of("parameters"),
                )
        listed = self._listed()
        if listed is None:
            return
        for index, place in listed.items():
            if index not in monitors:
                yield _finding(
                    "R2B724",
                    f"no monitor of the script has the service monitor_node{index}",
                    place,
                )
        for index, node in monitors.items():
            if index not in listed:
                yield _finding(
                    "R2B724",
                    f"{node.name!r} has the index {index}, which monitor_info_list does not have",
                    node.source.place_of("parameters"),
                    Severity.WARNING,
                )

    def _listed(self) -> dict[int, Span] | None:
        """The indices in the list of monitors; None if the list is not known."""
        given = self.config.get("monitor_info_list")
        if given is None:
            return {} if self.script.sends_goals else {0: self.config.place}
        if not isinstance(given, list | tuple):
            return None
        listed = list(self.settings.listed_monitors())
        indices = {each.index: each.place for each in listed if each.index is not None}
        return None if any(each.index is None for each in listed) else indices

    def shared_prefixes(self) -> Iterator[Diagnostic]:
        prefixes: set[str] = set()
        reported = (each.prefixes for each in self.settings.listed_monitors())
        for prefix, place in itertools.chain.from_iterable(reported):
            if prefix in prefixes:
                yield _finding(
                    "R2B725",
                    f"two monitors report under the prefix {prefix!r}",
                    place,
                )
            prefixes.add(prefix)

    def number_of_formats(self) -> Iterator[Diagnostic]:
        player = self.graph.player
        formats = player.parameter("data_formats") if player is not None else None
        if player is None or not isinstance(formats, list | tuple):
            return
        if len(self.inputs) != len(formats):
            yield _finding(
                "R2B726",
                f"the player has {len(formats)} formats, and remappings for {len(self.inputs)} "
                "inputs",
                player.source.place_of("parameters"),
            )

    def buffers_without_source(self) -> Iterator[Diagnostic]:
        loader = self.graph.loader
        if loader is None or self.graph.preprocessors:
            return
        loaded = {topic_in(loader.namespace, remapping.target) for remapping in loader.remappings}
        for input_ in self.inputs:
            topic = topic_in(input_.player.namespace, input_.source)
            buffer = f"buffer/input{input_.number}"
            is_renamed = any(remapping.source == buffer for remapping in input_.player.remappings)
            # The loader also publishes the topics that it does not rename, under their own names.
            is_recorded = "/" not in topic.removeprefix(f"{self.settings.namespace}/")
            if is_renamed and topic not in loaded and not is_recorded:
                yield _finding(
                    "R2B727",
                    f"nothing publishes {topic!r}, which input {input_.number} of the player "
                    "buffers",
                    input_.player.source.place_of("remappings"),
                )

    def monitored_inputs(self) -> Iterator[Diagnostic]:
        played = {input_.full_topic for input_ in self.inputs}
        for node in self.graph.monitors:
            topic = topic_in(node.namespace, node.remapped("output"))
            if topic in played:
                yield _finding(
                    "R2B728",
                    f"{node.name!r} monitors {topic!r}, which the player publishes",
                    node.source.place_of("remappings"),
                )

    def one_message(self) -> Iterator[Diagnostic]:
        key = "playback_message_buffer_size"
        if self.config.get(key) == 1 and self.mode == "looping":
            yield _finding(
                "R2B729",
                "one message is buffered, and played again and again",
                self.config.place_of(key),
            )

    def latency_of_two_messages(self) -> Iterator[Diagnostic]:
        has_keys = self.config.get("revise_timestamps_as_message_ids") is True
        if has_keys or self.mode == "live":
            return
        yield _finding(
            "R2B730",
            "messages have no keys (revise_timestamps_as_message_ids is off)",
            self.config.place,
        )

    def tolerant_search(self) -> Iterator[Diagnostic]:
        lower = self.settings.value("publisher_lower_frequency")
        upper = self.settings.value("publisher_upper_frequency")
        drop = self.config.get("binary_search_acceptable_frame_rate_drop", default=10)
        is_known = all(
            isinstance(value, int | float) and math.isfinite(value)
            for value in (lower, upper, drop)
        )
        if not is_known or not 0 < lower < upper or self.mode != "looping":
            return
        if drop >= lower / 2:
            yield _finding(
                "R2B731",
                f"the search accepts {drop:g} Hz less than it sends: at {lower:g} Hz, that is "
                f"{min(1.0, drop / lower):.0%} of the messages",
                self.config.place_of("publisher_lower_frequency"),
            )

    def sleeps(self) -> Iterator[Diagnostic]:
        for effect in (*self.script.preparation, *self.script.hooks):
            if effect.name == "time.sleep" and effect.arguments:
                yield _finding(
                    "R2B733",
                    "the script sleeps until the graph should be ready",
                    effect.place,
                )

    def counted_transforms(self) -> Iterator[Diagnostic]:
        player = self.graph.player
        formats = player.parameter("data_formats") if player is not None else None
        if player is None or not isinstance(formats, list) or self.mode != "timeline":
            return
        if "tf2_msgs/msg/TFMessage" in formats:
            yield _finding(
                "R2B734",
                "transforms are an input of a timeline",
                player.source.place_of("parameters"),
            )


def _finding(code: str, what: str, place: Span, severity: Severity | None = None) -> Diagnostic:
    """A mistake, of the severity of its code where no other one is given."""
    page = all_pages()[code]
    return Diagnostic(code, severity or page.severity, what, place, help=page.why)


def _side(text: str) -> str:
    """Left or right, if a name has one of the two words and not the other."""
    words = {word.lower() for word in _WORDS.findall(text)} & {"left", "right"}
    return words.pop() if len(words) == 1 else ""


def _index(monitor: NodeAction) -> int:
    value = monitor.parameter("monitor_index")
    return value if isinstance(value, int) else 0
