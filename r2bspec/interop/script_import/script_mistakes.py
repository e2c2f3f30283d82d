"""Mistakes in scripts of ros2_benchmark that its runs do not show, and what they do to a result.

Each check is a function that yields findings. A check says nothing where the script does not
determine the answer.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.interop.script_import.benchmark_script import BenchmarkScript
from r2bspec.interop.script_import.launch_actions import NodeAction, Remapping
from r2bspec.interop.script_import.node_roles import (
    HARNESS_PACKAGES,
    ScriptGraph,
    divide_by_role,
    input_numbers,
    remapped,
    topic_in,
)
from r2bspec.interop.script_import.script_values import Construct, Foreign, Place, PlacedDict
from r2bspec.wiring.node_interface import catalogue_nodes

_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
_ABSOLUTE_NAMES = frozenset({"/tf", "/tf_static", "/clock", "/rosout", "/parameter_events"})
_PREFIX = "report_prefix"


def find_mistakes(script: BenchmarkScript) -> list[Diagnostic]:
    """The mistakes of a script, sorted by place."""
    return sorted(dict.fromkeys(_Mistakes(script).all()), key=lambda each: each.sort_key)


class _Mistakes:
    def __init__(self, script: BenchmarkScript) -> None:
        self.script = script
        root = script.config.get("benchmark_namespace", default="r2b")
        self.namespace = f"/{root}" if isinstance(root, str) else "/r2b"
        self.graph: ScriptGraph = divide_by_role(script.parts, script.docstring, self.namespace)

    def all(self) -> Iterator[Diagnostic]:
        yield from self.crossed_sides()
        yield from self.names_used_twice()
        yield from self.remappings_without_effect()
        yield from self.unknown_parameters()
        yield from self.monitors_without_results()
        yield from self.shared_prefixes()
        yield from self.number_of_formats()
        yield from self.buffers_without_source()
        yield from self.monitored_inputs()
        yield from self.one_message()
        yield from self.latency_of_two_messages()
        yield from self.tolerant_search()
        yield from self.sleeps()
        yield from self.counted_transforms()

    def crossed_sides(self) -> Iterator[Diagnostic]:
        remappings = [
            (each.node or node.name, each)
            for node in self.script.parts.nodes
            for each in node.remappings
        ]
        remappings += [
            (each.node, each) for one in self.script.parts.includes for each in one.remappings
        ]
        for owner, each in remappings:
            wanted = _side(each.source) or _side(owner)
            found = _side(each.target)
            if wanted and found and wanted != found:
                yield _finding(
                    "R2B720",
                    Severity.WARNING,
                    f"{owner!r} gets {each.target!r} as its {wanted} {each.source!r}",
                    "both sides then process the same camera: disparity and matching have no work "
                    "that a stereo pair would give, and the result is not that of the graph it is "
                    "named after",
                    each.place,
                )
        player = self.graph.player
        for number in input_numbers(player) if player else []:
            source = remapped(player, f"buffer/input{number}")  # type: ignore[arg-type]
            target = remapped(player, f"input{number}")  # type: ignore[arg-type]
            if _side(source) and _side(target) and _side(source) != _side(target):
                yield _finding(
                    "R2B720",
                    Severity.WARNING,
                    f"the {_side(source)} buffer {source!r} is played on {target!r}",
                    "the graph gets the cameras exchanged",
                    player.source.place_of("remappings"),  # type: ignore[union-attr]
                )

    def names_used_twice(self) -> Iterator[Diagnostic]:
        seen: dict[tuple[str, str], NodeAction] = {}
        for node in self.script.parts.nodes:
            key = (node.namespace, node.name)
            if key in seen:
                yield _finding(
                    "R2B721",
                    Severity.ERROR,
                    f"two nodes are named {node.namespace}/{node.name}; the other one is in line "
                    f"{seen[key].source.place.line}",
                    "parameters, services and private topics of one reach the other; the container "
                    "may refuse the second, which the tool only logs, and the run measures a graph "
                    "without it",
                    node.source.place_of("name"),
                )
            seen.setdefault(key, node)

    def remappings_without_effect(self) -> Iterator[Diagnostic]:
        for node in self.script.parts.nodes:
            for each in node.remappings:
                text = self._without_effect(node, each)
                if text:
                    yield _finding(
                        "R2B722",
                        Severity.INFO if each.source == each.target else Severity.WARNING,
                        text,
                        "the node keeps its own topic: if the remapping was meant to connect it, "
                        "it gets no messages, and the run ends with '0 messages recorded'",
                        each.place,
                    )

    def _without_effect(self, node: NodeAction, each: Remapping) -> str:
        if each.source.startswith("/") and node.namespace and each.source not in _ABSOLUTE_NAMES:
            inside = each.source.startswith(f"{node.namespace.rstrip('/')}/")
            if not inside:
                known = node.package in HARNESS_PACKAGES or catalogue_nodes(node.package)
                when = "cannot match" if known else "matches only if its code has the absolute name"
                return (
                    f"the remapping of {each.source!r} of {node.name!r} {when}: in the namespace "
                    f"{node.namespace}, a relative topic of that name is "
                    f"{node.namespace.rstrip('/')}{each.source}"
                )
        if each.source == each.target:
            return f"{each.source!r} of {node.name!r} is remapped to itself"
        return ""

    def unknown_parameters(self) -> Iterator[Diagnostic]:
        for node in self.script.parts.nodes:
            known = catalogue_nodes(node.package).get(node.plugin)
            declared = known.parameters if known is not None else None
            for source in node.parameters if declared is not None else []:
                for name in source if isinstance(source, dict) else ():
                    if declared is not None and str(name) not in declared:
                        yield _finding(
                            "R2B723",
                            Severity.WARNING,
                            f"{node.plugin} has no parameter {name!r}",
                            "the value is ignored without a word, so the node runs with its "
                            "default",
                            source.places[name]
                            if isinstance(source, PlacedDict) and name in source.places
                            else node.source.place_of("parameters"),
                        )

    def monitors_without_results(self) -> Iterator[Diagnostic]:
        places = {_index(each): each for each in reversed(self.graph.monitors)}
        for index, number in Counter(map(_index, self.graph.monitors)).items():
            if number > 1:
                yield _finding(
                    "R2B724",
                    Severity.ERROR,
                    f"{number} monitors have the index {index}, and so one service name",
                    "the controller reads one of them; the topics of the others are not measured",
                    places[index].source.place_of("parameters"),
                )
        listed = self._listed()
        if listed is None:
            return
        for index, place in listed.items():
            if index not in places:
                yield _finding(
                    "R2B724",
                    Severity.ERROR,
                    f"no monitor of the script has the service monitor_node{index}",
                    "the controller waits for the service until its timeout, and the run fails",
                    place,
                )
        for index, node in places.items():
            if index not in listed:
                yield _finding(
                    "R2B724",
                    Severity.WARNING,
                    f"{node.name!r} has the index {index}, which monitor_info_list does not have",
                    "it costs processor time during the run, and its topic is in no report",
                    node.source.place_of("parameters"),
                )

    def _listed(self) -> dict[int, Place] | None:
        """The indices in the list of monitors; None if the list is not known."""
        given = self.script.config.get("monitor_info_list", default=None)
        if given is None:
            return {0: self.script.config.place}
        if not isinstance(given, list | tuple):
            return None
        found: dict[int, Place] = {}
        for each in given:
            service = each.get("service_name", 0, "monitor_node0") if _is_call(each) else None
            number = re.fullmatch(r"monitor_node(\d{1,6})", str(service))
            if number is None:
                return None
            found[int(number[1])] = each.place
        return found

    def shared_prefixes(self) -> Iterator[Diagnostic]:
        given = self.script.config.get("monitor_info_list", default=[])
        seen: set[str] = set()
        for each in given if isinstance(given, list | tuple) else []:
            calculators = each.get("calculators", 1, []) if _is_call(each) else []
            for one in calculators if isinstance(calculators, list | tuple) else []:
                config = one.get("config", 0, {}) if _is_call(one) else None
                prefix = config.get(_PREFIX, "") if isinstance(config, dict) else None
                if isinstance(prefix, str) and prefix in seen:
                    yield _finding(
                        "R2B725",
                        Severity.WARNING,
                        f"two monitors report under the prefix {prefix!r}",
                        "their figures have the same keys in the report: the later ones replace "
                        "the earlier ones",
                        one.place,
                    )
                if isinstance(prefix, str):
                    seen.add(prefix)

    def number_of_formats(self) -> Iterator[Diagnostic]:
        player = self.graph.player
        formats = _parameter(player, "data_formats") if player else None
        if player is None or not isinstance(formats, list | tuple):
            return
        number = len(input_numbers(player))
        if number != len(formats):
            yield _finding(
                "R2B726",
                Severity.WARNING,
                f"the player has {len(formats)} formats, and remappings for {number} inputs",
                "an input without a remapping is played on 'inputN', where nothing subscribes, or "
                "waits for messages that do not come",
                player.source.place_of("parameters"),
            )

    def buffers_without_source(self) -> Iterator[Diagnostic]:
        player, loader = self.graph.player, self.graph.loader
        if player is None or loader is None or self.graph.preprocessors:
            return
        loaded = {topic_in(loader.namespace, each.target) for each in loader.remappings}
        for number in input_numbers(player):
            topic = topic_in(player.namespace, remapped(player, f"buffer/input{number}"))
            renamed = any(each.source == f"buffer/input{number}" for each in player.remappings)
            if renamed and topic not in loaded and not self._is_recorded(topic):
                yield _finding(
                    "R2B727",
                    Severity.WARNING,
                    f"nothing publishes {topic!r}, which input {number} of the player buffers",
                    "the run ends with 'start_recording service returned with a timeout (0 "
                    "messages recorded)'",
                    player.source.place_of("remappings"),
                )

    def _is_recorded(self, topic: str) -> bool:
        # The loader also publishes the topics that it does not rename, under their own names.
        return "/" not in topic.removeprefix(f"{self.namespace}/")

    def monitored_inputs(self) -> Iterator[Diagnostic]:
        player = self.graph.player
        if player is None:
            return
        played = {
            topic_in(player.namespace, remapped(player, f"input{number}"))
            for number in input_numbers(player)
        }
        for each in self.graph.monitors:
            topic = topic_in(each.namespace, remapped(each, "output"))
            if topic in played:
                yield _finding(
                    "R2B728",
                    Severity.ERROR,
                    f"{each.name!r} monitors {topic!r}, which the player publishes",
                    "it measures the transport from the player to the monitor, and nothing of the "
                    "graph",
                    each.source.place_of("remappings"),
                )

    def one_message(self) -> Iterator[Diagnostic]:
        config = self.script.config
        if config.get("playback_message_buffer_size") == 1 and self._mode() == "LOOPING":
            yield _finding(
                "R2B729",
                Severity.INFO,
                "one message is buffered, and played again and again",
                "caches and branch predictors know it: the graph is faster than on a recording, "
                "and work that depends on the content has no spread",
                config.place_of("playback_message_buffer_size"),
            )

    def latency_of_two_messages(self) -> Iterator[Diagnostic]:
        config = self.script.config
        if config.get("revise_timestamps_as_message_ids") is True or self._mode() == "LIVE":
            return
        yield _finding(
            "R2B730",
            Severity.INFO,
            "messages have no keys (revise_timestamps_as_message_ids is off)",
            "the latencies of the report are those of the first and the last message of a run: "
            "there is no mean, no maximum and no percentile",
            config.place,
        )

    def tolerant_search(self) -> Iterator[Diagnostic]:
        config = self.script.config
        lower = config.get("publisher_lower_frequency", default=10.0)
        upper = config.get("publisher_upper_frequency", default=100.0)
        drop = config.get("binary_search_acceptable_frame_rate_drop", default=10)
        numbers = all(
            isinstance(each, int | float) and math.isfinite(each) for each in (lower, upper, drop)
        )
        if not numbers or lower <= 0 or lower >= upper or self._mode() != "LOOPING":
            return
        if drop >= lower / 2:
            yield _finding(
                "R2B731",
                Severity.INFO,
                f"from {lower:g} Hz on, the search accepts {drop:g} Hz less than it sends",
                f"at {lower:g} Hz that is {min(1.0, drop / lower):.0%} of the messages: the peak "
                "can be a rate that the graph does not sustain; and it is the upper bound "
                f"({upper:g} Hz) if the graph is faster",
                config.place_of("publisher_lower_frequency"),
            )

    def sleeps(self) -> Iterator[Diagnostic]:
        for each in (*self.script.preparation, *self.script.hooks):
            if each.name == "time.sleep" and each.arguments:
                yield _finding(
                    "R2B733",
                    Severity.INFO,
                    "the script sleeps until the graph should be ready",
                    "on a slower machine the measurement starts before that: the first messages "
                    "are lost or late, and count as those of the graph",
                    each.place,
                )

    def counted_transforms(self) -> Iterator[Diagnostic]:
        player = self.graph.player
        formats = _parameter(player, "data_formats") if player else None
        transforms = isinstance(formats, list) and "tf2_msgs/msg/TFMessage" in formats
        if transforms and player is not None and self._mode() == "TIMELINE":
            yield _finding(
                "R2B734",
                Severity.WARNING,
                "transforms are an input of a timeline",
                "every message of /tf counts as a frame that was sent, so most frames are "
                "reported as missed",
                player.source.place_of("parameters"),
            )

    def _mode(self) -> str:
        value: Any = self.script.config.get("benchmark_mode", default="LOOPING")
        return value.name.rpartition(".")[2] if isinstance(value, Foreign) else str(value).upper()


def _finding(code: str, severity: Severity, what: str, effect: str, place: Place) -> Diagnostic:
    end = place.end_column - 1 if place.end_line == place.line else place.column + 1
    span = Span(str(place.file), place.line, place.column, place.line, max(end, place.column + 1))
    return Diagnostic(code, severity, what, span, help=effect)


def _is_call(value: Any) -> bool:
    return isinstance(value, Construct)


def _side(text: str) -> str:
    """Left or right, if a name has one of the two words and not the other."""
    words = {each.lower() for each in _WORDS.findall(text)} & {"left", "right"}
    return words.pop() if len(words) == 1 else ""


def _index(monitor: NodeAction) -> int:
    value = _parameter(monitor, "monitor_index")
    return value if isinstance(value, int) else 0


def _parameter(node: NodeAction | None, name: str) -> Any:
    found = None
    for each in node.parameters if node is not None else []:
        if isinstance(each, dict) and name in each:
            found = each[name]
    return found
