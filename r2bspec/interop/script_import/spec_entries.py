"""The entries of a spec that start something, from the actions of a script or a launch file.

A node has the key of its name, if that is free; its values are converted one by one, and a value
without a form in a spec is a comment at its place. Containers are written as far as nodes of the
spec are in them. Preprocessors have one of their own, because they end before anything is measured.

Around the launch are steps, from what a script and its hooks do for an effect. Commands, copies and
converters of models before the launch are steps of ``setup``, with the file that they create; loops
that wait for a file are conditions of ``ready``; calls of services in hooks are steps
``after_ready``. A sleep has no form: r2bspec observes what the script waits for.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.interop.script_import.benchmark_script import BenchmarkScript
from r2bspec.interop.script_import.known_functions import is_file_test
from r2bspec.interop.script_import.launch_parts import (
    ContainerAction,
    IncludeAction,
    Member,
    NodeAction,
    ProcessSettings,
    Remapping,
)
from r2bspec.interop.script_import.spec_text import Block, SpecValues, identifier, unique_name
from r2bspec.interop.script_import.values import (
    Construct,
    Foreign,
    NotKnownError,
    PlacedDict,
    Unknown,
    check_size,
    unknown_in,
)
from r2bspec.language.declaration import NamePattern
from r2bspec.language.names import ENVIRONMENT, NODE_NAME, PARAMETER, TOPIC
from r2bspec.plan.process_plans import HARNESS_PROCESS_NAMES
from r2bspec.safe_io.limits import MAX_REQUEST_MESSAGES, MAX_SCRIPT_NESTING

_PREPROCESSING: Final = "preprocessing"
_DEFAULT_CONTAINER: Final = "component_container_mt"
_HARNESS_OUTSIDE: Final = (
    "In the script, the player and the monitors are in this container, too; here they are not."
)


@dataclass(slots=True)
class NodeWriter:
    """Writes nodes as entries of a spec.

    Attributes:
        keys: the names that are used.
    """

    values: SpecValues
    keys: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.keys |= {*HARNESS_PROCESS_NAMES, "system"}

    def add_all(
        self, block: Block, members: list[Member], *, preprocessors: bool = False
    ) -> list[tuple[NodeAction, Block]]:
        """Add nodes and included launch files to a map of nodes; returns what each node has."""
        nodes = []
        for member in members:
            above = self.values.comments.at(member.source.place)
            if isinstance(member, IncludeAction):
                block.add(self._include_key(member), self._include(member), above)
            else:
                node = self._node(member, _PREPROCESSING if preprocessors else member.container)
                block.add(self._key(member), node, above)
                nodes.append((member, node))
        return nodes

    def add_containers(
        self,
        block: Block,
        kinds: Mapping[str, ContainerAction],
        graph: list[Member],
        preprocessors: list[Member],
        harness: list[NodeAction],
    ) -> None:
        """Add the containers that nodes of the spec use, and reserve the names of the graph's.

        Args:
            block: the map of containers.
            kinds: all containers, by name.
            graph: the nodes of the graph.
            preprocessors: those that run before.
            harness: player and monitors, which are outside of containers here.
        """
        used = {node.container for node in _components(graph)}
        order = list(kinds).index if used <= set(kinds) else None
        for name in sorted(used, key=order):
            shared = any(node.container == name for node in harness)
            above = [_HARNESS_OUTSIDE] if shared else []
            block.add(name, self._container(kinds.get(name)), above)
        for node in _components(preprocessors)[:1]:
            block.add(_PREPROCESSING, self._container(kinds.get(node.container)))
        self.keys |= used
        for name in kinds.keys() - {node.container for node in (*_components(graph), *harness)}:
            if not any(node.container == name for node in _components(preprocessors)):
                what = f"no node is loaded into the container {name!r}, so it is left out"
                self.values.change(what, kinds[name].source.place)

    def _container(self, container: ContainerAction | None) -> dict[str, Any]:
        """The keys of a container; with one that is started elsewhere, those of a usual one."""
        if container is None:
            return {"executable": _DEFAULT_CONTAINER}
        keys: dict[str, Any] = {"executable": container.executable}
        if container.is_multi_threaded:
            keys["executor"] = "multi_threaded"
        if container.threads:
            keys["threads"] = container.threads
        if container.arguments:
            keys["arguments"] = [self.values.text(word) for word in container.arguments]
        return keys | self._process(container.process, container.source.place)

    def _process(self, process: ProcessSettings, place: Span) -> dict[str, Any]:
        """The keys of a process that an action sets."""
        keys: dict[str, Any] = {}
        if process.prefix:
            keys["prefix"] = [self.values.text(word) for word in process.prefix]
        environment = self._map(process.environment, place, [], ENVIRONMENT)
        return keys | ({"env": environment} if environment else {})

    def _key(self, node: NodeAction) -> str:
        key = node.name if re.search(NODE_NAME.pattern, node.name) else identifier(node.name)
        if key in self.keys and node.namespace not in {"", self.values.namespace}:
            key = f"{identifier(node.namespace)}_{key}"
        key = unique_name(key, self.keys)
        if key != node.name:
            self.values.change(
                f"{node.name!r} is the name of another node of the script, too, or no valid "
                f"name of a node: here it is {key!r}, and its private topics (~/) change",
                node.source.place_of("name"),
            )
        return key

    def _include_key(self, include: IncludeAction) -> str:
        stem = include.name
        for end in (".py", ".xml", ".yaml", ".yml", ".launch", ".include"):
            stem = stem.removesuffix(end)
        return unique_name(identifier(stem), self.keys)

    def _node(self, node: NodeAction, container: str) -> Block:
        block = Block()
        if node.command:
            block.add("command", [self.values.text(word) for word in node.command])
        block.add("package", node.package or None)
        block.add("plugin", node.plugin or None)
        block.add("executable", node.executable or None)
        if node.plugin:
            block.add("container", container)
            block.add("intra_process", node.intra_process or None)
            place = node.source.place_of("extra_arguments")
            block.add("extra_arguments", self._map(node.extra_arguments, place, block.below))
        namespace = node.namespace or ("/" if not node.command else self.values.namespace)
        if namespace != self.values.namespace:
            block.add("namespace", namespace)
        if node.arguments and not node.command:
            block.add("arguments", [self.values.text(word) for word in node.arguments])
        block.add("lifecycle", node.lifecycle or None)
        self._parameters(block, node)
        self._remappings(block, node.remappings)
        block.add_all(self._process(node.process, node.source.place))
        return block

    def _include(self, include: IncludeAction) -> Block:
        launch = Block()
        launch.add("package", include.package or None)
        launch.add("file", include.file or None)
        launch.add("path", self.values.text(include.path) if include.path else None)
        place = include.source.place_of("launch_arguments")
        arguments = self._map(include.arguments, place, launch.below)
        texts = {
            key: str(value) if isinstance(value, list | dict) else value
            for key, value in arguments.items()
        }
        launch.add("arguments", texts)
        block = Block()
        block.add("launch", launch)
        if include.namespace and include.namespace != self.values.namespace:
            block.add("namespace", include.namespace)
        self._remappings(block, include.remappings)
        process = ProcessSettings(include.environment)
        block.add_all(self._process(process, include.source.place))
        return block

    def _parameters(self, block: Block, node: NodeAction) -> None:
        place = node.source.place_of("parameters")
        sources: list[Any] = []
        lost: list[str] = []
        for source in node.parameters:
            if isinstance(source, dict):
                check_size(source)
                values = self._map(_flat(source), place, lost)
                sources += [values] if values else []
            elif isinstance(source, str):
                sources.append(self.values.text(source))
            else:
                self._lose("a parameter source", source, place, lost)
        if len(sources) == 1:
            block.add("parameters", sources[0], lost)
        elif sources:
            maps = [Block.of(each) if isinstance(each, dict) else each for each in sources]
            block.add("parameters", maps, lost)
        else:
            block.below += lost

    def _map(
        self,
        values: dict[str, Any],
        place: Span,
        lost: list[str],
        names: NamePattern = PARAMETER,
    ) -> dict[str, Any]:
        """The values of a map that have a form in a spec; `lost` gets comments about the others."""
        converted: dict[str, Any] = {}
        places = values.places if isinstance(values, PlacedDict) else {}
        for key, value in values.items():
            if not re.search(names.pattern, str(key)):
                self._lose(f"{key!r}, which is no {names.noun}", value, place, lost)
                continue
            try:
                converted[key] = self.values.convert(value, places.get(key, place))
            except NotKnownError as error:
                unknown = error.unknown(place)
                lost.append(f"not imported: {key} (line {unknown.place.line}: {unknown.reason})")
                self.values.lose(f"{key!r} is left out: {unknown.reason}", unknown.place)
        return converted

    def _lose(self, what: str, value: Any, place: Span, lost: list[str]) -> None:
        reason = value.reason if isinstance(value, Unknown) else "it has no form in a spec"
        place = value.place if isinstance(value, Unknown) else place
        lost.append(f"not imported: {what} (line {place.line}: {reason})")
        self.values.lose(f"{what} is left out: {reason}", place)

    def _remappings(self, block: Block, remappings: list[Remapping]) -> None:
        targets: dict[str, str] = {}
        for remapping in remappings:
            source, target = remapping.source, remapping.target
            if not all(re.search(TOPIC.pattern, name) for name in (source, target)):
                reason = f"{source!r} to {target!r} is no remapping of topics"
                self.values.lose(reason, remapping.place)
            elif source != target:
                targets.setdefault(source, target)  # ROS applies the first that matches
        block.add("remappings", targets)


def _components(members: list[Member]) -> list[NodeAction]:
    return [member for member in members if isinstance(member, NodeAction) and member.plugin]


def _flat(values: dict[Any, Any], above: str = "") -> dict[str, Any]:
    """Nested parameters with dots in their names."""
    if not above and not any(isinstance(value, dict) for value in values.values()):
        return values
    flat: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{above}{key}"
        if isinstance(value, dict) and value and name.count(".") < MAX_SCRIPT_NESTING:
            flat |= _flat(value, f"{name}.")
        else:
            flat[name] = value
    return flat


_CONVERTERS: Final = {
    "TRTConverter()": "/usr/src/tensorrt/bin/trtexec",
    "TaoConverter()": "/opt/nvidia/tao/tao-converter",
}
"""The programs that the converters of isaac_ros_benchmark call."""
_COPIES: Final = frozenset({"shutil.copy", "shutil.copyfile", "shutil.copy2", "shutil.copytree"})
_PROGRAMS: Final = frozenset({"subprocess.run", "subprocess.check_call", "subprocess.check_output"})
_GENERATORS: Final = {"ESSEngineGenerator.generate": (".onnx", ".engine")}
"""Classes of other packages that make a file next to one that they are given."""
_NO_EFFECT: Final = frozenset(
    {
        *("info", "warning", "warn", "error", "debug", "log", "write", "flush"),
        # r2bspec itself waits for the service and its answer.
        *("wait_for_service", "get_service_response_from_future_blocking"),
        "spin_until_future_complete",
    }
)
_SETUP_TIMEOUT: Final = "30 min"
_CLIENTS: Final = frozenset({"create_service_client_blocking", "create_client"})
_SERVICE_TYPE: Final = re.compile(r"(?P<package>\w+)\.srv(?:\._\w+)?\.(?P<name>\w+)\Z")


def add_steps(body: Block, script: BenchmarkScript, values: SpecValues) -> None:
    """Add ``setup``, ``ready`` and ``after_ready`` to the keys of a spec.

    Args:
        body: the keys so far.
        script: the script.
        values: converts its values, and collects notes.
    """
    steps = _Steps(values)
    for effect in (*script.preparation, *script.hooks):
        steps.add(effect)
    for effect in script.late_hooks:
        if _is_service_call(effect) or _command(effect)[0]:
            steps.leave_out(steps.setup, effect, "it runs after the benchmark")
    body.add("setup", steps.setup)
    body.add("ready", steps.ready)
    body.add("after_ready", steps.after_ready)


class _Steps:
    def __init__(self, values: SpecValues) -> None:
        self.values = values
        self.setup, self.ready, self.after_ready = Block(), Block(), Block()

    def add(self, effect: Construct) -> None:
        above = self.values.comments.at(effect.place)
        if effect.name == "wait_for_file":
            self._add_wait(effect, above)
        elif _is_service_call(effect) and effect.owner is not None:
            self._add_service_call(effect, above or self.values.comments.at(effect.owner.place))
        elif effect.name == "time.sleep":
            seconds = effect.arguments[0] if effect.arguments else None
            length = f"{seconds:g} s" if isinstance(seconds, int | float) else "a time"
            self.values.change(
                f"the script waits {length} here; r2bspec waits until all publishers and "
                "subscriptions are matched and warm-up messages have come out ('ready:' adds "
                "conditions)",
                effect.place,
            )
        else:
            self._add_command(effect, above)

    def leave_out(self, block: Block, effect: Construct, reason: str) -> None:
        shown = ".".join(effect.name.split(".")[-2:])
        block.below.append(f"not imported: {shown} (line {effect.place.line}: {reason})")
        self.values.lose(f"the call of {shown} is left out: {reason}", effect.place)

    @staticmethod
    def _add(block: Block, name: str, step: Any, above: list[str]) -> None:
        block.add(unique_name(name, {entry.key for entry in block.entries}), step, above)

    def _add_wait(self, effect: Construct, above: list[str]) -> None:
        path = effect.arguments[0] if effect.arguments else None
        if not isinstance(path, str):
            self.values.lose("it waits for a file whose path is not known", effect.place)
            return
        file = self.values.text(path)
        if all(entry.value["file"] != file for entry in self.ready.entries):
            name = identifier(path.rpartition("/")[2].partition(".")[0])
            self._add(self.ready, name, {"file": file, "timeout": _SETUP_TIMEOUT}, above)

    def _add_service_call(self, effect: Construct, above: list[str]) -> None:
        try:
            service = _service(effect, self.values)
        except NotKnownError as error:
            self.leave_out(self.after_ready, effect, error.unknown(effect.place).reason)
            return
        step = Block()
        step.add("service", service)
        name = identifier(service["name"].rpartition("/")[2])
        self._add(self.after_ready, name, step, above)

    def _add_command(self, effect: Construct, above: list[str]) -> None:
        given = [effect.owner.arguments, effect.owner.keywords] if effect.owner is not None else []
        missing = unknown_in([effect.arguments, *given])
        command, creates, name = _command(effect) if missing is None else ([], "", "")
        if not command:
            is_silent = effect.name.startswith(("super", "run_benchmark"))
            if effect.short_name not in _NO_EFFECT and not is_silent:
                reason = missing.reason if missing is not None else "it has no form in a spec"
                self.leave_out(self.setup, effect, reason)
            return
        step = Block()
        step.add("command", [self.values.text(word) for word in command])
        created = creates or _created(effect.condition)
        step.add("creates", self.values.text(created) if created else None)
        if created and command[0] not in {"mkdir", "cp"}:
            step.add("timeout", _SETUP_TIMEOUT)
        self._add(self.setup, name, step, above)


def _command(effect: Construct) -> tuple[list[str], str, str]:
    """The command of an effect, the file that it creates, and a name for the step."""
    for last, suffixes in _GENERATORS.items():
        if effect.name.endswith(f".{last}") and effect.owner is not None:
            return _generator(effect.owner, last.rpartition(".")[2], suffixes)
    first = effect.arguments[0] if effect.arguments else None
    program = _CONVERTERS.get(effect.short_name)
    if program and isinstance(first, list):
        options = [str(option) for option in first]
        start = "--saveEngine="
        created = next(
            (option.removeprefix(start) for option in options if option.startswith(start)), ""
        )
        name = identifier(_stem(created)) if created else "convert_model"
        return [program, *options], created, name
    if effect.name in {"os.makedirs", "os.mkdir"} and isinstance(first, str):
        last = "_".join(first.rstrip("/").split("/")[-2:])
        return ["mkdir", "-p", first], first, f"make_{identifier(last)}"
    target = effect.get("dst", 1)
    if effect.name in _COPIES and isinstance(first, str) and isinstance(target, str):
        return ["cp", "-r", first, target], "", "copy_" + identifier(first.rpartition("/")[2])
    if effect.name in _PROGRAMS and isinstance(first, list | tuple) and first:
        words = [str(word) for word in first]
        return words, "", identifier(words[0].rpartition("/")[2])
    return [], "", ""


def _generator(
    made: Construct, method: str, suffixes: tuple[str, str]
) -> tuple[list[str], str, str]:
    """Python with the call of the script, because the command is a matter of the other package."""
    module, _, name = made.name.rpartition(".")
    given = [*made.arguments, *made.keywords.values()]
    if not module or not all(isinstance(value, str | int | float) for value in given):
        return [], "", ""
    words = [
        *map(repr, made.arguments),
        *(f"{key}={value!r}" for key, value in made.keywords.items()),
    ]
    program = f"from {module} import {name}; {name}({', '.join(words)}).{method}()"
    source = next((str(value) for value in given if str(value).endswith(suffixes[0])), "")
    file = source.removesuffix(suffixes[0]) + suffixes[1] if source else ""
    step = f"make_{identifier(_stem(file))}" if file else identifier(name)
    return ["python3", "-c", program], file, step


def _stem(file: str) -> str:
    return file.rpartition("/")[2].partition(".")[0]


def _created(condition: Any) -> str:
    """The file that a step makes: its absence is the condition of the step."""
    test = condition.owner if isinstance(condition, Construct) else None
    path = test.arguments[0] if test is not None and is_file_test(test) and test.arguments else ""
    return path if isinstance(path, str) else ""


def _is_service_call(effect: Construct) -> bool:
    """Whether a construct calls a service through a client that the script has created."""
    is_call = effect.short_name in {"call", "call_async"}
    return is_call and effect.owner is not None and effect.owner.short_name in _CLIENTS


def _service(effect: Construct, values: SpecValues) -> dict[str, Any]:
    """The keys of ``service`` for a call.

    Raises:
        NotKnownError: a part of it is not determined by the script.
    """
    client = effect.owner
    if client is None or effect.condition is not None:
        raise NotKnownError("it depends on a condition")
    kind = client.get("srv_type", 0, client.get("service_type"))
    names = _SERVICE_TYPE.search(kind.name) if isinstance(kind, Foreign) else None
    if names is None:
        raise NotKnownError("the type of the service is not known")
    name = client.get("srv_name", 1, client.get("service_name"))
    # The tool resolves names in the namespace of the benchmark, rclpy in that of its own node.
    in_namespace = client.short_name == "create_service_client_blocking"
    if not isinstance(name, str) or not (in_namespace or name.startswith("/")):
        raise NotKnownError("the full name of the service is not known")
    step = {"name": values.text(name), "type": f"{names['package']}/srv/{names['name']}"}
    request = _Request(values, effect.place).fields(effect.get("request", 0))
    return step | ({"request": request} if request else {})


class _Request:
    """The fields of a message that a script sets; the others have their defaults."""

    def __init__(self, values: SpecValues, place: Span) -> None:
        self.values = values
        self.place = place
        self.number = 0

    def fields(self, message: Any) -> dict[str, Any]:
        self.number += 1
        if self.number > MAX_REQUEST_MESSAGES:
            # A message may be a part of itself.
            raise NotKnownError(f"the request has more than {MAX_REQUEST_MESSAGES} messages inside")
        if isinstance(message, Unknown):
            raise NotKnownError(message)
        if not isinstance(message, Construct) or not message.is_message or message.arguments:
            raise NotKnownError("the request is not known")
        fields = {name: self._value(value) for name, value in message.keywords.items()}
        return {name: value for name, value in fields.items() if value != {}}

    def _value(self, value: Any) -> Any:
        if isinstance(value, Construct):
            return self.fields(value)
        if isinstance(value, list | tuple):
            return [self._value(item) for item in value]
        return self.values.convert(value, self.place)
