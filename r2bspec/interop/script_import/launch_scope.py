"""What launch actions pass on to the actions after them, and groups to what is in them.

Namespaces, remappings, parameters and environment variables are set by actions of their own, in the
order of the file. A group ends what is set inside of it, unless it is not scoped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

from r2bspec.interop.script_import.launch_parts import Remapping
from r2bspec.interop.script_import.launch_texts import parameter_value, performed
from r2bspec.interop.script_import.values import Construct, StepCounter, Unknown


@dataclass(frozen=True, slots=True)
class Scope:
    """What applies to the next action.

    Attributes:
        namespace: of the groups; empty for none.
        parameters: maps and paths of files, which a node gets before its own.
        arguments: the values of launch arguments, which an included file gets and changes.
    """

    namespace: str = ""
    remappings: tuple[Remapping, ...] = ()
    parameters: tuple[Any, ...] = ()
    environment: dict[str, Any] = field(default_factory=dict)
    arguments: Mapping[str, Any] = field(default_factory=dict)


def changed_scope(action: Construct, scope: Scope, steps: StepCounter) -> Scope | Unknown | None:
    """The scope after an action; None for an action that changes none, or why it is not known."""
    change = _CHANGES.get(action.short_name)
    return None if change is None else change(action, scope, steps)


def join_namespaces(above: str, namespace: str) -> str:
    """A namespace inside of another one."""
    if namespace.startswith("/") or not above:
        return namespace
    return f"{above.rstrip('/')}/{namespace}" if namespace else above


def _namespace(action: Construct, scope: Scope, steps: StepCounter) -> Scope | Unknown:
    name = performed(action.get("namespace", 0, ""), action, steps)
    if isinstance(name, Unknown):
        return name
    return replace(scope, namespace=join_namespaces(scope.namespace, str(name)))


def _first_unknown(*values: object) -> Unknown | None:
    """The first of the values that is not known; None if all are."""
    return next((value for value in values if isinstance(value, Unknown)), None)


def _remapping(action: Construct, scope: Scope, steps: StepCounter) -> Scope | Unknown:
    names = [performed(action.get(key, at), action, steps) for at, key in enumerate(("src", "dst"))]
    if unknown := _first_unknown(*names):
        return unknown
    node, _, source = names[0].rpartition(":")
    remapping = Remapping(source, names[1], action.place, node)
    return replace(scope, remappings=(*scope.remappings, remapping))


def _parameter(action: Construct, scope: Scope, steps: StepCounter) -> Scope | Unknown:
    name = performed(action.get("name", 0), action, steps)
    value = parameter_value(action.get("value", 1), action, steps)
    if unknown := _first_unknown(name, value):
        return unknown
    return replace(scope, parameters=(*scope.parameters, {name: value}))


def _simulated_time(action: Construct, scope: Scope, steps: StepCounter) -> Scope | Unknown:
    value = parameter_value(action.get("value", 0), action, steps)
    if isinstance(value, Unknown):
        return value
    return replace(scope, parameters=(*scope.parameters, {"use_sim_time": value}))


def _parameter_file(action: Construct, scope: Scope, steps: StepCounter) -> Scope | Unknown:
    file = performed(action.get("filename", 0), action, steps)
    others = action.keywords.keys() - {"filename", "condition"}
    if isinstance(file, Unknown) or others:
        return file if isinstance(file, Unknown) else Unknown("it is for some nodes", action.place)
    return replace(scope, parameters=(*scope.parameters, file))


def _variable(action: Construct, scope: Scope, steps: StepCounter) -> Scope | Unknown:
    name = performed(action.get("name", 0), action, steps)
    value = performed(action.get("value", 1), action, steps)
    if unknown := _first_unknown(name, value):
        return unknown
    return replace(scope, environment={**scope.environment, name: str(value)})


def _log_folder(action: Construct, scope: Scope, steps: StepCounter) -> Scope | Unknown:
    folder = performed(action.get("new_log_dir", 0), action, steps)
    if isinstance(folder, Unknown):
        return folder
    return replace(scope, environment={**scope.environment, "ROS_LOG_DIR": str(folder)})


_CHANGES: Final[dict[str, Callable[[Construct, Scope, StepCounter], Scope | Unknown]]] = {
    "PushRosNamespace": _namespace,
    "PushROSNamespace": _namespace,
    "SetRemap": _remapping,
    "SetParameter": _parameter,
    "SetParametersFromFile": _parameter_file,
    "SetUseSimTime": _simulated_time,
    "SetEnvironmentVariable": _variable,
    "SetROSLogDir": _log_folder,
}
