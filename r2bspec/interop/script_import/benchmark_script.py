"""A script of ros2_benchmark, evaluated: its configuration, its launch actions, and its hooks.

The class derived from ``ROS2BenchmarkTest`` has the configuration, and hooks around the benchmark.
The function that the description is made from returns the launch actions; what it does besides,
such as building a model, prepares them. `Settings` reads the keys of the configuration, each in one
place: its default, its author's comment, and a note where its value is not understood.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.interop.script_import import source_files
from r2bspec.interop.script_import.evaluator import Evaluator
from r2bspec.interop.script_import.launch_actions import collect_actions
from r2bspec.interop.script_import.launch_files import LaunchFile, python_launch_file
from r2bspec.interop.script_import.launch_parts import IncludeAction, LaunchParts
from r2bspec.interop.script_import.values import (
    Construct,
    Foreign,
    ImportNote,
    Method,
    Scope,
    ScriptClass,
    ScriptFunction,
    ScriptLimitError,
    ScriptModule,
    ScriptObject,
    Unknown,
)

_TEST_CLASS: Final = "ROS2BenchmarkTest"
_CONTEXT: Final = "launch.LaunchContext"
_LOADER: Final = "LoadComposableNodes"
_MODES: Final = frozenset({"timeline", "looping", "sweeping", "live"})

_TOOL_KEYS: Final = frozenset(
    {
        *("default_config_version", "option", "assets_root", "ros1_ws"),
        *("log_folder", "log_file_name", "export_monitor_raw_data"),
        *("enable_resource_profiler", "resource_profiling_interval_sec"),
        *("enforce_publisher_rate", "enable_trial_buffer_preparation"),
        *("revise_timestamps_as_message_ids", "collect_start_timestamps_from_monitors"),
        *("setup_service_client_timeout_sec", "start_recording_service_timeout_sec"),
        *("default_service_future_timeout_sec", "set_data_service_future_timeout_sec"),
        "start_recording_service_future_timeout_sec",
        "play_messages_service_future_timeout_sec",
        *("pre_stop_monitoring_wait_time_sec", "pre_trial_run_wait_time_sec"),
        "post_trial_run_wait_time_sec",
        *("binary_search_terminal_interval_width", "binary_search_duration_fraction"),
        "binary_search_acceptable_frame_rate_drop",
        *("linear_scan_step_size", "linear_scan_duration_fraction"),
        "linear_scan_acceptable_frame_loss_fraction",
        "linear_scan_acceptable_frame_rate_drop",
    }
)
"""Keys of the configuration that tune the tool itself: its timeouts, waits, search and files."""
_CLIENTS: Final = {"ActionClient": ("action", 1), "create_client": ("service", 0)}
"""What makes clients: what they call, and at which position the type is, before the name."""

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
class ScriptClient:
    """A client of a service or an action that a script makes.

    Attributes:
        kind: ``action`` or ``service``.
        type: such as ``test_msgs/action/Fibonacci``; empty if it is not known.
        name: of the service or the action; empty if it is not known.
    """

    kind: str
    type: str
    name: str
    place: Span


@dataclass(frozen=True, slots=True)
class ListedMonitor:
    """A monitor in the configuration of a script.

    Attributes:
        index: that its service is named after; None if it is not known.
        prefixes: of its figures in reports, each with the place of its calculator.
    """

    index: int | None
    prefixes: list[tuple[str, Span]]
    place: Span


@dataclass(slots=True)
class BenchmarkScript:
    """What a script says.

    Attributes:
        config: the call of ``ROS2BenchmarkConfig``.
        preparation: what it does before the launch, such as building a model.
        hooks: what its hooks do before the benchmark.
        late_hooks: what they do after it.
        clients: of services and actions that its class makes.
        notes: what was not followed.
        imports: the places of imports, by the name of the module.
        texts: the text of every file that places refer to.
    """

    module: ScriptModule
    config: Construct
    parts: LaunchParts
    preparation: list[Construct]
    hooks: list[Construct]
    late_hooks: list[Construct]
    clients: list[ScriptClient]
    comments: source_files.ScriptComments
    notes: list[ImportNote]
    imports: dict[str, Span]
    texts: dict[str, str]

    @property
    def sends_goals(self) -> bool:
        """Whether it calls actions, and measures that instead of what ros2_benchmark measures."""
        return any(client.kind == "action" for client in self.clients)

    @property
    def docstring(self) -> str:
        """The docstring of the file."""
        return ast.get_docstring(self.module.tree) or ""


@dataclass(slots=True)
class Settings:
    """The keys of the configuration of a script.

    Attributes:
        notes: is extended by what is left out.
        mode: the mode of playing, as a spec names it.
        is_mode_known: whether the script determines it; otherwise `mode` is the default.
        namespace: of the benchmark, absolute.
    """

    script: BenchmarkScript
    notes: list[ImportNote]
    mode: str = field(init=False)
    is_mode_known: bool = field(init=False)
    namespace: str = field(init=False)

    def __post_init__(self) -> None:
        root = self.value("benchmark_namespace")
        namespace = root if isinstance(root, str) else _DEFAULTS["benchmark_namespace"]
        self.namespace = "/" + namespace.strip("/")
        mode = self.value("benchmark_mode")
        name = mode.name.rpartition(".")[2] if isinstance(mode, Foreign) else mode
        self.mode = name.lower() if isinstance(name, str) else ""
        self.is_mode_known = self.mode in _MODES
        if not self.is_mode_known:
            self.lose("benchmark_mode")
            self.mode = "looping"

    def value(self, key: str) -> Any:
        """A keyword argument of the configuration, or its default."""
        return self.script.config.get(key, default=_DEFAULTS[key])

    def number(self, key: str) -> float:
        """A number; its default, with a note, for anything else."""
        value = self.value(key)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if is_number and math.isfinite(value):
            return float(value)
        self.lose(key)
        return float(_DEFAULTS[key])

    def flag(self, key: str) -> bool:
        """Whether a switch is on."""
        return self.value(key) is True

    def lose(self, key: str, value: Any = None) -> None:
        """Note that a key is left out, because of its value or of a part of it."""
        value = self.value(key) if value is None else value
        reason = value.reason if isinstance(value, Unknown) else "its value is not understood"
        place = value.place if isinstance(value, Unknown) else self.script.config.place_of(key)
        self.notes.append(ImportNote(f"{key!r} is left out: {reason}", place))

    def comments(self, key: str) -> list[str]:
        """The author's comments above a key."""
        place = self.script.config.keyword_places.get(key)
        return self.script.comments.at(place) if place is not None else []

    def listed_monitors(self) -> Iterator[ListedMonitor]:
        """The monitors that the configuration lists."""
        infos = self.value("monitor_info_list")
        for info in infos if isinstance(infos, list | tuple) else []:
            is_known = isinstance(info, Construct)
            service = str(info.get("service_name", 0, "monitor_node0")) if is_known else ""
            number = re.fullmatch(r"monitor_node(\d{1,6})", service)
            calculators = info.get("calculators", 1) if is_known else None
            prefixes = [
                (prefix, calculator.place)
                for calculator in (calculators if isinstance(calculators, list | tuple) else [])
                if isinstance(calculator, Construct)
                and isinstance(config := calculator.get("config", 0, {}), dict)
                and isinstance(prefix := config.get("report_prefix", ""), str)
            ]
            place = info.place if is_known else self.script.config.place
            yield ListedMonitor(int(number[1]) if number else None, prefixes, place)

    def note_rest(self) -> None:
        """Note the keys that no part of a spec is made from."""
        config = self.script.config
        for key, value in config.keywords.items():
            if key not in _DEFAULTS and key not in _TOOL_KEYS:
                self.notes.append(ImportNote(f"{key!r} is no known key", config.place_of(key)))
            elif isinstance(value, Unknown) and key in _DEFAULTS:
                self.lose(key)
        if config.get("config_file_path", 0) is not None:
            self.notes.append(ImportNote("the configuration file is not read", config.place))


def read_benchmark_script(file: Path, package_paths: Sequence[Path] = ()) -> BenchmarkScript:
    """Read a script and evaluate what it defines; nothing of it is executed.

    Args:
        file: the script.
        package_paths: folders with packages whose modules and launch files it may name.

    Raises:
        UnusableScriptError: it cannot be read, is no such script, or exceeds the limits.
    """
    reader = source_files.ScriptReader(file, package_paths)
    module = reader.read(file)
    try:
        return _ScriptEvaluation(reader, module).benchmark()
    except ScriptLimitError as error:
        message = f"the script needs more than is evaluated: {error}"
        raise source_files.unusable(message, module, 1, source_files.TOO_COMPLEX) from error


class _ScriptEvaluation:
    def __init__(self, reader: source_files.ScriptReader, module: ScriptModule) -> None:
        self.reader = reader
        self.module = module
        self.evaluator = Evaluator(reader)
        self.notes: list[ImportNote] = []

    def benchmark(self) -> BenchmarkScript:
        self.evaluator.run_module(self.module)
        kind, config = self._test_class()
        self.evaluator.take_effects()
        actions = self._actions(self.module.scope.place(kind.node))
        preparation = self.evaluator.take_effects()
        clients = self._clients(kind)
        # The test of a script that sends goals does that instead of what ros2_benchmark does.
        runs_hooks = all(client.kind != "action" for client in clients)
        hooks = self._run_hooks(kind, late=False) if runs_hooks else []
        late_hooks = self._run_hooks(kind, late=True) if runs_hooks else []
        parts = collect_actions(actions, self._expand, self.reader.steps)
        return BenchmarkScript(
            module=self.module,
            config=config,
            parts=parts,
            preparation=preparation,
            hooks=hooks,
            late_hooks=late_hooks,
            clients=clients,
            comments=source_files.read_comments(self.module.file, self.module.text),
            notes=[*self.evaluator.notes, *self.notes],
            imports=self.evaluator.imports,
            texts=self.reader.texts,
        )

    def _test_class(self) -> tuple[ScriptClass, Construct]:
        for kind in self.module.scope.names.values():
            if isinstance(kind, ScriptClass) and any(
                base.rpartition(".")[2] == _TEST_CLASS for base in kind.foreign_bases()
            ):
                config = kind.find("config")
                if isinstance(config, Construct):
                    return kind, config
                message = f"{kind.node.name} has no 'config' that is a ROS2BenchmarkConfig"
                raise source_files.unusable(message, self.module, kind.node.lineno)
        message = f"no class of this file is a {_TEST_CLASS} of ros2_benchmark"
        raise source_files.unusable(message, self.module, 1)

    def _actions(self, place: Span) -> list[Any]:
        """The launch actions: those of the function that the description is made from."""
        names = self.module.scope.names
        setup, description = names.get("launch_setup"), names.get("generate_test_description")
        if isinstance(description, ScriptFunction):
            # launch_testing may pass a test context as an argument.
            actions = self.evaluator.call(description, place=place)
            given = (
                actions.get("launch_setup", 0, actions.get("nodes", 0))
                if isinstance(actions, Construct)
                else None
            )
            if isinstance(given, list | tuple):
                return list(given)
            setup = given if isinstance(given, ScriptFunction) else setup
        if isinstance(setup, ScriptFunction):
            # ros2_benchmark passes a prefix and a timeout, and before them a context.
            number = len(setup.node.args.args)
            arguments = [*([_context(place)] if number > 2 else []), "", "5"][:number]
            return _as_list(self.evaluator.call(setup, *arguments, place=place))
        message = "the script has no generate_test_description whose launch actions are known"
        raise source_files.unusable(message, self.module, place.line)

    def _run_hooks(self, kind: ScriptClass, *, late: bool) -> list[Construct]:
        """What the hooks do, of those before or after the benchmark."""
        instance = ScriptObject(kind)
        for name, function in list(kind.names.items()):
            is_hook = name.endswith("_hook") or "test_" in name
            if (
                isinstance(function, ScriptFunction)
                and is_hook
                and name.startswith("post_") is late
            ):
                method = self.evaluator.attribute(instance, name)
                self.evaluator.call(method, place=self.module.scope.place(kind.node))
        return self.evaluator.take_effects()

    def _clients(self, kind: ScriptClass) -> list[ScriptClient]:
        """The clients that the class and its bases make, each once."""
        clients = [
            self._client(node, function.scope)
            for base in kind.lineage()
            if isinstance(base, ScriptClass)
            for function in base.names.values()
            if isinstance(function, ScriptFunction)
            for node in ast.walk(function.node)
            if isinstance(node, ast.Call) and _last_name(node.func) in _CLIENTS
        ]
        return [*{(client.kind, client.name): client for client in clients}.values()]

    def _client(self, node: ast.Call, scope: Scope) -> ScriptClient:
        kind, position = _CLIENTS[_last_name(node.func)]
        values = [self.evaluator.value(arg, scope) for arg in node.args[position : position + 2]]
        types = [value.name.replace(".", "/") for value in values[:1] if isinstance(value, Foreign)]
        names = [value for value in values[1:] if isinstance(value, str)]
        return ScriptClient(kind, "".join(types), "".join(names), scope.place(node))

    def _expand(self, include: IncludeAction, _inherited: Mapping[str, Any]) -> LaunchFile | None:
        """What is in an included file that loads nodes into a container of the script."""
        file = self.reader.find_share_file(include.package, include.file)
        if file is None or file.suffix != ".py":
            return None
        try:
            launched = python_launch_file(self.reader, file, include.arguments)
        except source_files.UnusableScriptError as error:
            self.notes.append(ImportNote(error.finding.message, include.source.place))
            return None
        if not launched.has(_LOADER):
            return None
        self.notes += launched.notes
        return launched


def _context(place: Span) -> Construct:
    return Construct(_CONTEXT, [], {}, place)


def _as_list(value: Any) -> list[Any]:
    if isinstance(value, list | tuple):
        return list(value)
    return [value] if isinstance(value, Construct | Unknown | Method) else []


def _last_name(node: ast.expr) -> str:
    """The name of what is called, without that of its module."""
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")
