"""What launch actions pass on to the actions after them, and groups to what is in them.

Namespaces, remappings, parameters and environment variables are set by actions of their own, in the
order of the file. A group ends what is set inside of it, unless it is not scoped.
"""

from __future__ import annotations

from collections.abc import Mapping
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


_TEXTS: Final = {
    "PushRosNamespace": ("namespace",),
    "PushROSNamespace": ("namespace",),
    "SetRemap": ("src", "dst"),
    "SetParametersFromFile": ("filename",),
    "SetEnvironmentVariable": ("name", "value"),
    "SetROSLogDir": ("new_log_dir",),
    "SetParameter": ("name",),
    "SetUseSimTime": (),
}
"""The actions that change the scope, and their arguments that are texts, by position."""


def changed_scope(action: Construct, scope: Scope, steps: StepCounter) -> Scope | Unknown | None:
    """The scope after an action; None for an action that changes none, or why it is not known."""
    kind = action.short_name
    if kind not in _TEXTS:
        return None
    values = [
        performed(action.get(key, position, "" if key == "namespace" else None), action, steps)
        for position, key in enumerate(_TEXTS[kind])
    ]
    if kind in {"SetParameter", "SetUseSimTime"}:
        values.append(parameter_value(action.get("value", len(values)), action, steps))
    if kind == "SetParametersFromFile" and action.keywords.keys() - {"filename", "condition"}:
        values.append(Unknown("it is for some nodes", action.place))
    unknown = next((value for value in values if isinstance(value, Unknown)), None)
    if unknown is not None:
        return unknown
    match kind, values:
        case "SetRemap", [source, target]:
            node, _, name = source.rpartition(":")
            remapping = Remapping(name, target, action.place, node)
            return replace(scope, remappings=(*scope.remappings, remapping))
        case "SetParameter", [name, value]:
            return replace(scope, parameters=(*scope.parameters, {name: value}))
        case "SetUseSimTime", [value]:
            return replace(scope, parameters=(*scope.parameters, {"use_sim_time": value}))
        case "SetParametersFromFile", [file]:
            return replace(scope, parameters=(*scope.parameters, file))
        case "SetEnvironmentVariable", [name, value]:
            return replace(scope, environment={**scope.environment, name: str(value)})
        case "SetROSLogDir", [folder]:
            return replace(scope, environment={**scope.environment, "ROS_LOG_DIR": str(folder)})
    return replace(scope, namespace=join_namespaces(scope.namespace, str(values[0])))


def join_namespaces(above: str, namespace: str) -> str:
    """A namespace inside of another one."""
    if namespace.startswith("/") or not above:
        return namespace
    return f"{above.rstrip('/')}/{namespace}" if namespace else above
