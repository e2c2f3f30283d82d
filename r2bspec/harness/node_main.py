"""A Python node: finding its class or function, and calling it.

A callable that takes keyword arguments for `Node` receives namespace, name, remappings and
parameter overrides in this way, as from a launch file. Any other callable is called without
arguments, as by ``ros2 run``: it receives them as the global ROS arguments of its process, which
has no other node. The file of a function is not run as a script, because ``if __name__ ==
"__main__"`` may do something else.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import inspect
import sys
import sysconfig
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from r2bspec.errors import OUTPUT_FOLLOWS, R2bspecError
from r2bspec.plan.command_lines import flow_yaml
from r2bspec.plan.plan import NodePlan
from r2bspec.plan.wiring.python_files import module_of
from r2bspec.plan.wiring.source_interface import KEYWORD_ARGUMENTS


class NodeError(R2bspecError):
    """A node cannot be created; the cause has the details."""

    code = "R2B633"


def raised_text(error: BaseException) -> str:
    """Return an exception with the file and line of the node, and its lines of the traceback.

    The lines follow as the output of a process does (`r2bspec.errors.split_output`).
    """
    paths = sysconfig.get_paths()
    others = {paths[name] for name in ("stdlib", "purelib", "platlib")}
    others |= {str(Path(file).parent) for file in (rclpy.__file__, __file__)}
    frames = traceback.extract_tb(error.__traceback__)
    own = [one for one in frames if not any(map(one.filename.startswith, others))]
    text = f"{type(error).__name__}: {error}"
    if not own:
        return text
    place = f"{Path(own[-1].filename).name}:{own[-1].lineno}"
    lines = "".join((*traceback.format_list(own), *traceback.format_exception_only(error)))
    return f"{text} ({place}){OUTPUT_FOLLOWS}{lines.rstrip()}"


def module_files() -> tuple[str, ...]:
    """Return the files of all modules that are imported.

    A node may have put anything into the table.
    """
    files = (getattr(module, "__file__", None) for module in list(sys.modules.values()))
    return tuple(sorted({str(Path(file).absolute()) for file in files if isinstance(file, str)}))


def set_command_line(plan: NodePlan) -> None:
    """Give this process the command line that ``ros2 run`` would give a program of the node.

    The list object stays the same: a module may have kept it.
    """
    program = plan.target.rpartition(":")[0] or plan.target
    sys.argv[:] = [program, "--ros-args", *ros_arguments(plan)]


def find_factory(target: str, base_dir: Path) -> Any:
    """Return the class or function that ``module.Class`` or ``./file.py:Class`` names.

    Raises:
        NodeError: the module or file cannot be imported, or has no such name.
    """
    path, colon, name = target.rpartition(":")
    if colon:
        module = _import_file((base_dir / path).resolve())
    else:
        module_name, _, name = target.rpartition(".")
        try:
            module = importlib.import_module(module_name)
        except ImportError as error:
            raise NodeError(f"cannot import {module_name!r}: {error}", code="R2B624") from error
    try:
        return getattr(module, name)
    except AttributeError as error:
        raise NodeError(f"{path or module.__name__} has no {name!r}", code="R2B625") from error
    except ImportError as error:
        raise NodeError(f"cannot import {target!r}: {error}", code="R2B624") from error


def _import_file(file: Path) -> Any:
    """Import a file: as a module of its package if it is in one, else as if it were a script."""
    place = module_of(file)
    description = importlib.util.spec_from_file_location(place.name, file)
    if description is None or description.loader is None or not file.is_file():
        raise NodeError(f"{file} is not a Python file", code="R2B624")
    # Other files of its folder can be imported, as if it were run as a script.
    sys.path.insert(0, str(file.parent))
    try:
        if place.package:
            sys.path.insert(0, str(place.folder))
            return _import_module_of(file, place.name)
        module = importlib.util.module_from_spec(description)
        sys.modules[place.name] = module
        description.loader.exec_module(module)
    except NodeError:
        raise
    except Exception as error:
        raise NodeError(f"cannot import {file.name}: {error}", code="R2B624") from error
    return module


def _import_module_of(file: Path, name: str) -> Any:
    module = importlib.import_module(name)
    origin = getattr(module, "__file__", None)
    if origin is None or Path(origin).resolve() != file:
        raise NodeError(
            f"cannot import {file.name}: {name!r} is {origin or 'no file'}; another package of "
            "this name was imported before",
            code="R2B624",
        )
    return module


def takes_keywords(factory: Any) -> bool:
    """Return True if a callable accepts the keyword arguments of `Node`, or may.

    True if that is not known.
    """
    try:
        signature = inspect.signature(factory)
    except (TypeError, ValueError):
        return True
    try:
        signature.bind_partial(**dict.fromkeys(KEYWORD_ARGUMENTS))
    except TypeError:
        return False
    return True


def ros_arguments(plan: NodePlan) -> Iterator[str]:
    """Yield the global ROS arguments of a node, without ``--ros-args``."""
    remappings = (f"{before}:={after}" for before, after in plan.remappings.items())
    for rule in (f"__node:={plan.node}", f"__ns:={plan.namespace}", *remappings):
        yield from ("-r", rule)
    for name, value in plan.parameters.items():
        yield from ("-p", f"{name}:={flow_yaml(value)}")


def make_node(plan: NodePlan, factory: Any) -> Node:
    """Create a node of a plan.

    Args:
        plan: the node.
        factory: from `find_factory`. If it takes no keyword arguments, rclpy has been initialised
            with the `ros_arguments` of the node.

    Raises:
        NodeError: it cannot be created, or does not take the name of the plan.
    """
    make = _with_keywords(plan, factory) if takes_keywords(factory) else factory
    try:
        with _initialised_ros():
            node = make()
    except Exception as error:
        raise NodeError(
            f"node {plan.name} cannot be created: {type(error).__name__}: {error}"
        ) from error
    return checked_node(plan, node)


@contextlib.contextmanager
def _initialised_ros() -> Iterator[None]:
    """Let a constructor initialise ROS, too: with the same arguments, nothing is left to do."""
    initialise = Context.init

    def init(context: Context, args: list[str] | None = None, **options: Any) -> None:
        same = args in (None, sys.argv) and options.get("domain_id") is None
        if not (same and context.ok()):
            initialise(context, args, **options)

    Context.init = init  # type: ignore[assignment,method-assign]
    try:
        yield
    finally:
        Context.init = initialise  # type: ignore[method-assign]


def checked_node(plan: NodePlan, made: object) -> Node:
    """Return the product of a factory, if it is the node of the plan.

    Raises:
        NodeError: it is no node, or has not the name of the plan.
    """
    if not isinstance(made, Node):
        raise NodeError(
            f"node {plan.name} cannot be created: {plan.target} gives a {type(made).__name__}, not "
            "an rclpy node",
            hint="Name a class that inherits from Node, a function that returns the node, or a "
            "main().",
        )
    name = made.get_fully_qualified_name()
    if name != plan.name:
        raise NodeError(
            f"node {plan.name} has the name {name}, because it ignores the arguments that set it",
            hint="Pass the **kwargs of its constructor to Node, and do not set "
            "use_global_arguments.",
        )
    return made


def _with_keywords(plan: NodePlan, factory: Any) -> Callable[[], Any]:
    arguments = ["--ros-args", "-r", f"__node:={plan.node}"]
    for before, after in plan.remappings.items():
        arguments += ["-r", f"{before}:={after}"]
    return lambda: factory(
        namespace=plan.namespace,
        cli_args=arguments,
        use_global_arguments=False,
        parameter_overrides=[
            Parameter(name, value=value) for name, value in plan.parameters.items()
        ],
    )
