"""A spec from a script of ros2_benchmark.

Everything in the spec is from the script, or a default of ros2_benchmark. What is not understood
becomes a comment in the spec and a finding with the line of the script. This module writes what is
loaded, played, monitored and measured; `spec_entries` writes the nodes and the steps around the
launch.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from r2bspec.datasets.catalogue import SEQUENCES
from r2bspec.diagnostics import Diagnostic, Severity
from r2bspec.interop import node_roles
from r2bspec.interop.node_roles import topic_in
from r2bspec.interop.recording import NodeAction, Place, RecordedFile, record, span_of
from r2bspec.interop.spec_entries import NodeWriter, add_steps
from r2bspec.interop.spec_text import Block, SpecValues, document, identifier, unique_name
from r2bspec.language.names import MESSAGE_TYPE, MONITOR_NAME, NAME

_CODES: Final = {
    "missing": ("R2B705", Severity.ERROR),
    "lost": ("R2B710", Severity.WARNING),
    "changed": ("R2B711", Severity.INFO),
}
"""The findings of notes, by their kind."""
_MISSING_HELP: Final = "Name the folder with this package: --package-path FOLDER."
_DEFAULT_NAMESPACE: Final = "/r2b"
_NO_MONITOR: Final = (
    "No monitor of the script is known: name an output of the graph instead of this."
)
_NO_OBJECTIVES: Final = (
    "The script states no objectives: 'r2bspec judge RUN --suggest SPEC' proposes some after a run."
)
_LICENCE: Final = re.compile(r"SPDX-|copyright", re.IGNORECASE)


_MODES: Final = frozenset({"timeline", "looping", "sweeping", "live"})
_DEFAULTS: Final[dict[str, Any]] = {
    "benchmark_name": "",
    "benchmark_namespace": "r2b",
    "benchmark_mode": "LOOPING",
    "benchmark_duration": 5,
    "test_iterations": 5,
    "custom_report_info": {},
    "input_data_path": "",
    "input_data_start_time": -1,
    "input_data_end_time": -1,
    "publish_tf_messages_in_set_data": False,
    "publish_tf_static_messages_in_set_data": False,
    "load_data_in_real_time": False,
    "record_data_timeline": False,
    "monitor_info_list": [],
    "playback_message_buffer_size": 100,
    "publisher_upper_frequency": 100.0,
    "publisher_lower_frequency": 10.0,
    "additional_fixed_publisher_rate_tests": [10.0, 30.0, 60.0],
    "binary_search_acceptable_frame_loss_fraction": 0.05,
}
"""Keys with a counterpart in a spec, with the defaults of ros2_benchmark."""


@dataclass(frozen=True, slots=True)
class ImportedSpec:
    """The result of an import.

    Attributes:
        name: the name of the benchmark.
        text: the spec.
        findings: what was not imported, or in another way.
        sources: the texts that findings point into, by file.
    """

    name: str
    text: str
    findings: tuple[Diagnostic, ...]
    sources: dict[str, str]


def import_script(file: Path, folder: Path, package_paths: Sequence[Path] = ()) -> ImportedSpec:
    """Execute a script, and make a spec of its actions.

    Args:
        file: the script.
        folder: where the spec will be.
        package_paths: further folders with packages that it may import from.

    Raises:
        UnusableFileError: it cannot be executed, or is no such script.
    """
    return _SpecBuilder(file, record(file, "script", package_paths=package_paths), folder).build()


class _SpecBuilder:
    def __init__(self, file: Path, recorded: RecordedFile, folder: Path) -> None:
        self.file = file
        self.recorded = recorded
        root = self._value("benchmark_namespace")
        self.namespace = "/" + str(root).strip("/")
        self.values = SpecValues(recorded, folder, file, self.namespace)
        mode = str(self._value("benchmark_mode")).rpartition(".")[2].lower()
        if mode not in _MODES:
            self._lose_key("benchmark_mode")
        self.mode = mode if mode in _MODES else "looping"
        self.graph = node_roles.divide_by_role(recorded, self.namespace)
        self.inputs = node_roles.played_inputs(self.graph.player)
        plays = self.graph.player is not None or self.mode == "live"
        self.called = [] if plays else recorded.clients
        self.adapted: set[str] = set()

    def build(self) -> ImportedSpec:
        body = Block()
        if self.mode != "live" and not self.called:
            body.add("data_loader", self._data_loader())
        monitors = self._monitors()
        self._add_nodes(body)
        body.add("monitors", monitors)
        body.add("benchmark", self._benchmark([entry.key for entry in monitors.entries]))
        for key in self.recorded.config.keys() - _DEFAULTS.keys():
            what = f"{key!r} is left out: it configures the tool itself, or is unknown to it"
            self.values.change(what, self._place(key))
        self._note_members()
        stem = self.file.stem
        name = stem if re.search(NAME.pattern, stem) else identifier(stem)
        top = self._head(name)
        top.entries += body.entries
        notes = sorted(dict.fromkeys(self.values.notes), key=lambda note: note.place)
        lost = [
            f"  {Path(n.place[0]).name}:{n.place[1]}: {n.reason}"
            for n in notes
            if n.kind != "changed"
        ]
        top.below += ["Not imported:", *dict.fromkeys(lost), ""] if lost else []
        top.below.append(_NO_OBJECTIVES)
        findings = [
            Diagnostic(
                *_CODES[note.kind],
                note.reason,
                span_of(note.place),
                help=_MISSING_HELP if note.kind == "missing" else "",
            )
            for note in notes
        ]
        sources = {file: "\n".join(self.values.lines(file)) for file in self.recorded.files}
        return ImportedSpec(name, document(top, self._header()), tuple(findings), sources)

    def _header(self) -> list[str]:
        header = [f"Imported by r2bspec from {self.file.name}."]
        licences = [line.lstrip("# ") for line in self.values.lines(str(self.file.resolve()))[:40]]
        for part in (
            [x for x in licences if _LICENCE.search(x)],
            [self.recorded.docstring.strip()],
        ):
            header += ["", *part] if any(part) else []
        return header

    def _value(self, key: str) -> Any:
        """Return a key of the configuration, or its default."""
        return self.recorded.config.get(key, _DEFAULTS[key])

    def _number(self, key: str) -> float:
        """Return a number; its default, with a note, for anything else."""
        value = self._value(key)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if is_number and math.isfinite(value):
            return float(value)
        self._lose_key(key)
        return float(_DEFAULTS[key])

    def _place(self, key: str) -> Place:
        """Return the line of a key: the first below the start of the configuration that sets it."""
        file, start = self.recorded.config_place
        sets = re.compile(rf"\s*{re.escape(key)}\s*=")
        lines = enumerate(self.values.lines(file), 1)
        return next(
            ((file, n) for n, line in lines if n >= start and sets.match(line)), (file, start)
        )

    def _comments(self, key: str) -> list[str]:
        """Return the author's comments above a key."""
        return self.values.comments_above(self._place(key)) if key in self.recorded.config else []

    def _lose_key(self, key: str) -> None:
        self.values.lose(f"{key!r} is left out: its value is not understood", self._place(key))

    def _add_nodes(self, body: Block) -> None:
        """Add everything between the recording and the monitors: nodes, steps, and inputs."""
        nodes = NodeWriter(self.values)
        preprocessors, graph, containers = Block(), Block(), Block()
        harness = [*filter(None, [self.graph.player]), *self.graph.monitors]
        kinds = self.recorded.containers
        nodes.add_containers(containers, kinds, self.graph.graph, self.graph.preprocessors, harness)
        nodes.add_all(preprocessors, self.graph.preprocessors, preprocessors=True)
        nodes.add_all(graph, self.graph.graph)
        body.add("preprocessors", preprocessors)
        body.add("containers", containers)
        add_steps(body, self.values)
        body.add("playback", self._playback())
        body.add("graph", Block.of({"nodes": graph}))

    def _head(self, name: str) -> Block:
        top = Block()
        top.add("r2bspec", 1)
        top.add("name", name)
        title = self._value("benchmark_name")
        top.add("title", title if isinstance(title, str) and title.strip() else None)
        top.add("labels", self._labels())
        if self.namespace != _DEFAULT_NAMESPACE:
            top.add("namespace", self.namespace)
        top.add("environment", self.values.environment)
        top.add("variables", self._variables())
        return top

    def _labels(self) -> dict[str, str]:
        key = "custom_report_info"
        given = self._value(key)
        if not isinstance(given, dict):
            self._lose_key(key)
            return {}
        return {identifier(name): self.values.text(str(value)) for name, value in given.items()}

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
        path = self._value(key)
        if not isinstance(path, str) or not path:
            self._lose_key(key)
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
            if self._value(flag) is True
        }
        if recorded and not missing and transforms <= recorded:
            # The synthetic dataset of that name has all that the script loads.
            block.add("bag", dataset, self._comments(key))
        else:
            if recorded:
                self.values.change(
                    f"the synthetic dataset {dataset} has no "
                    f"{', '.join(sorted(missing)) or 'transforms'}: the recording of the script is "
                    "needed, below 'assets_root'",
                    self._place(key),
                )
            full = path if path.startswith("/") else f"$(assets)/{path}"
            block.add("bag", self.values.text(full), self._comments(key))
        window = {
            end: f"{seconds:g} s"
            for end in ("start", "end")
            if (seconds := self._number(f"input_data_{end}_time")) > 0
        }
        block.add("window", window, self._comments("input_data_start_time"))
        block.add("topics", topics)
        for name, source in (
            ("publish_tf", "publish_tf_messages_in_set_data"),
            ("publish_tf_static", "publish_tf_static_messages_in_set_data"),
            ("real_time", "load_data_in_real_time"),
        ):
            if self._value(source) is True:
                block.add(name, True, self._comments(source))
        return block

    def _loaded_topics(self, recorded: set[str]) -> dict[str, str]:
        loader = self.graph.loader
        topics: dict[str, str] = {}
        for source, target in loader.remappings if loader is not None else []:
            name = source.removeprefix(f"{self.namespace}/")
            if name.startswith("/"):
                # It never matches: the loader's own name is in the namespace of the benchmark.
                target = name.lstrip("/")
            topics.setdefault(f"/{name.lstrip('/')}", target)
        read = [
            target
            for member in self.graph.preprocessors
            if isinstance(member, NodeAction)
            for _, target in member.remappings
        ]
        for topic in (*read, *(input_.source for input_ in self.inputs)):
            if f"/{topic}" in recorded:
                # The loader of ros2_benchmark publishes every topic of the recording.
                topics.setdefault(f"/{topic}", topic)
        if not topics and loader is not None:
            self.values.lose("no loaded topic is named in the script", loader.place)
        return topics

    def _playback(self) -> Block:
        block = Block()
        if self.called:
            block.add("calls", self._calls())
            return block
        mode = self.mode
        block.add("mode", mode, self._comments("benchmark_mode"))
        if mode == "live":
            return block
        key = "playback_message_buffer_size"
        block.add("buffer", int(self._number(key)), self._comments(key))
        if self._value("record_data_timeline") is True:
            block.add("record_timeline", True, self._comments("record_data_timeline"))
        if self.graph.player is None:
            self.values.lose("the script has no playback node", self.recorded.config_place)
        inputs = Block()
        for input_ in self.inputs:
            self._add_input(inputs, input_)
        block.add("inputs", inputs)
        return block

    def _calls(self) -> Block:
        """Return the services and actions that the script calls itself.

        What it asks them is its code.
        """
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
        place = each.player.place
        name = formats[each.number] if is_given else None
        kind = self._format(name, place)
        if kind is None:
            self.values.lose(f"the format of input{each.number} is not known", place)
            block.below.append(f"not imported: {each.topic}, whose format is not known")
        else:
            after = f"{name} in the script" if name != kind else ""
            block.add(each.topic, {"from": each.source, "format": kind}, after=after)

    def _format(self, name: Any, place: Place) -> str | None:
        """Return the ROS type of a format; None if it is not known."""
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
            place = node.place
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
            block.add(unique_name(key, used), entry, self.values.comments_above(node.place))
        if not block.entries and not self.called:
            log = {"topic": "/rosout", "format": "rcl_interfaces/msg/Log", "match": "order"}
            block.add("rosout", log, [_NO_MONITOR])
        return block

    def _prefixes(self) -> dict[int, str]:
        """Return the titles of monitors in reports, by the index of the monitor."""
        prefixes: dict[int, str] = {}
        listed = self._value("monitor_info_list")
        for given in listed if isinstance(listed, list) else []:
            service = str(given.get("service_name", given.get("0", "")))
            number = re.fullmatch(r"monitor_node(\d{1,6})", service)
            for calculator in given.get("calculators", given.get("1", [])) if number else []:
                config = calculator.get("config", calculator.get("0", {}))
                if number and isinstance(config, dict) and config.get("report_prefix"):
                    prefixes[int(number[1])] = str(config["report_prefix"])
        return prefixes

    def _benchmark(self, monitors: list[str]) -> Block:
        block, number, comments = Block(), self._number, self._comments
        duration, iterations = number("benchmark_duration"), number("test_iterations")
        block.add("duration", f"{duration:g} s", comments("benchmark_duration"))
        block.add("iterations", int(iterations), comments("test_iterations"))
        if self.called:
            block.add("rates", ["1 Hz"], ["The script calls again when it is answered."])
        if self.called or self.mode in {"timeline", "live"}:
            return block
        lower, upper = number("publisher_lower_frequency"), number("publisher_upper_frequency")
        key = "additional_fixed_publisher_rate_tests"
        extra = self._value(key)
        if not isinstance(extra, list | tuple) or not all(
            isinstance(rate, int | float) and math.isfinite(rate) for rate in extra
        ):
            self._lose_key(key)
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
        for node in self.graph.further:
            self.values.lose(f"{node.name!r} is a second loader or player", node.place)
        for member in self.graph.undecided:
            name = member.name
            self.values.change(
                f"nothing in the script tells whether {name!r} is a preprocessor; it is a node of "
                "the graph here",
                member.place,
            )
