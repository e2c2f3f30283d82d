"""Steps around the launch, from what a script and its hooks do for an effect.

Commands, copies and converters of models before the launch are steps of ``setup``, with the file
that they create; loops that wait for a file are conditions of ``ready``; calls of services in hooks
are steps ``after_ready``. A sleep has no form: r2bspec observes what the script waits for.
"""

from __future__ import annotations

import re
from typing import Any, Final

from r2bspec.diagnostics import Span
from r2bspec.interop.script_import.benchmark_script import BenchmarkScript
from r2bspec.interop.script_import.known_functions import is_file_test
from r2bspec.interop.script_import.spec_text import Block, SpecValues, identifier, unique_name
from r2bspec.interop.script_import.values import (
    Construct,
    Foreign,
    NotKnownError,
    Unknown,
    unknown_in,
)

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
_MAX_MESSAGES: Final = 100
"""Messages inside of a request."""
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
        created = next((each.removeprefix(start) for each in options if each.startswith(start)), "")
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
        if self.number > _MAX_MESSAGES:
            # A message may be a part of itself.
            raise NotKnownError(f"the request has more than {_MAX_MESSAGES} messages inside")
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
