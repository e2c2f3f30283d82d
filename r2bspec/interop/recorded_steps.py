"""What a script does around the launch, as steps of a spec.

Commands, copies and converters of models before the launch are steps of ``setup``, with the file
that they create; loops that wait for a file are conditions of ``ready``; calls of services in hooks
are steps ``after_ready``. None of it is done in this process. A file outside of the project does
not exist when the script first asks for it, and exists from then on: what the script does about it
is recorded, and what it waits for appears.
"""

from __future__ import annotations

import ast
import builtins
import io
import os
import pathlib
import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, Literal

from r2bspec.interop.launch_texts import perform
from r2bspec.interop.recording import Client, Place, Step
from r2bspec.interop.stand_ins import Recorded, Recording, asks_itself

_CONVERTERS: Final = {
    "TRTConverter": "/usr/src/tensorrt/bin/trtexec",
    "TaoConverter": "/opt/nvidia/tao/tao-converter",
}
"""The programs that the converters of isaac_ros_benchmark call."""
_GENERATOR: Final = ("ESSEngineGenerator", ".onnx", ".engine")
"""A class of isaac_ros_ess that makes a file beside the file that it is given."""
_COPIES: Final = ("copy", "copyfile", "copy2", "copytree")
_PROGRAMS: Final = ("run", "call", "check_call", "check_output", "Popen")
_CLIENTS: Final = frozenset({"create_service_client_blocking", "create_client"})
_SERVICE_TYPE: Final = re.compile(r"(?P<package>\w+)\.srv(?:\._\w+)?\.(?P<name>\w+)\Z")
_NO_EFFECT: Final = frozenset(
    {
        *("info", "warning", "warn", "error", "debug", "log", "write", "flush", "generate"),
        *("wait_for_service", "get_service_response_from_future_blocking", "run_benchmark"),
        *("spin_until_future_complete", "add_action", "add_entity", "set_parameters", "spin_once"),
        *("call", "call_async", "get_logger", "perform", "init", "shutdown"),
    }
)
_SLEEP: Final = (
    "the script waits {} s here; r2bspec waits until all publishers and subscriptions are matched "
    "and warm-up messages have come out ('ready:' adds conditions)"
)


class StepRecorder:
    """Records the steps of a script, and the clients of services and actions that it makes.

    Attributes:
        clients: by kind and name.
        is_late: whether the benchmark is over.
        existing: files without which the script gives up.
        asked: the files that were asked for, and that exist from now on.
    """

    def __init__(self, recording: Recording, existing: Iterable[str]) -> None:
        self.recording = recording
        self.existing = frozenset(existing)
        self.steps: list[Step] = []
        self.clients: dict[tuple[str, str], Client] = {}
        self.is_late = False
        self.asked: set[str] = set()
        self.last: tuple[str, list[Place]] = ("", [])
        recording.on_call = self._called
        recording.answers["run_benchmark"] = self._end
        self._replace()

    def _end(self, *_: Any) -> None:
        self.is_late = True

    def _replace(self) -> None:
        """Replace what Python itself has for effects, for the code of the project."""
        for owner, names, stand_in in (
            (os.path, ("isfile", "exists", "isdir"), self._exists),
            (pathlib.Path, ("is_file", "exists", "is_dir"), self._exists),
            (os, ("makedirs", "mkdir"), self._make_folder),
            (pathlib.Path, ("mkdir",), self._make_folder),
            (shutil, _COPIES, self._copy),
            (subprocess, _PROGRAMS, self._run),
            (os, ("system",), self._shell),
            (os, ("remove", "unlink", "rename"), self._left_out),
            (shutil, ("rmtree", "move"), self._left_out),
            (time, ("sleep",), self._sleep),
            (builtins, ("open",), self._open),
        ):
            for name in names:
                setattr(owner, name, self._guarded(name, getattr(owner, name), stand_in))

    @staticmethod
    def _guarded(
        name: str, real: Callable[..., Any], stand_in: Callable[..., Any]
    ) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            if not asks_itself():
                return real(*args, **kwargs)
            return stand_in(name, real, *args, **kwargs)

        return call

    def _exists(self, _name: str, real: Callable[..., Any], path: Any) -> bool:
        text = os.fspath(path)
        if text in self.asked or text in self.existing:
            return True
        if self.recording.is_own(text) and real(path):
            return True
        self.asked.add(text)
        self.last = (text, list(self.recording.places()))
        return False

    def _open(
        self,
        _name: str,
        real: Callable[..., Any],
        file: Any,
        mode: str = "r",
        *args: Any,
        **kw: Any,
    ) -> Any:
        if set(mode) & set("wax+"):
            self._lose("what is written into a file")
            return io.StringIO()
        if isinstance(file, int) or pathlib.Path(os.fspath(file)).is_file():
            return real(file, mode, *args, **kw)
        return Recorded("open", (file,), called=True)

    def _make_folder(self, _name: str, _real: Any, path: Any, *_: Any, **__: Any) -> None:
        text = os.fspath(path)
        last = "_".join(text.rstrip("/").split("/")[-2:])
        self._add(f"make_{last}", ["mkdir", "-p", text], creates=text)

    def _copy(self, _name: str, _real: Any, src: Any, dst: Any, **_: Any) -> str:
        source, target = str(os.fspath(src)), str(os.fspath(dst))
        self._add(f"copy_{source.rpartition('/')[2]}", ["cp", "-r", source, target])
        return target

    def _run(self, name: str, _real: Any, args: Any, *_: Any, **__: Any) -> Recorded:
        words = ["sh", "-c", args] if isinstance(args, str) else [perform(word) for word in args]
        self._add(words[0].rpartition("/")[2], words)
        return Recorded(f"subprocess.{name}", kwargs={"returncode": 0}, called=True)

    def _shell(self, _name: str, _real: Any, command: Any) -> int:
        self._add("shell", ["sh", "-c", str(command)])
        return 0

    def _left_out(self, name: str, _real: Any, *_: Any, **__: Any) -> None:
        self._lose(f"what {name}() does")

    def _sleep(self, _name: str, _real: Any, seconds: Any) -> None:
        path, places = self.last
        if path and self._is_guarded(places, ast.While):
            self.last = ("", [])
            key = path.rpartition("/")[2].partition(".")[0]
            self.steps.append(Step(kind="ready", key=key, file=path, place=self._place()))
        else:
            self.recording.note("changed", _SLEEP.format(perform(seconds)))

    def _place(self) -> Place:
        return self.recording.place()

    def _lose(self, what: str) -> None:
        self.recording.note("lost", f"{what} is left out")

    def _is_guarded(self, tested: list[Place], kind: type[ast.If | ast.While]) -> bool:
        """Return whether a line that is executed is inside a block that a test has opened."""
        for file, line in self.recording.places():
            for block in _blocks(self.recording.trees[file], kind, line):
                lines = range(block.test.lineno, (block.test.end_lineno or 0) + 1)
                if any(where == file and number in lines for where, number in tested):
                    return True
        return False

    def _add(self, key: str, command: list[str], creates: str = "") -> None:
        path, places = self.last
        start = "--saveEngine="
        saved = [word.removeprefix(start) for word in command if word.startswith(start)]
        if saved:
            creates, key = saved[0], saved[0].rpartition("/")[2].partition(".")[0]
        elif not creates and path and self._is_guarded(places, ast.If):
            creates = path
        if self.is_late:
            self._lose(f"{command[0]}, which runs after the benchmark,")
            return
        place = self._place()
        self.steps.append(
            Step(kind="setup", key=key, command=command, creates=creates, place=place)
        )

    def _called(self, call: Recorded) -> None:
        """Note the call of a stand-in."""
        kind, owner = call._kind, call._owner
        if kind in {"add_action", "add_entity"} and owner is not None and call._args:
            owner._kwargs.setdefault("added", []).append(call._args[0])
        elif kind in _CONVERTERS and isinstance(first := call._get("args", 0), list):
            self._add(kind, [_CONVERTERS[kind], *map(perform, first)])
        elif kind == "generate" and owner is not None and owner._kind == _GENERATOR[0]:
            self._generate(owner)
        elif kind == "ActionClient":
            self._client("action", call, 1)
        elif kind == "create_client":
            self._client("service", call, 0)
        elif kind in {"call", "call_async"} and owner is not None and owner._kind in _CLIENTS:
            self._call_service(call, owner)
        elif kind not in _NO_EFFECT and self._is_statement(kind):
            self._lose(f"what {kind}() does")

    def _is_statement(self, kind: str) -> bool:
        """Return whether the line that is executed is a call for its effect."""
        file, line = self._place()
        tree = self.recording.trees.get(file)
        return tree is not None and any(
            isinstance(node, ast.Expr)
            and node.lineno <= line <= (node.end_lineno or 0)
            and isinstance(node.value, ast.Call)
            and ast.unparse(node.value.func).rpartition(".")[2] == kind
            for node in ast.walk(tree)
        )

    def _generate(self, made: Recorded) -> None:
        name, before, after = _GENERATOR
        words = [repr(value) for value in made._args]
        words += [f"{key}={value!r}" for key, value in made._kwargs.items()]
        module = made._name.rpartition(".")[0]
        program = f"from {module} import {name}; {name}({', '.join(words)}).generate()"
        given = [str(value) for value in (*made._args, *made._kwargs.values())]
        source = next((value for value in given if value.endswith(before)), "")
        file = source.removesuffix(before) + after if source else ""
        key = f"make_{file.rpartition('/')[2].partition('.')[0]}"
        self._add(key, ["python3", "-c", program], file)

    def _client(self, kind: Literal["service", "action"], call: Recorded, position: int) -> None:
        of_type, name = call._get("srv_type", position), call._get("srv_name", position + 1)
        text = of_type._name.replace(".", "/") if isinstance(of_type, Recorded) else ""
        named = name if isinstance(name, str) else ""
        self.clients.setdefault((kind, named), Client(kind, text, named, call._place))

    def _call_service(self, call: Recorded, client: Recorded) -> None:
        if self.is_late:
            self._lose("a service call after the benchmark")
            return
        kind = client._get("srv_type", 0, client._get("service_type"))
        known = _SERVICE_TYPE.search(kind._name) if isinstance(kind, Recorded) else None
        name = client._get("srv_name", 1, client._get("service_name"))
        # The tool resolves names in the namespace of the benchmark, rclpy in that of its own node.
        in_namespace = client._kind == "create_service_client_blocking"
        if known is None or not isinstance(name, str) or not (in_namespace or name[:1] == "/"):
            self._lose("the call of a service whose type or full name is not known")
            return
        service = {"name": name, "type": f"{known['package']}/srv/{known['name']}"}
        if request := message_fields(call._get("request", 0)):
            service["request"] = request
        key, place = name.rpartition("/")[2], client._place
        self.steps.append(Step(kind="after_ready", key=key, place=place, service=service))


def message_fields(message: Any) -> Any:
    """Return the fields of a message that were set; the others have their defaults."""
    if isinstance(message, list | tuple):
        return [message_fields(part) for part in message]
    if not isinstance(message, Recorded):
        is_plain = isinstance(message, bool | int | float | str)
        return message if is_plain else str(message)
    owner = message._owner
    if message._called == (owner is not None and owner._is_instance()):
        return str(message)  # neither a message that is made nor a field of it
    fields = {**message._kwargs, **message._children}
    values = {name: message_fields(value) for name, value in fields.items()}
    return {name: value for name, value in values.items() if value != {}}


def _blocks(tree: ast.Module, kind: type[Any], line: int) -> Iterator[Any]:
    for node in ast.walk(tree):
        if isinstance(node, kind) and node.lineno <= line <= (node.end_lineno or 0):
            yield node
