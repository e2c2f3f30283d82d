"""A script of ros2_benchmark, evaluated: its configuration, its actions, and its hooks."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from r2bspec.diagnostics import Diagnostic, Severity, Span
from r2bspec.interop.script_import.evaluator import Evaluator, Note
from r2bspec.interop.script_import.launch_actions import (
    IncludeAction,
    LaunchParts,
    collect_actions,
)
from r2bspec.interop.script_import.script_comments import ScriptComments, read_comments
from r2bspec.interop.script_import.script_limits import ScriptLimitError
from r2bspec.interop.script_import.script_reader import (
    TOO_COMPLEX,
    ScriptReader,
    UnusableScriptError,
)
from r2bspec.interop.script_import.script_values import (
    Construct,
    ForeignMethod,
    ImageSize,
    Instance,
    Place,
    ScriptClass,
    ScriptFunction,
    ScriptModule,
    Unknown,
)

NOT_A_BENCHMARK = "R2B704"

_TEST_CLASS = "ROS2BenchmarkTest"
_CONTEXT = "launch.LaunchContext"


@dataclass(slots=True)
class BenchmarkScript:
    """What a script says.

    Attributes:
        config: the call of ``ROS2BenchmarkConfig``.
        preparation: what it does before the launch, such as building a model.
        hooks: what its hooks do before the benchmark.
        late_hooks: what they do after it.
        sizes: the resolutions at its top level, by name.
        notes: what was not followed.
        texts: the text of every file that places refer to.
    """

    module: ScriptModule
    class_name: str
    config: Construct
    parts: LaunchParts
    preparation: list[Construct]
    hooks: list[Construct]
    late_hooks: list[Construct]
    sizes: dict[str, ImageSize]
    comments: ScriptComments
    notes: list[Note]
    texts: dict[str, str] = field(default_factory=dict)

    @property
    def docstring(self) -> str:
        """The docstring of the file."""
        return ast.get_docstring(self.module.tree) or ""


def read_benchmark_script(file: Path, package_paths: Sequence[Path] = ()) -> BenchmarkScript:
    """Read a script and evaluate what it defines; nothing of it is executed.

    Args:
        file: the script.
        package_paths: folders with packages whose modules and launch files it may name.

    Raises:
        UnusableScriptError: it cannot be read, is no such script, or exceeds the limits.
    """
    reader = ScriptReader(file, package_paths)
    module = reader.read(file)
    try:
        return _ScriptEvaluation(reader, module).benchmark()
    except ScriptLimitError as error:
        message = f"the script needs more than is evaluated: {error}"
        raise _unusable(TOO_COMPLEX, message, module, 1) from error


def is_benchmark_script(text: str) -> bool:
    """Whether a text may be a script of ros2_benchmark."""
    return _TEST_CLASS in text


class _ScriptEvaluation:
    def __init__(self, reader: ScriptReader, module: ScriptModule) -> None:
        self.reader = reader
        self.module = module
        self.evaluator = Evaluator(reader)
        self.notes: list[Note] = []

    def benchmark(self) -> BenchmarkScript:
        self.evaluator.run_module(self.module)
        kind, config = self._test_class()
        place = Place.of(self.module.file, kind.node)
        self.evaluator.trace.effects.clear()
        actions = self._actions(place)
        preparation = list(self.evaluator.trace.effects)
        self.evaluator.trace.effects.clear()
        hooks = self._run_hooks(kind, place, late=False)
        late_hooks = self._run_hooks(kind, place, late=True)
        parts = collect_actions(actions, self._expand)
        return BenchmarkScript(
            module=self.module,
            class_name=kind.node.name,
            config=config,
            parts=parts,
            preparation=preparation,
            hooks=hooks,
            late_hooks=late_hooks,
            sizes=_sizes(self.module),
            comments=read_comments(self.module.text),
            notes=[*self.evaluator.trace.notes, *self.notes],
            texts=self.reader.texts,
        )

    def _test_class(self) -> tuple[ScriptClass, Construct]:
        for each in self.module.scope.names.values():
            if isinstance(each, ScriptClass) and any(
                base.rpartition(".")[2] == _TEST_CLASS for base in each.foreign_bases()
            ):
                config = each.names.get("config")
                if isinstance(config, Construct):
                    return each, config
                message = f"{each.node.name} has no 'config' that is a ROS2BenchmarkConfig"
                raise _unusable(NOT_A_BENCHMARK, message, self.module, each.node.lineno)
        message = f"no class of this file is a {_TEST_CLASS} of ros2_benchmark"
        raise _unusable(NOT_A_BENCHMARK, message, self.module, 1)

    def _actions(self, place: Place) -> list[Any]:
        """The launch actions: those of the function that the description is made from."""
        description = self.module.scope.names.get("generate_test_description")
        if isinstance(description, ScriptFunction):
            # launch_testing may pass a test context as an argument.
            made = self.evaluator.call(description, place=place)
            actions = self._from_description(made, place)
            if actions is not None:
                return actions
        setup = self.module.scope.names.get("launch_setup")
        if isinstance(setup, ScriptFunction):
            return _as_list(self.evaluator.call(setup, *self._setup_arguments(setup), place=place))
        message = "the script has no generate_test_description whose launch actions are known"
        raise _unusable(NOT_A_BENCHMARK, message, self.module, place.line)

    def _from_description(self, made: Any, place: Place) -> list[Any] | None:
        if not isinstance(made, Construct):
            return None
        given = made.get("launch_setup", 0, made.get("nodes", 0))
        if isinstance(given, ScriptFunction):
            arguments = self._setup_arguments(given)
            return _as_list(self.evaluator.call(given, *arguments, place=place))
        return list(given) if isinstance(given, list | tuple) else None

    @staticmethod
    def _setup_arguments(setup: ScriptFunction) -> list[Any]:
        """What ros2_benchmark passes: a prefix and a timeout, and before them a context."""
        number = len(setup.node.args.args)
        place = Place.of(setup.scope.module.file, setup.node)
        context = Construct(_CONTEXT, [], {}, place)
        return [*([context] if number > 2 else []), "", "5"][:number]

    def _run_hooks(self, kind: ScriptClass, place: Place, *, late: bool) -> list[Construct]:
        """What the hooks do, of those before or after the benchmark."""
        instance = Instance(kind)
        self.evaluator.trace.effects.clear()
        for name, each in list(kind.names.items()):
            is_hook = name.endswith("_hook") or "test_" in name
            if isinstance(each, ScriptFunction) and is_hook and name.startswith("post_") is late:
                method = self.evaluator.attribute(instance, name, kind.node, self.module.scope)
                self.evaluator.call(method, place=place)
        return list(self.evaluator.trace.effects)

    def _expand(self, include: IncludeAction, namespace: str) -> list[Any] | None:
        """The actions of an included file that loads nodes into a container of the script."""
        del namespace
        file = self.reader.find_share_file(include.package, include.file)
        if file is None or file.suffix != ".py":
            return None
        try:
            actions, notes = launch_file_actions(self.reader, file, include.arguments)
        except UnusableScriptError as error:
            self.notes.append(Note(error.finding.message, include.source.place))
            return None
        if not any(
            isinstance(each, Construct) and each.short_name == "LoadComposableNodes"
            for each in actions
        ):
            return None
        self.notes += notes
        return actions


def launch_file_actions(
    reader: ScriptReader, file: Path, arguments: Mapping[str, Any]
) -> tuple[list[Any], list[Note]]:
    """The actions of a launch file in Python, with the arguments given and its defaults.

    Raises:
        UnusableScriptError: it cannot be read.
        ScriptLimitError: it exceeds the limits.
    """
    values = dict(arguments)
    for _ in range(2):  # the first time for the defaults of its arguments
        module = reader.read(file)
        evaluator = Evaluator(reader, values)
        evaluator.run_module(module)
        function = module.scope.names.get("generate_launch_description")
        if not isinstance(function, ScriptFunction):
            message = "the launch file has no generate_launch_description"
            raise _unusable(NOT_A_BENCHMARK, message, module, 1)
        place = Place.of(file, function.node)
        made = evaluator.call(function, place=place)
        actions = _without_opaque(evaluator, _initial(made), place)
        for each in actions:
            if isinstance(each, Construct) and each.short_name == "DeclareLaunchArgument":
                name, default = each.get("name", 0), each.get("default_value")
                if isinstance(name, str) and default is not None:
                    values.setdefault(name, default)
    return actions, evaluator.trace.notes


def _initial(made: Any) -> list[Any]:
    if isinstance(made, Construct):
        return _as_list(made.get("initial_entities", 0))
    return _as_list(made)


def _without_opaque(evaluator: Evaluator, actions: list[Any], place: Place) -> list[Any]:
    """Actions with the results of functions that are called at launch in their places."""
    found: list[Any] = []
    for each in actions:
        function = each.get("function", 0) if isinstance(each, Construct) else None
        if isinstance(function, ScriptFunction) and each.short_name == "OpaqueFunction":
            number = len(function.node.args.args)
            context = Construct(_CONTEXT, [], {}, place)
            made = evaluator.call(function, *[context][:number], place=each.place)
            found += _as_list(made)
        else:
            found.append(each)
    return found


def _sizes(module: ScriptModule) -> dict[str, ImageSize]:
    return {name: each for name, each in module.scope.names.items() if isinstance(each, ImageSize)}


def _as_list(value: Any) -> list[Any]:
    if isinstance(value, list | tuple):
        return list(value)
    return [value] if isinstance(value, Construct | Unknown | ForeignMethod) else []


def _unusable(code: str, message: str, module: ScriptModule, line: int) -> UnusableScriptError:
    length = len(module.text.splitlines()[line - 1]) if module.text else 0
    span = Span(str(module.file), line, 1, line, length + 1)
    return UnusableScriptError(Diagnostic(code, Severity.ERROR, message, span))
