"""Why a node could not be created, from what its container or its process says, at its place.

A container answers with one sentence, and an executable ends with an exception that nothing has
caught. Both contain what rclcpp says of a parameter, so that the same mistake is the same error
whatever the node runs in.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final, Literal

import msgspec

from r2bspec.diagnostics import did_you_mean
from r2bspec.execute.errors import GraphDifferencesError, ProcessDiedError, ProcessFailedError
from r2bspec.plan.installed_packages import ament_packages, package_plugins
from r2bspec.plan.package_advice import ros_package_advice
from r2bspec.plan.plan import NodePlan
from r2bspec.record.run_record import Difference

NOT_LOADED: Final = "R2B665"
NOT_CREATED: Final = "R2B633"

_CONSTRUCTOR = re.compile(r"Component constructor threw an exception(?:: (.*))?", re.DOTALL)
_LIBRARY = re.compile(r"Failed to load library:? ?(.*)", re.DOTALL)
_MISSING_LIBRARY = re.compile(r"(\S+): cannot open shared object file")
_ENTRY = ("Could not find requested resource in ament index", "Invalid resource entry")
_CLASS = "Failed to find class with the requested plugin name"
_EXTRA = re.compile(r"Extra component argument '([^']*)'")

_WRONG_TYPE = re.compile(r"parameter '([^']+)' has invalid type: (.*)", re.DOTALL)
_TYPES = re.compile(r"is of type \{(.+?)\}, setting it to \{(.+?)\} is not allowed")
_WRONG_TYPE_PYTHON = re.compile(
    r"Trying to set parameter '([^']+)' to .* of type '(\w+)', expecting type '(\w+)'", re.DOTALL
)
_REFUSED = re.compile(r"parameter '([^']+)' could not be set: (.*)", re.DOTALL)
_REFUSED_PYTHON = re.compile(
    r"Invalid parameter value \(.*\) for parameter\. Reason: (.*): (\S+)\Z", re.DOTALL
)
_UNSET = re.compile(
    r"(?:Statically typed parameter '([^']+)' must be initialized|"
    r"parameter '([^']+)' is not initialized)"
)
_OUT_OF_RANGE = re.compile(r"doesn't comply with|out of range")

_UNCAUGHT_CPP = re.compile(
    r"terminate called after throwing an instance of '([^']+)'\s+what\(\): +(.*?)\s*\Z", re.DOTALL
)
_PLACE = re.compile(r'^  File "([^"]+)", line (\d+)', re.MULTILINE)
_UNCAUGHT_PYTHON = re.compile(r"^Traceback \(most recent call last\):$", re.MULTILINE)


class Fault(msgspec.Struct, frozen=True):
    """What is wrong: in words, at which part of the node, and what to do."""

    why: str
    part: Literal["node", "plugin", "package", "parameter"] = "node"
    name: str = ""
    help: str = ""


def component_fault(node: NodePlan, reason: str) -> Fault:
    """What the answer of a container says, as rclcpp_components writes it.

    Args:
        node: a component.
        reason: the ``error_message`` of its answer.
    """
    if reason.startswith(_ENTRY):
        return _unknown_package(node.package)
    if (library := _LIBRARY.match(reason)) is not None:
        missing = _MISSING_LIBRARY.search(library[1])
        return Fault(
            f"library {missing[1]} is missing" if missing else f"its library: {library[1]}",
            "plugin",
            help="install the package of that library, and source its workspace"
            if missing
            else "build the package against the libraries that are installed",
        )
    if reason.startswith(_CLASS):
        known = sorted(package_plugins(node.package))
        close = did_you_mean(node.plugin, known)
        return Fault(
            f"package {node.package} has no component {node.plugin!r}",
            "plugin",
            help=f"did you mean {close!r}?" if close else f"its components: {', '.join(known)}",
        )
    if (extra := _EXTRA.match(reason)) is not None:
        return Fault(reason, "node", extra[1], help="correct 'extra_arguments'")
    if (constructor := _CONSTRUCTOR.match(reason)) is not None:
        what = constructor[1] or ""
        return exception_fault(what, "its constructor threw an exception")
    return Fault(reason or "the container gave no reason", help="read the output of the container")


def _unknown_package(package: str) -> Fault:
    if package in ament_packages():
        return Fault(f"package {package} has no components", "package", help="write 'executable'")
    why = f"package {package} is not installed"
    return Fault(why, "package", help=ros_package_advice(package))


def exception_fault(what: str, otherwise: str) -> Fault:
    """What the text of an exception in a constructor says.

    Args:
        what: the text.
        otherwise: what to say before it, if it is not about a parameter.
    """
    if (wrong := _WRONG_TYPE.search(what)) is not None:
        types = _TYPES.search(wrong[2])
        return _wrong_type(wrong[1], *types.groups()) if types else _refused(wrong[1], wrong[2])
    if (wrong := _WRONG_TYPE_PYTHON.search(what)) is not None:
        return _wrong_type(wrong[1], wrong[3].lower(), wrong[2].lower())
    if (unset := _UNSET.search(what)) is not None:
        name = unset[1] or unset[2]
        return Fault(
            f"parameter {name!r} is required, and is not set",
            "parameter",
            name,
            f"set {name!r} under 'parameters'",
        )
    if (refused := _REFUSED.search(what)) is not None:
        return _refused(refused[1], refused[2])
    if (refused := _REFUSED_PYTHON.search(what)) is not None:
        return _refused(refused[2], refused[1])
    return Fault(f"{otherwise}: {what.strip()}" if what.strip() else otherwise)


def _wrong_type(name: str, declared: str, given: str) -> Fault:
    return Fault(
        f"parameter {name!r} is of type {declared}, and cannot be of type {given}",
        "parameter",
        name,
        "write 1.0 for a double: ROS does not convert integers"
        if (declared, given) == ("double", "integer")
        else "write a value of its type",
    )


def _refused(name: str, reason: str) -> Fault:
    if _OUT_OF_RANGE.search(reason):
        why = f"parameter {name!r} is out of its range"
        return Fault(why, "parameter", name, "'ros2 param describe' shows the range")
    return Fault(f"parameter {name!r} was refused: {reason.strip()}", "parameter", name)


def not_loaded(node: NodePlan, container: str, reason: str, output: str) -> GraphDifferencesError:
    """The error for a component that its container has refused.

    Args:
        node: the component.
        container: the name of the container's process.
        reason: what the container answered.
        output: the last output of the container, as the end of a sentence.
    """
    fault = component_fault(node, reason)
    message = f"{node.name} ({node.plugin}) was not loaded into container {container}: {fault.why}"
    return _error(NOT_LOADED, node, fault, message, output)


def not_created(died: ProcessDiedError, nodes: Iterable[NodePlan]) -> GraphDifferencesError | None:
    """The error for a process that an exception has ended before its node was complete.

    None if it ended for another reason, or has several nodes.

    Args:
        died: the process, with its output.
        nodes: of the process.
    """
    only = [*nodes]
    if len(only) != 1:
        return None
    uncaught = _UNCAUGHT_CPP.search(died.output)
    if uncaught is not None:
        fault = exception_fault(uncaught[2], f"it threw {uncaught[1]}")
    elif _UNCAUGHT_PYTHON.search(died.output):
        file, line = [("", ""), *_PLACE.findall(died.output)][-1]
        what = died.output.rstrip().splitlines()[-1]
        fault = Fault(f"it raised {what} ({file.rpartition('/')[2]}, line {line})")
    else:
        return None
    message = f"node {only[0].name} cannot be created: {fault.why}"
    return _error(NOT_CREATED, only[0], fault, message, "" if uncaught is None else str(died))


def not_made(failed: ProcessFailedError, nodes: Iterable[NodePlan]) -> GraphDifferencesError | None:
    """The error for a Python node whose host says that it could not be created; else None.

    Args:
        failed: what the host says.
        nodes: of its process.
    """
    begins = {f"node {node.name} cannot be created: ": node for node in nodes}
    for begin, node in begins.items():
        _, found, what = str(failed).partition(begin)
        if found and failed.code == NOT_CREATED:
            fault = exception_fault(what, "")
            fault = msgspec.structs.replace(fault, help=fault.help or failed.hint)
            message = f"node {node.name} cannot be created: {fault.why.removeprefix(': ')}"
            return _error(NOT_CREATED, node, fault, message, "")
    return None


def _error(
    code: str, node: NodePlan, fault: Fault, message: str, output: str
) -> GraphDifferencesError:
    difference = Difference(
        code=code,
        message=message,
        part=fault.part,
        owner=node.name,
        name=fault.name,
        help=fault.help,
    )
    return GraphDifferencesError([difference], details=output)
