"""Setup steps and readiness conditions, from what a script does before and after the launch."""

from __future__ import annotations

from typing import Any

from r2bspec.interop.script_import.benchmark_script import BenchmarkScript
from r2bspec.interop.script_import.evaluator import Note
from r2bspec.interop.script_import.foreign_calls import is_file_test
from r2bspec.interop.script_import.script_values import Construct, Unknown, unknown_in
from r2bspec.interop.script_import.spec_values import SpecValues, identifier, unique_name
from r2bspec.interop.script_import.yaml_writer import Block

_CONVERTERS = {
    "TRTConverter()": "/usr/src/tensorrt/bin/trtexec",
    "TaoConverter()": "/opt/nvidia/tao/tao-converter",
}
"""The programs that the converters of isaac_ros_benchmark call."""

_COPIES = frozenset({"shutil.copy", "shutil.copyfile", "shutil.copy2", "shutil.copytree"})
_PROGRAMS = frozenset({"subprocess.run", "subprocess.check_call", "subprocess.check_output"})
_NO_EFFECT = frozenset({"info", "warning", "warn", "error", "debug", "log", "write", "flush"})
_SETUP_TIMEOUT = "30 min"


def add_steps(
    body: Block,
    script: BenchmarkScript,
    values: SpecValues,
    notes: list[Note],
    changes: list[Note],
) -> None:
    """Add ``setup`` and ``ready`` to the keys of a spec.

    Args:
        body: the keys so far.
        script: the script.
        values: converts its values.
        notes: is extended by what has no form in a spec.
        changes: is extended by what the spec says in another way.
    """
    setup, ready = Block(), Block()
    names: set[str] = set()
    for each in (*script.preparation, *script.hooks):
        above = script.comments.at(each.place.line) if each.place.file == script.module.file else []
        if each.name == "wait_for_file":
            _add_wait(ready, each, values, notes, above)
        elif each.name == "time.sleep":
            changes.append(Note(_sleep_text(each), each.place))
        else:
            _add_step(setup, each, values, notes, above, names)
    body.add("setup", setup)
    body.add("ready", ready)


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
    missing = unknown_in(effect.arguments)
    command, creates, name = _command(effect) if missing is None else ([], "", "")
    if not command:
        last = effect.name.rpartition(".")[2]
        if last in _NO_EFFECT or effect.name.startswith(("super", "run_benchmark")):
            return
        reason = missing.reason if isinstance(missing, Unknown) else "it has no form in a spec"
        shown = ".".join(effect.name.split(".")[-2:])
        setup.below.append(f"not imported: {shown} (line {effect.place.line}: {reason})")
        notes.append(Note(f"the call of {shown} is left out: {reason}", effect.place))
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
