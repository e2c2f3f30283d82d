"""The programs that a launch file starts, if its text alone says all of them.

Nothing is evaluated: an include, a function that is called at launch, or a name that is no literal
makes them unknown.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from r2bspec.plan.wiring.python_files import read_python_file
from r2bspec.plan.wiring.python_source import SourceNames
from r2bspec.safe_io.limits import MAX_SCRIPT_BYTES
from r2bspec.safe_io.safe_file import read_text

_PYTHON_NODES: Final = ("Node", "LifecycleNode", "ComposableNodeContainer")
_CLASSES: Final = frozenset(f"launch_ros.actions.{name}" for name in _PYTHON_NODES)
_NODES: Final = frozenset({*_PYTHON_NODES, "node", "node_container"})
_OPAQUE: Final = frozenset(
    {
        *("ExecuteLocal", "ExecuteProcess", "IncludeLaunchDescription", "OpaqueFunction"),
        *("executable", "include"),
    }
)
"""Actions and entities behind which there may be any program."""
_CONDITIONS: Final = frozenset({"condition", "if", "unless"})
_MODULES: Final = frozenset(
    {"__future__", "ament_index_python", "launch", "launch_ros", "os", "pathlib", "sys", "typing"}
)
"""What a launch file in Python may import without a program being hidden there."""

_Attributes = Mapping[str, Any]


class LaunchProgram(NamedTuple):
    """A program of a launch file; `name` is that of its node, empty where that names itself."""

    executable: str
    name: str

    @property
    def label(self) -> str:
        """The name that tells it best."""
        return self.name or self.executable


class LaunchPrograms(NamedTuple):
    """The programs of a launch file, in order, and whether it may leave some of them out."""

    programs: tuple[LaunchProgram, ...]
    has_conditions: bool


def launch_programs(file: Path, folder: Path) -> LaunchPrograms | None:
    """The programs of a launch file; None if its text does not say them.

    Args:
        file: in Python, XML or YAML.
        folder: where it must be.
    """
    try:
        entities = list((_python if file.suffix == ".py" else _markup)(file, folder))
        programs = tuple(_program(each) for name, each in entities if name in _NODES)
    except (OSError, ValueError, RecursionError):
        return None
    return LaunchPrograms(programs, any(_CONDITIONS & each.keys() for _, each in entities))


def _program(attributes: _Attributes) -> LaunchProgram:
    executable = attributes.get("executable", attributes.get("exec"))
    name = attributes.get("name", "")
    is_text = isinstance(executable, str) and isinstance(name, str) and "**" not in attributes
    if not is_text or "$(" in executable + name:
        raise ValueError("a name that is no literal")
    if any("__n" in str(each) for each in attributes.values()):
        raise ValueError("an argument that may rename it")
    return LaunchProgram(executable.rpartition("/")[2], name)


def _refuse(found: Iterable[str]) -> None:
    for name in found:
        raise ValueError(name)


def _python(file: Path, folder: Path) -> Iterator[tuple[str, _Attributes]]:
    """The calls of a file, and their keyword arguments where these are literals."""
    tree = read_python_file(file, folder)
    if tree is None:
        raise ValueError("no Python")
    names = SourceNames(tree)
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=imported):
                _refuse({each.name.partition(".")[0] for each in imported} - _MODULES)
            case ast.ImportFrom(module=module):
                _refuse({(module or "").partition(".")[0]} - _MODULES)
            case ast.Name(id=written) | ast.Attribute(attr=written):
                full = names.full_name(node)
                _refuse({written, full.rpartition(".")[2]} & _OPAQUE)
                if (full in _CLASSES) != (written in _NODES) or (
                    full in _CLASSES and id(node) not in called
                ):
                    raise ValueError("a node may be made in another way")
            case ast.Call(func=ast.Name(id=written) | ast.Attribute(attr=written), keywords=given):
                yield written, {each.arg or "**": _literal(each.value) for each in given}


def _literal(node: ast.expr) -> object:
    """A literal; of a list, its text."""
    return node.value if isinstance(node, ast.Constant) else [ast.unparse(node)]


def _markup(file: Path, folder: Path) -> Sequence[tuple[str, _Attributes]]:
    """The entities of a file, and their attributes."""
    from r2bspec.plan.launch_markup import read_markup

    text = read_text(file, max_bytes=MAX_SCRIPT_BYTES, folders=(folder,))
    entities = [(each.name, each.values) for each in read_markup(text, file).below()]
    _refuse({name for name, _ in entities} & _OPAQUE)
    return entities
