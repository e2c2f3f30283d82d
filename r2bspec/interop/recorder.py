"""The program of a child process that executes a script or a launch file and records its actions.

It is started by `recording`, with stand-ins for what the file imports of ROS (`stand_ins`), and
writes a `recording.RecordedFile` as JSON.
"""

from __future__ import annotations

import contextlib
import inspect
import json
import os
import signal
import sys
import traceback
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from r2bspec.interop import launch_texts, stand_ins
from r2bspec.interop.launch_texts import CONFIGURATIONS, perform
from r2bspec.interop.recorded_launch import LaunchRecorder
from r2bspec.interop.recorded_steps import StepRecorder
from r2bspec.interop.recording import Failure, RecordedFile
from r2bspec.interop.stand_ins import BenchmarkTest, Recorded, Recording, Size

_HOOK_S: Final = 3.0
"""The time that one hook of a script has: with stand-ins, a loop may have no end."""


class _NotABenchmarkError(Exception):
    """The file is neither a script of ros2_benchmark nor a launch file."""


def main() -> None:
    """Execute a file: ``recorder FILE KIND RESULT ARGUMENTS PACKAGE_PATHS EXISTING_FILES``."""
    file, kind, result = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])
    given, package_paths, existing = map(json.loads, sys.argv[4:7])
    CONFIGURATIONS.update(given)
    recording = stand_ins.start(file, [Path(each) for each in package_paths])
    launch_texts.start()
    steps = StepRecorder(recording, existing)
    try:
        recorded = (_launch_file if kind == "launch" else _script)(recording, steps, file)
    except BaseException as error:
        missed = steps.last[0]
        if missed and not isinstance(error, SyntaxError | _NotABenchmarkError):
            # It gives up where this file is missing: again, with the file.
            words = [*sys.argv[1:6], json.dumps([*existing, missed])]
            command = [*sys.orig_argv[: -len(words)], *words]
            os.execv(sys.executable, command)  # noqa: S606 - it has no shell
        recorded = RecordedFile(error=_failure(recording, error))
    folders = {f"{folder}/": f"$(share {name})/" for folder, name in recording.shares.items()}
    marks = folders | {f"{file.parent}/": "$(script)/"}
    result.write_text(json.dumps(_marked(msgspec.to_builtins(recorded), marks)))


def _marked(value: Any, folders: Mapping[str, str]) -> Any:
    """Return a value in which marks take the place of folders that a spec names in another way.

    Places in files stay.
    """
    if isinstance(value, dict):
        of_files = {"place", "config_place", "files", "shares"}
        return {
            name: item if name in of_files else _marked(item, folders)
            for name, item in value.items()
        }
    if isinstance(value, list | tuple):
        return [_marked(item, folders) for item in value]
    if isinstance(value, str):
        for folder, mark in folders.items():
            value = value.replace(folder, mark)
    return value


def _failure(recording: Recording, error: BaseException) -> Failure:
    """Return the error with the line of the project where it comes from."""
    lines = [
        (frame.filename, frame.lineno or 1)
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename in recording.trees
    ]
    place = lines[-1] if lines else (str(recording.main), 1)
    if isinstance(error, SyntaxError):
        place = (error.filename or place[0], error.lineno or 1)
        return Failure(place, f"invalid Python: {error.msg}", "syntax")
    if isinstance(error, _NotABenchmarkError):
        return Failure(place, str(error), "other")
    message = f"{type(error).__name__}: {error}".split("\n", 1)[0]
    return Failure(place, message, "raised")


def _launch_file(recording: Recording, steps: StepRecorder, file: Path) -> RecordedFile:
    module = recording.execute(file, "launch_file")
    if not hasattr(module, "generate_launch_description"):
        raise _NotABenchmarkError("the file has no generate_launch_description")
    launch = LaunchRecorder(recording)
    launch.perform_all(module.generate_launch_description())
    for step in steps.steps:
        what = f"what {(step.command or ['it'])[0]} does before the launch"
        recording.note("lost", what, step.place)
    return _parts(recording, launch)


def _script(recording: Recording, steps: StepRecorder, file: Path) -> RecordedFile:
    module = recording.execute(file, file.stem)
    kind = next(filter(_is_test, vars(module).values()), None)
    if kind is None:
        raise _NotABenchmarkError("no class of this file is a ROS2BenchmarkTest with a 'config'")
    make = getattr(module, "generate_test_description", None)
    if make is None:
        raise _NotABenchmarkError("the file has no generate_test_description")
    needed = [
        Recorded(name)
        for name, parameter in inspect.signature(make).parameters.items()
        if parameter.default is parameter.empty and parameter.kind <= 1
    ]
    made = make(*needed)
    actions = made[0] if isinstance(made, tuple) else made
    launch = LaunchRecorder(recording)
    launch.perform_all(actions)
    _run_hooks(recording, steps, kind)
    return msgspec.structs.replace(
        _parts(recording, launch),
        docstring=module.__doc__ or "",
        config=_plain(kind.config._kwargs),
        config_place=kind.config._place,
        steps=steps.steps,
        clients=list(steps.clients.values()),
    )


def _is_test(value: Any) -> bool:
    is_class = isinstance(value, type) and issubclass(value, BenchmarkTest)
    return is_class and isinstance(value.config, Recorded)


def _run_hooks(recording: Recording, steps: StepRecorder, kind: type[BenchmarkTest]) -> None:
    """Call what the tool would call around the benchmark, in its order."""
    names = [name for name in dir(kind) if name.endswith("_hook") or name.startswith("test_")]
    names.sort(key=lambda name: (name.startswith("post_"), name.startswith("test_")))
    before = (list(steps.steps), dict(recording.notes))
    test = object.__new__(kind)
    for name in names:
        steps.asked.clear()
        steps.last = ("", [])
        steps.is_late = name.startswith("post_")
        try:
            with _limited():
                getattr(test, name)()
        except Exception as error:
            if not steps.clients:
                failure = _failure(recording, error)
                recording.note("lost", f"the rest of {name}: {failure.message}", failure.place)
    if any(of == "action" for of, _ in steps.clients):
        # The test of such a script sends goals, and does not measure what ros2_benchmark does.
        steps.steps, recording.notes = before


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    def end(*_: object) -> None:
        raise TimeoutError("it does not end")

    signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, _HOOK_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _parts(recording: Recording, launch: LaunchRecorder) -> RecordedFile:
    return RecordedFile(
        nodes=launch.nodes,
        containers=launch.containers,
        includes=launch.includes,
        arguments=launch.arguments,
        notes=list(recording.notes),
        unknown=recording.unknown,
        files=list(recording.trees),
        shares={package: folder for folder, package in recording.shares.items()},
    )


def _plain(value: Any) -> Any:
    """Return a value of a configuration as JSON."""
    if isinstance(value, Size):
        return f"{value.name}, {value['width']}x{value['height']}".removeprefix(", ")
    if isinstance(value, Recorded) and value._called:
        given = {str(number): item for number, item in enumerate(value._args)} | value._kwargs
        return {"call": value._kind} | _plain(given)
    if isinstance(value, Recorded):
        return value._name if value._name.count(".") > 1 else perform(value)
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [_plain(item) for item in value]
    return value if isinstance(value, bool | int | float | str | None) else str(value)


if __name__ == "__main__":
    main()
