"""Setup steps and readiness conditions, from what a script does before and after the launch."""

from __future__ import annotations

from typing import Any

from r2bspec.interop.script_import.benchmark_script import BenchmarkScript
from r2bspec.interop.script_import.evaluator import Note
from r2bspec.interop.script_import.foreign_calls import is_file_test
from r2bspec.interop.script_import.script_values import Construct, Unknown, unknown_in
from r2bspec.interop.script_import.service_calls import is_service_call, service_step
from r2bspec.interop.script_import.spec_values import (
    NoValueError,
    SpecValues,
    identifier,
    unique_name,
)
from r2bspec.interop.script_import.yaml_writer import Block

_CONVERTERS = {
    "TRTConverter()": "/usr/src/tensorrt/bin/trtexec",
    "TaoConverter()": "/opt/nvidia/tao/tao-converter",
}
"""The programs that the converters of isaac_ros_benchmark call."""

_COPIES = frozenset({"shutil.copy", "shutil.copyfile", "shutil.copy2", "shutil.copytree"})
_PROGRAMS = frozenset({"subprocess.run", "subprocess.check_call", "subprocess.check_output"})
_GENERATORS = {"ESSEngineGenerator.generate": (".onnx", ".engine")}
"""Classes of other packages that make a file next to one that they are given."""
_NO_EFFECT = frozenset(
    {
        *("info", "warning", "warn", "error", "debug", "log", "write", "flush"),
        # r2bspec itself waits for the service and its answer.
        *("wait_for_service", "get_service_response_from_future_blocking"),
        "spin_until_future_complete",
    }
)
_SETUP_TIMEOUT = "30 min"


def add_steps(
    body: Block,
    script: BenchmarkScript,
    values: SpecValues,
    notes: list[Note],
    changes: list[Note],
) -> None:
    """Add ``setup``, ``ready`` and ``after_ready`` to the keys of a spec.

    Args:
        body: the keys so far.
        script: the script.
        values: converts its values.
        notes: is extended by what has no form in a spec.
        changes: is extended by what the spec says in another way.
    """
    setup, ready, after_ready = Block(), Block(), Block()
    names: set[str] = set()
    for each in (*script.preparation, *script.hooks):
        above = script.comments.at(each.place.line) if each.place.file == script.module.file else []
        if each.name == "wait_for_file":
            _add_wait(ready, each, values, notes, above)
        elif is_service_call(each):
            client = each.owner.place.line if each.owner is not None else 0
            told = above or script.comments.at(client)
            _add_service_call(after_ready, each, values, notes, told)
        elif each.name == "time.sleep":
            changes.append(Note(_sleep_text(each), each.place))
        else:
            _add_step(setup, each, values, notes, above, names)
    body.add("setup", setup)
    body.add("ready", ready)
    body.add("after_ready", after_ready)
    for each in script.late_hooks:
        if is_service_call(each) or _command(each)[0]:
            _leave_out(setup, each, "it runs after the benchmark", notes)


def _add_service_call(
    after_ready: Block,
    effect: Construct,
    values: SpecValues,
    notes: list[Note],
    above: list[str],
) -> None:
    try:
        service = service_step(effect, values)
    except NoValueError as error:
        _leave_out(after_ready, effect, error.note.message, notes)
        return
    step = Block()
    step.add("service", service)
    used = {each.key for each in after_ready.entries}
    name = identifier(service["name"].rpartition("/")[2])
    after_ready.add(unique_name(name, used), step, above)


def _leave_out(block: Block, effect: Construct, reason: str, notes: list[Note]) -> None:
    shown = ".".join(effect.name.split(".")[-2:])
    block.below.append(f"not imported: {shown} (line {effect.place.line}: {reason})")
    notes.append(Note(f"the call of {shown} is left out: {reason}", effect.place))


def _add_wait(
    ready: Block, effect: Construct, values: SpecValues, notes: list[Note], above: list[str]
) -> None:
    path = effect.arguments[0] if effect.arguments else None
    if not isinstance(path, str):
        notes.append(Note("it waits for a file whose path is not known", effect.place))
        return
    name = identifier(path.rpartition("/")[2].partition(".")[0]) or "file"
    if any(each.value.get("file") == values.text(path) for each in ready.entries):
        return
    used = {each.key for each in ready.entries}
    ready.add(
        unique_name(name, used), {"file": values.text(path), "timeout": _SETUP_TIMEOUT}, above
    )


def _add_step(
    setup: Block,
    effect: Construct,
    values: SpecValues,
    notes: list[Note],
    above: list[str],
    names: set[str],
) -> None:
    given = [effect.owner.arguments, effect.owner.keywords] if effect.owner is not None else []
    missing = unknown_in([effect.arguments, *given])
    command, creates, name = _command(effect) if missing is None else ([], "", "")
    if not command:
        last = effect.name.rpartition(".")[2]
        if last in _NO_EFFECT or effect.name.startswith(("super", "run_benchmark")):
            return
        reason = missing.reason if isinstance(missing, Unknown) else "it has no form in a spec"
        _leave_out(setup, effect, reason, notes)
        return
    step = Block()
    step.add("command", [values.text(each) for each in command])
    created = creates or _created(effect.condition)
    step.add("creates", values.text(created) if created else None)
    if created and command[0] not in {"mkdir", "cp"}:
        step.add("timeout", _SETUP_TIMEOUT)
    setup.add(unique_name(name, names), step, above)


def _command(effect: Construct) -> tuple[list[str], str, str]:
    """The command of an effect, the file that it creates, and a name for the step."""
    for last, suffixes in _GENERATORS.items():
        if effect.name.endswith(f".{last}") and effect.owner is not None:
            return _generator(effect.owner, last.rpartition(".")[2], suffixes)
    first = effect.arguments[0] if effect.arguments else None
    program = _CONVERTERS.get(effect.name.rpartition(".")[2].removesuffix("()") + "()")
    if program and isinstance(first, list) and effect.name.endswith("()"):
        options = [str(each) for each in first]
        return [program, *options], _created_by(options), _step_name(options, "convert_model")
    if effect.name in {"os.makedirs", "os.mkdir"} and isinstance(first, str):
        last = "_".join(first.rstrip("/").split("/")[-2:])
        return ["mkdir", "-p", first], first, f"make_{identifier(last)}"
    if effect.name in _COPIES and isinstance(first, str):
        target = effect.get("dst", 1)
        if isinstance(target, str):
            return ["cp", "-r", first, target], "", "copy_" + identifier(first.rpartition("/")[2])
    if effect.name in _PROGRAMS and isinstance(first, list | tuple) and first:
        words = [str(each) for each in first]
        return words, "", identifier(words[0].rpartition("/")[2])
    return [], "", ""


def _generator(
    made: Construct, method: str, suffixes: tuple[str, str]
) -> tuple[list[str], str, str]:
    """Python with the call of the script, because the command is a matter of the other package."""
    module, _, name = made.name.rpartition(".")
    given = {str(index): each for index, each in enumerate(made.arguments)} | made.keywords
    if not module or not all(isinstance(each, str | int | float) for each in given.values()):
        return [], "", ""
    words = [
        *map(repr, made.arguments),
        *(f"{key}={each!r}" for key, each in made.keywords.items()),
    ]
    program = f"from {module} import {name}; {name}({', '.join(words)}).{method}()"
    source = next((each for each in given.values() if str(each).endswith(suffixes[0])), "")
    file = str(source).removesuffix(suffixes[0]) + suffixes[1] if source else ""
    step = "make_" + identifier(file.rpartition("/")[2].partition(".")[0])
    return ["python3", "-c", program], file, step if file else identifier(name)


def _created_by(options: list[str]) -> str:
    start = "--saveEngine="
    return next((each.removeprefix(start) for each in options if each.startswith(start)), "")


def _step_name(options: list[str], default: str) -> str:
    created = _created_by(options)
    return identifier(created.rpartition("/")[2].partition(".")[0]) if created else default


def _created(condition: Any) -> str:
    """The file that a step makes: its absence is the condition of the step."""
    test = condition.owner if isinstance(condition, Construct) else None
    if isinstance(test, Construct) and is_file_test(test) and test.arguments:
        path = test.arguments[0]
        return path if isinstance(path, str) else ""
    return ""


def _sleep_text(effect: Construct) -> str:
    seconds = effect.arguments[0] if effect.arguments else None
    length = f"{seconds:g} s" if isinstance(seconds, int | float) else "a time"
    return (
        f"the script waits {length} here; r2bspec waits until all publishers and subscriptions "
        "are matched and warm-up messages have come out ('ready:' adds conditions)"
    )
