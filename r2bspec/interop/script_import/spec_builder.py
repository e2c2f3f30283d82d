"""A spec from a script of ros2_benchmark.

Everything that the spec says is in the script, or a default of ros2_benchmark. What is not
understood becomes a comment in the spec and a finding with the line of the script.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.interop.script_import.benchmark_script import BenchmarkScript
from r2bspec.interop.script_import.config_keys import IMPORTED_KEYS, TOOL_KEYS
from r2bspec.interop.script_import.evaluator import Note
from r2bspec.interop.script_import.known_topics import ros_format
from r2bspec.interop.script_import.launch_actions import NodeAction
from r2bspec.interop.script_import.node_roles import (
    ScriptGraph,
    divide_by_role,
    input_numbers,
    remapped,
    topic_in,
)
from r2bspec.interop.script_import.script_effects import add_steps
from r2bspec.interop.script_import.script_settings import ScriptSettings
from r2bspec.interop.script_import.script_values import (
    Construct,
    ImageSize,
    Place,
    Unknown,
)
from r2bspec.interop.script_import.spec_data_loader import DataLoaderWriter
from r2bspec.interop.script_import.spec_nodes import NodeWriter, containers_of
from r2bspec.interop.script_import.spec_values import (
    NoValueError,
    SpecValues,
    identifier,
    relative_folder,
    unique_name,
)
from r2bspec.interop.script_import.yaml_writer import Block, document
from r2bspec.language.names import MESSAGE_TYPE, MONITOR_NAME, NAME

NOT_IMPORTED = "R2B710"
_NO_MONITOR = ("No monitor of the script is known: name an output of the graph instead of this.",)
CHANGED = "R2B711"

_DEFAULT_NAMESPACE = "r2b"
_LICENCE = re.compile(r"SPDX-|copyright", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class ImportedSpec:
    """The result of an import.

    Attributes:
        name: of the benchmark.
        text: the spec.
        findings: what was not imported, or in another way.
        sources: the texts that findings point into, by file.
    """

    name: str
    text: str
    findings: tuple[Diagnostic, ...]
    sources: dict[str, str]


def build_spec(script: BenchmarkScript, folder: Path) -> ImportedSpec:
    """The spec of a script.

    Args:
        script: the script.
        folder: where the spec will be.
    """
    return _SpecBuilder(script, folder).build()


@dataclass(slots=True)
class _SpecBuilder:
    script: BenchmarkScript
    folder: Path
    notes: list[Note] = field(default_factory=list)
    changes: list[Note] = field(default_factory=list)
    settings: ScriptSettings = field(init=False)
    values: SpecValues = field(init=False)
    graph: ScriptGraph = field(init=False)
    namespace: str = field(init=False)
    adapted: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.settings = ScriptSettings(self.script, self.notes)
        script_file = self.script.module.file
        folder = relative_folder(script_file.parent, self.folder)
        self.values = SpecValues(folder, self.script.sizes)
        root = self.settings.value("benchmark_namespace", _DEFAULT_NAMESPACE)
        self.namespace = "/" + (root if isinstance(root, str) else _DEFAULT_NAMESPACE).strip("/")
        self.graph = divide_by_role(self.script.parts, self.script.docstring, self.namespace)

    def build(self) -> ImportedSpec:
        script = self.script
        stem = script.module.file.stem
        name = stem if re.search(NAME.pattern, stem) else identifier(stem)
        nodes = NodeWriter(
            self.values,
            script.comments,
            self.namespace,
            script.module.file,
            self.notes,
            self.changes,
        )
        body = Block()
        if not self._is_live():
            loader = DataLoaderWriter(
                script,
                self.settings,
                self.graph,
                self.namespace,
                self.values,
                self.notes,
                self.changes,
            )
            body.add("data_loader", loader.block())
        preprocessors, graph, containers, monitors = Block(), Block(), Block(), self._monitors()
        player = [self.graph.player] if self.graph.player is not None else []
        used = containers_of(
            containers,
            script.parts.containers,
            self.graph.graph,
            self.graph.preprocessors,
            [*player, *self.graph.monitors],
        )
        nodes.keys |= used
        nodes.add_all(preprocessors, self.graph.preprocessors, None)
        nodes.add_all(graph, self.graph.graph, used)
        body.add("preprocessors", preprocessors)
        body.add("containers", containers)
        add_steps(body, script, self.values, self.notes, self.changes)
        body.add("playback", self._playback())
        outer = Block()
        outer.add("nodes", graph)
        body.add("graph", outer)
        body.add("monitors", monitors)
        body.add("benchmark", self._benchmark())
        self._note_rest()
        return self._assembled(name, body)

    def _assembled(self, name: str, body: Block) -> ImportedSpec:
        top = Block()
        top.add("r2bspec", 1)
        top.add("name", name)
        title = self.settings.value("benchmark_name", "")
        top.add("title", title if isinstance(title, str) and title.strip() else None)
        top.add("labels", self._labels())
        if self.namespace != f"/{_DEFAULT_NAMESPACE}":
            top.add("namespace", self.namespace)
        top.add("environment", self.values.environment)
        top.add("variables", self._variables())
        top.entries += body.entries
        top.below += self._not_imported()
        text = document(top, self._header())
        findings = sorted(
            [
                *(
                    self._finding(NOT_IMPORTED, Severity.WARNING, each)
                    for each in self._all_notes()
                ),
                *(self._finding(CHANGED, Severity.INFO, each) for each in self.changes),
            ],
            key=lambda each: each.sort_key,
        )
        return ImportedSpec(name, text, tuple(dict.fromkeys(findings)), self.script.texts)

    def _header(self) -> list[str]:
        head = [each for each in self.script.comments.head() if _LICENCE.search(each)]
        found = [f"Imported by r2bspec from {self.script.module.file.name}."]
        if head:
            found += ["", *head]
        if self.script.docstring:
            found += ["", self.script.docstring]
        return found

    def _labels(self) -> dict[str, Any]:
        given = self.settings.value("custom_report_info", {})
        if not isinstance(given, dict):
            self.settings.lost("custom_report_info", given)
            return {}
        found: dict[str, Any] = {}
        for key, value in given.items():
            if isinstance(value, ImageSize):
                shown = f"{value.width}x{value.height}"
                found[identifier(str(key))] = f"{value.label}, {shown}" if value.label else shown
            elif isinstance(value, str | int | float | bool):
                found[identifier(str(key))] = str(value)
            else:
                self.settings.lost("custom_report_info", value)
        return found

    def _variables(self) -> Block:
        block = Block()
        for name, value in self.values.variables.items():
            above: list[str] = []
            if name == "assets_root":
                above = ["The folder of the data and the models: 'assets_root' of ros2_benchmark."]
            elif name.startswith("share_"):
                above = ["The share folder of a package, where a binary installation has it."]
            block.add(name, value, above)
        return block

    def _is_live(self) -> bool:
        return self.settings.mode() == "live"

    def _playback(self) -> Block:
        block = Block()
        mode = self.settings.mode()
        block.add("mode", mode, self.settings.comments("benchmark_mode"))
        if mode == "live":
            return block
        size = int(self.settings.number("playback_message_buffer_size", 100))
        block.add("buffer", size, self.settings.comments("playback_message_buffer_size"))
        if self.settings.flag("record_data_timeline"):
            block.add("record_timeline", True, self.settings.comments("record_data_timeline"))
        inputs = Block()
        player = self.graph.player
        if player is None:
            self.notes.append(Note("the script has no playback node", self.script.config.place))
        else:
            self._inputs(inputs, player)
        block.add("inputs", inputs)
        return block

    def _inputs(self, block: Block, player: NodeAction) -> None:
        formats = _parameter(player, "data_formats")
        formats = list(formats) if isinstance(formats, list | tuple) else []
        for number in input_numbers(player):
            place = player.source.place_of("parameters")
            name = formats[number] if number < len(formats) else None
            kind = self._format(name, place)
            topic = remapped(player, f"input{number}")
            source = remapped(player, f"buffer/input{number}")
            if kind is None:
                self.notes.append(Note(f"the format of input{number} is not known", place))
                block.below.append(f"not imported: {topic}, whose format is not known")
                continue
            after = f"{name} in the script" if name != kind else ""
            block.add(topic, {"from": source, "format": kind}, after=after)

    def _format(self, name: Any, place: Place) -> str | None:
        if not isinstance(name, str):
            return None
        if re.search(MESSAGE_TYPE.pattern, name):
            return name
        kind = ros_format(name)
        if not kind:
            return None
        if name in self.adapted:
            return kind
        self.adapted.add(name)
        self.changes.append(
            Note(
                f"the negotiated format {name} is played and monitored as {kind}: the first node "
                "of the graph converts it, and its latency contains that",
                place,
            )
        )
        return kind

    def _monitors(self) -> Block:
        block = Block()
        used: set[str] = set()
        prefixes = self._prefixes()
        for each in self.graph.monitors:
            place = each.source.place_of("parameters")
            name = _parameter(each, "monitor_data_format")
            kind = self._format(name, place)
            if kind is None:
                self.notes.append(Note(f"the format of {each.name!r} is not known", place))
                block.below.append(f"not imported: {each.name}, whose format is not known")
                continue
            index = _parameter(each, "monitor_index")
            prefix = prefixes.get(index if isinstance(index, int) else 0, "")
            key = identifier(prefix or each.name)
            key = key if re.search(MONITOR_NAME.pattern, key) else f"monitor_{key}"
            entry = Block()
            entry.add("topic", self._watched(each))
            entry.add("format", kind, after=f"{name} in the script" if name != kind else "")
            if prefix and prefix != key:
                entry.add("label", prefix)
            above = (
                self.script.comments.at(each.source.place.line)
                if each.source.place.file == self.script.module.file
                else []
            )
            block.add(unique_name(key, used), entry, above)
        if not block.entries:
            block.add(
                "rosout", {"topic": "/rosout", "format": "rcl_interfaces/msg/Log"}, _NO_MONITOR
            )
        return block

    def _watched(self, monitor: NodeAction) -> str:
        topic = remapped(monitor, "output")
        namespace = monitor.namespace or "/"
        return topic if namespace == self.namespace else topic_in(namespace, topic)

    def _prefixes(self) -> dict[int, str]:
        """The titles of monitors in reports, by the index of the monitor."""
        found: dict[int, str] = {}
        given = self.settings.value("monitor_info_list", [])
        for each in given if isinstance(given, list | tuple) else []:
            if not isinstance(each, Construct):
                continue
            service = each.get("service_name", 0, "monitor_node0")
            number = re.search(r"(\d+)$", service) if isinstance(service, str) else None
            calculators = each.get("calculators", 1, [])
            for one in calculators if isinstance(calculators, list | tuple) else []:
                config = one.get("config", 0, {}) if isinstance(one, Construct) else {}
                prefix = config.get("report_prefix") if isinstance(config, dict) else None
                if isinstance(prefix, str) and prefix and number:
                    found[int(number[1])] = prefix
        return found

    def _benchmark(self) -> Block:
        block = Block()
        duration = self.settings.number("benchmark_duration", 5)
        block.add("duration", f"{duration:g} s", self.settings.comments("benchmark_duration"))
        iterations = int(self.settings.number("test_iterations", 5))
        block.add("iterations", iterations, self.settings.comments("test_iterations"))
        if self.settings.mode() in {"timeline", "live"}:
            return block
        lower = self.settings.number("publisher_lower_frequency", 10.0)
        upper = self.settings.number("publisher_upper_frequency", 100.0)
        extra = self.settings.value("additional_fixed_publisher_rate_tests", [10.0, 30.0, 60.0])
        if not isinstance(extra, list | tuple) or not all(
            isinstance(each, int | float) and math.isfinite(each) for each in extra
        ):
            self.settings.lost("additional_fixed_publisher_rate_tests", extra)
            extra = []
        rates = [*([lower] if lower == upper else []), *(each for each in extra if each <= upper)]
        above = self.settings.comments("additional_fixed_publisher_rate_tests")
        if len(rates) < len(extra):
            above = [*above, "Rates above the upper bound of the search are left out."]
        block.add("rates", [f"{each:g} Hz" for each in dict.fromkeys(rates)], above)
        if lower < upper:
            loss = self.settings.number("binary_search_acceptable_frame_loss_fraction", 0.05)
            search = {
                "min": f"{lower:g} Hz",
                "max": f"{upper:g} Hz",
                "holds": f"drop_rate <= {loss * 100:g} %",
            }
            if len(self.graph.monitors) > 1:
                names = [each.key for each in self._monitors().entries]
                search["holds"] = f"{names[0]}.{search['holds']}" if names else search["holds"]
            block.add("search", search, self.settings.comments("publisher_upper_frequency"))
        return block

    def _note_rest(self) -> None:
        """Notes about what no other part of the builder looks at."""
        config = self.script.config
        for key, value in config.keywords.items():
            if key not in IMPORTED_KEYS and key not in TOOL_KEYS:
                self.notes.append(Note(f"{key!r} is no known key", config.place_of(key)))
            elif isinstance(value, Unknown) and key in IMPORTED_KEYS:
                self.notes.append(Note(f"{key!r} is left out: {value.reason}", value.place))
        if config.get("config_file_path", 0) is not None:
            self.notes.append(Note("the configuration file is not read", config.place))
        for message, place in self.script.parts.ignored:
            self.notes.append(Note(message, place))
        for each in self.graph.further:
            self.notes.append(
                Note(f"{each.name!r} is a second loader or player", each.source.place)
            )
        for one in self.graph.undecided:
            name = one.name if isinstance(one, NodeAction) else one.file or one.path
            message = (
                f"nothing in the script tells whether {name!r} is a preprocessor; it is a node of "
                "the graph here"
            )
            self.changes.append(Note(message, one.source.place))

    def _all_notes(self) -> list[Note]:
        return [*self.script.notes, *self.notes]

    def _not_imported(self) -> list[str]:
        found = [
            f"  {each.place.file.name}:{each.place.line}: {each.message}"
            for each in self._all_notes()
        ]
        objectives = (
            "The script states no objectives: 'r2bspec suggest SPEC RUN' proposes some after a run."
        )
        head = ["Not imported:", *dict.fromkeys(found), ""] if found else []
        return [*head, objectives]

    def _finding(self, code: str, severity: Severity, note: Note) -> Diagnostic:
        place = note.place
        span = Span(str(place.file), place.line, place.column, place.line, max(place.column + 1, 1))
        if place.end_line == place.line:
            span = Span(
                str(place.file), place.line, place.column, place.line, max(place.end_column - 1, 2)
            )
        return Diagnostic(code, severity, note.message, span)


def _parameter(node: NodeAction, name: str) -> Any:
    """The last value of a parameter in the script."""
    found = None
    for each in node.parameters:
        if isinstance(each, dict) and name in each:
            found = each[name]
    return found


__all__ = ["ImportedSpec", "NoValueError", "build_spec"]
