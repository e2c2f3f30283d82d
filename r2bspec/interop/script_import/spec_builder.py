"""A spec from a script of ros2_benchmark.

Everything that the spec says is in the script, or a default of ros2_benchmark. What is not
understood becomes a comment in the spec and a finding with the line of the script. This module
writes what is loaded, played, monitored and measured; `spec_entries` writes the nodes and
what happens around the launch.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from r2bspec.datasets.catalogue import SEQUENCES
from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.interop.script_import import node_roles
from r2bspec.interop.script_import.benchmark_script import BenchmarkScript, Settings
from r2bspec.interop.script_import.launch_actions import topic_in
from r2bspec.interop.script_import.launch_parts import NodeAction
from r2bspec.interop.script_import.source_files import MODULE_MISSING
from r2bspec.interop.script_import.spec_entries import NodeWriter, add_steps
from r2bspec.interop.script_import.spec_text import (
    Block,
    SpecValues,
    document,
    identifier,
    relative_folder,
    unique_name,
)
from r2bspec.interop.script_import.values import ImageSize, ImportNote
from r2bspec.language.names import MESSAGE_TYPE, MONITOR_NAME, NAME

_NOT_IMPORTED: Final = "R2B710"
_CHANGED: Final = "R2B711"
_DEFAULT_NAMESPACE: Final = "/r2b"
_NO_MONITOR: Final = (
    "No monitor of the script is known: name an output of the graph instead of this."
)
_NO_OBJECTIVES: Final = (
    "The script states no objectives: 'r2bspec suggest SPEC RUN' proposes some after a run."
)
_LICENCE: Final = re.compile(r"SPDX-|copyright", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class ImportedSpec:
    """The result of an import.

    Attributes:
        name: of the benchmark.
        text: the spec.
        findings: what was not imported, or in another way.
        sources: the texts that findings point into, by file.
        is_whole: whether every module was found that its nodes and monitors come from.
    """

    name: str
    text: str
    findings: tuple[Diagnostic, ...]
    sources: dict[str, str]
    is_whole: bool


def build_spec(script: BenchmarkScript, folder: Path) -> ImportedSpec:
    """The spec of a script.

    Args:
        script: the script.
        folder: where the spec will be.
    """
    return _SpecBuilder(script, folder).build()


class _SpecBuilder:
    def __init__(self, script: BenchmarkScript, folder: Path) -> None:
        self.script = script
        notes: list[ImportNote] = []
        self.settings = Settings(script, notes)
        self.namespace = self.settings.namespace
        script_folder = relative_folder(script.module.file.parent, folder)
        self.values = SpecValues(script_folder, self.namespace, script.comments, notes=notes)
        self.graph = node_roles.divide_by_role(script.parts, script.docstring, self.namespace)
        self.inputs = node_roles.played_inputs(self.graph.player)
        plays = self.graph.player is not None or self.settings.mode == "live"
        self.called = [] if plays else script.clients
        self.adapted: set[str] = set()

    def build(self) -> ImportedSpec:
        body = Block()
        if self.settings.mode != "live" and not self.called:
            body.add("data_loader", self._data_loader())
        monitors = self._monitors()
        self._add_nodes(body)
        body.add("monitors", monitors)
        body.add("benchmark", self._benchmark([entry.key for entry in monitors.entries]))
        self.settings.note_rest()
        self._note_members()
        stem = self.script.module.file.stem
        name = stem if re.search(NAME.pattern, stem) else identifier(stem)
        top = self._head(name)
        notes = [*self.script.notes, *self.values.notes]
        missing = self._missing_modules()
        entries = [
            *missing,
            *(_finding(_NOT_IMPORTED, Severity.WARNING, note) for note in notes),
            *(_finding(_CHANGED, Severity.INFO, note) for note in self.values.changes),
        ]
        top.entries += body.entries
        return ImportedSpec(
            name,
            self._text(top, notes),
            tuple(dict.fromkeys(sorted(entries, key=lambda finding: finding.sort_key))),
            self.script.texts,
            is_whole=not missing,
        )

    def _add_nodes(self, body: Block) -> None:
        """Add everything between the recording and the monitors: nodes, steps, and inputs."""
        nodes = NodeWriter(self.values)
        preprocessors, graph, containers = Block(), Block(), Block()
        harness = [*filter(None, [self.graph.player]), *self.graph.monitors]
        kinds = self.script.parts.containers
        nodes.add_containers(containers, kinds, self.graph.graph, self.graph.preprocessors, harness)
        nodes.add_all(preprocessors, self.graph.preprocessors, preprocessors=True)
        nodes.add_all(graph, self.graph.graph)
        body.add("preprocessors", preprocessors)
        body.add("containers", containers)
        add_steps(body, self.script, self.values)
        body.add("playback", self._playback())
        outer = Block()
        outer.add("nodes", graph)
        body.add("graph", outer)

    def _head(self, name: str) -> Block:
        top = Block()
        top.add("r2bspec", 1)
        top.add("name", name)
        title = self.settings.value("benchmark_name")
        top.add("title", title if isinstance(title, str) and title.strip() else None)
        top.add("labels", self._labels())
        if self.namespace != _DEFAULT_NAMESPACE:
            top.add("namespace", self.namespace)
        top.add("environment", self.values.environment)
        top.add("variables", self._variables())
        return top

    def _text(self, top: Block, notes: list[ImportNote]) -> str:
        lost = [f"  {Path(n.place.file).name}:{n.place.line}: {n.reason}" for n in notes]
        top.below += ["Not imported:", *dict.fromkeys(lost), ""] if lost else []
        top.below.append(_NO_OBJECTIVES)
        header = [f"Imported by r2bspec from {self.script.module.file.name}."]
        for part in (
            [line for line in self.script.comments.head() if _LICENCE.search(line)],
            [self.script.docstring] if self.script.docstring else [],
        ):
            header += ["", *part] if part else []
        return document(top, header)

    def _labels(self) -> dict[str, str]:
        key = "custom_report_info"
        given = self.settings.value(key)
        if not isinstance(given, dict):
            self.settings.lose(key)
            return {}
        labels: dict[str, str] = {}
        for name, value in given.items():
            if isinstance(value, ImageSize):
                shown = f"{value.width}x{value.height}"
                labels[identifier(str(name))] = f"{value.label}, {shown}" if value.label else shown
            elif isinstance(value, str | int | float | bool):
                labels[identifier(str(name))] = str(value)
            else:
                self.settings.lose(key, value)
        return labels

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

    def _data_loader(self) -> Block:
        block, key = Block(), "input_data_path"
        path = self.settings.value(key)
        if not isinstance(path, str) or not path:
            self.settings.lose(key)
            path = "recording"
        dataset = path.rstrip("/").rpartition("/")[2]
        sequence = SEQUENCES.get(dataset)
        sources = sequence.sources if sequence is not None else ()
        recorded = {f"/{source.name.lstrip('/')}" for source in sources}
        topics = self._loaded_topics(recorded)
        missing = {*topics} - recorded
        transforms = {
            topic
            for topic, flag in (
                ("/tf", "publish_tf_messages_in_set_data"),
                ("/tf_static", "publish_tf_static_messages_in_set_data"),
            )
            if self.settings.flag(flag)
        }
        if recorded and not missing and transforms <= recorded:
            # The synthetic dataset of that name has all that the script loads.
            block.add("bag", dataset, self.settings.comments(key))
        else:
            if recorded:
                self.values.change(
                    f"the synthetic dataset {dataset} has no "
                    f"{', '.join(sorted(missing)) or 'transforms'}: the recording of the script is "
                    "needed, below 'assets_root'",
                    self.script.config.place_of(key),
                )
            full = path if path.startswith("/") else f"$(assets)/{path}"
            block.add("bag", self.values.text(full), self.settings.comments(key))
        window = {
            end: f"{seconds:g} s"
            for end in ("start", "end")
            if (seconds := self.settings.number(f"input_data_{end}_time")) > 0
        }
        block.add("window", window, self.settings.comments("input_data_start_time"))
        block.add("topics", topics)
        for name, source in (
            ("publish_tf", "publish_tf_messages_in_set_data"),
            ("publish_tf_static", "publish_tf_static_messages_in_set_data"),
            ("real_time", "load_data_in_real_time"),
        ):
            if self.settings.flag(source):
                block.add(name, True, self.settings.comments(source))
        return block

    def _loaded_topics(self, recorded: set[str]) -> dict[str, str]:
        loader = self.graph.loader
        topics: dict[str, str] = {}
        for remapping in loader.remappings if loader is not None else []:
            inside = f"{self.namespace}/"
            name, target = remapping.source.removeprefix(inside), remapping.target
            if name.startswith("/"):
                # It never matches: the loader's own name is in the namespace of the benchmark.
                target = name.lstrip("/")
            topics.setdefault(f"/{name.lstrip('/')}", target)
        read = [
            remapping.target
            for member in self.graph.preprocessors
            if isinstance(member, NodeAction)
            for remapping in member.remappings
        ]
        for topic in (*read, *(input_.source for input_ in self.inputs)):
            if f"/{topic}" in recorded:
                # The loader of ros2_benchmark publishes every topic of the recording.
                topics.setdefault(f"/{topic}", topic)
        if not topics and loader is not None:
            self.values.lose("no loaded topic is named in the script", loader.source.place)
        return topics

    def _playback(self) -> Block:
        block = Block()
        if self.called:
            block.add("calls", self._calls())
            return block
        mode = self.settings.mode
        block.add("mode", mode, self.settings.comments("benchmark_mode"))
        if mode == "live":
            return block
        key = "playback_message_buffer_size"
        block.add("buffer", int(self.settings.number(key)), self.settings.comments(key))
        if self.settings.flag("record_data_timeline"):
            block.add("record_timeline", True, self.settings.comments("record_data_timeline"))
        if self.graph.player is None:
            self.values.lose("the script has no playback node", self.script.config.place)
        inputs = Block()
        for input_ in self.inputs:
            self._add_input(inputs, input_)
        block.add("inputs", inputs)
        return block

    def _calls(self) -> Block:
        """The services and actions that the script calls itself; what it asks them is its code."""
        block = Block()
        used: set[str] = set()
        for client in self.called:
            if not client.type or not client.name:
                self.values.lose(f"the {client.kind} of a client is not known", client.place)
                continue
            request = "goal" if client.kind == "action" else "request"
            self.values.lose(
                f"the {request} of {client.name!r} is what the script computes", client.place
            )
            call = {"name": client.name, "type": client.type, request: {}}
            key = unique_name(identifier(client.name.strip("/")), used)
            block.add(key, {client.kind: call}, [f"Write the fields of the {request}."])
        return block

    def _add_input(self, block: Block, each: node_roles.PlayedInput) -> None:
        formats = each.player.parameter("data_formats")
        is_given = isinstance(formats, list | tuple) and each.number < len(formats)
        place = each.player.source.place_of("parameters")
        name = formats[each.number] if is_given else None
        kind = self._format(name, place)
        if kind is None:
            self.values.lose(f"the format of input{each.number} is not known", place)
            block.below.append(f"not imported: {each.topic}, whose format is not known")
        else:
            after = f"{name} in the script" if name != kind else ""
            block.add(each.topic, {"from": each.source, "format": kind}, after=after)

    def _format(self, name: Any, place: Span) -> str | None:
        """The ROS type of a format; None if it is not known."""
        if not isinstance(name, str):
            return None
        if re.search(MESSAGE_TYPE.pattern, name):
            return name
        kind = node_roles.ros_format(name)
        if kind and name not in self.adapted:
            self.adapted.add(name)
            self.values.change(
                f"the negotiated format {name} is played and monitored as {kind}: the first node "
                "of the graph converts it, and its latency contains that",
                place,
            )
        return kind or None

    def _monitors(self) -> Block:
        block = Block()
        used: set[str] = set()
        prefixes = self._prefixes()
        for node in self.graph.monitors:
            place = node.source.place_of("parameters")
            name = node.parameter("monitor_data_format")
            kind = self._format(name, place)
            if kind is None:
                self.values.lose(f"the format of {node.name!r} is not known", place)
                block.below.append(f"not imported: {node.name}, whose format is not known")
                continue
            index = node.parameter("monitor_index")
            prefix = prefixes.get(index if isinstance(index, int) else 0, "")
            key = identifier(prefix or node.name)
            key = key if re.search(MONITOR_NAME.pattern, key) else f"monitor_{key}"
            topic, namespace = node.remapped("output"), node.namespace or "/"
            entry = Block()
            entry.add("topic", topic if namespace == self.namespace else topic_in(namespace, topic))
            entry.add("format", kind, after=f"{name} in the script" if name != kind else "")
            entry.add("label", prefix if prefix and prefix != key else None)
            block.add(unique_name(key, used), entry, self.script.comments.at(node.source.place))
        if not block.entries and not self.called:
            log = {"topic": "/rosout", "format": "rcl_interfaces/msg/Log", "match": "order"}
            block.add("rosout", log, [_NO_MONITOR])
        return block

    def _prefixes(self) -> dict[int, str]:
        """The titles of monitors in reports, by the index of the monitor."""
        return {
            listed.index: prefix
            for listed in self.settings.listed_monitors()
            for prefix, _ in listed.prefixes
            if listed.index is not None and prefix
        }

    def _benchmark(self, monitors: list[str]) -> Block:
        block, number, comments = Block(), self.settings.number, self.settings.comments
        duration, iterations = number("benchmark_duration"), number("test_iterations")
        block.add("duration", f"{duration:g} s", comments("benchmark_duration"))
        block.add("iterations", int(iterations), comments("test_iterations"))
        if self.called:
            block.add("rates", ["1 Hz"], ["The script calls again when it is answered."])
        if self.called or self.settings.mode in {"timeline", "live"}:
            return block
        lower, upper = number("publisher_lower_frequency"), number("publisher_upper_frequency")
        key = "additional_fixed_publisher_rate_tests"
        extra = self.settings.value(key)
        if not isinstance(extra, list | tuple) or not all(
            isinstance(rate, int | float) and math.isfinite(rate) for rate in extra
        ):
            self.settings.lose(key)
            extra = []
        rates = [*([lower] if lower == upper else []), *(rate for rate in extra if rate <= upper)]
        above = comments(key)
        if len(rates) < len(extra):
            above = [*above, "Rates above the upper bound of the search are left out."]
        block.add("rates", [f"{rate:g} Hz" for rate in dict.fromkeys(rates)], above)
        if lower < upper:
            loss = number("binary_search_acceptable_frame_loss_fraction")
            prefix = f"{monitors[0]}." if len(self.graph.monitors) > 1 else ""
            search = {
                "min": f"{lower:g} Hz",
                "max": f"{upper:g} Hz",
                "holds": f"{prefix}drop_rate <= {loss * 100:g} %",
            }
            block.add("search", search, comments("publisher_upper_frequency"))
        return block

    def _note_members(self) -> None:
        """Notes about actions that are not understood, and about roles that are not certain."""
        self.values.notes += self.script.parts.ignored
        self.values.changes += self.script.parts.changes
        for node in self.graph.further:
            self.values.lose(f"{node.name!r} is a second loader or player", node.source.place)
        for member in self.graph.undecided:
            name = member.name if isinstance(member, NodeAction) else member.file or member.path
            self.values.change(
                f"nothing in the script tells whether {name!r} is a preprocessor; it is a node of "
                "the graph here",
                member.source.place,
            )

    def _missing_modules(self) -> list[Diagnostic]:
        """The modules that are not beside the script, though its nodes or monitors are theirs."""
        return [
            Diagnostic(
                MODULE_MISSING,
                Severity.ERROR,
                f"the module {module!r} was not found, so what these calls make is left out: "
                + ", ".join(dict.fromkeys(call.short_name for call in calls)),
                self.script.imports.get(module, calls[0].place),
                help="Name the folder with this package: --package-path FOLDER.",
            )
            for module, calls in self.script.parts.missing.items()
        ]


def _finding(code: str, severity: Severity, note: ImportNote) -> Diagnostic:
    return Diagnostic(code, severity, note.reason, note.place)
