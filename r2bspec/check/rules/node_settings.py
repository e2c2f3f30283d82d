"""Parameters and remappings of nodes.

What a node declares is known from its interface; what ROS can represent is known without it. ROS
silently ignores a remapping that matches nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import msgspec

from r2bspec.check.check_context import Context
from r2bspec.check.rule import (
    COMPLETE_SOURCES,
    Finding,
    Findings,
    as_version_warning,
    flow_key,
    path_help,
    rule,
    topic_key,
    value_key,
    with_record,
)
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import (
    MAX_SUGGESTIONS,
    clip,
    did_you_mean,
    quote,
    quoted_list,
    suggestion,
)
from r2bspec.language.located_tree import ListNode
from r2bspec.language.spec import ParameterValue
from r2bspec.plan.wiring.name_resolution import NODE_TOPICS, is_node_parameter
from r2bspec.plan.wiring.node_interface import ParameterInfo, ParameterType
from r2bspec.plan.wiring.parameter_files import ParameterFile
from r2bspec.plan.wiring.wiring import NodeWiring


@rule("R2B211")
def parameter_undeclared(context: Context) -> Findings:
    """Find parameters that the node does not declare."""
    for _, node in context.nodes:
        declared = node.interface.parameters
        if declared is None:
            continue
        for override in parameter_overrides(context, node):
            # A parameter file may contain parameters of other nodes, below a name for several.
            is_meant = not override.file or override.of_one
            if override.name in declared or not is_meant or is_node_parameter(override.name):
                continue
            where = f", which {quote(override.file)} sets" if override.file else ""
            finding = Finding(
                message=f"{node.key} declares no parameter {quote(override.name)}{where}",
                path=override.path,
                key=not override.file,
                help=suggestion(override.name, declared, "its parameters"),
            )
            yield _with_source(context, node, finding)


@rule("R2B212")
def parameter_type_mismatch(context: Context) -> Findings:
    """Find parameter values of another type than the node declares."""
    for _, node in context.nodes:
        for override in parameter_overrides(context, node):
            declared = (node.interface.parameters or {}).get(override.name)
            given = parameter_type(override.value)
            if declared is None or given is None or declared.type in {"", given}:
                continue
            finding = _type_finding(node.key, override, given, declared)
            yield _with_source(context, node, finding)


def _with_source(context: Context, node: NodeWiring, finding: Finding) -> Finding:
    """Return the finding, as certain as what is known of the parameters of the node."""
    source = node.interface.parameters_from
    finding = with_record(context, finding, (node, source))
    return as_version_warning(node.interface, finding) if source == "catalogue" else finding


def _type_finding(
    node: str, override: ParameterOverride, given: str, declared: ParameterInfo
) -> Finding:
    path, value = override.path, override.value
    article = "an" if declared.type[0] in "aeiou" else "a"
    also = "an" if given[0] in "aeiou" else "a"
    fixed = f"{value}.0" if given == "integer" and declared.type == "double" else None
    return Finding(
        message=f"parameter {quote(override.name)} of {node} is {article} {declared.type}, but "
        f"{clip(str(value))} is {also} {given}"
        + (f" in {quote(override.file)}" if override.file else ""),
        path=path,
        help=f"write {fixed}; ROS does not convert integers to doubles"
        if fixed
        else f"write {_EXAMPLES[declared.type]}"
        if given == "string" and declared.type in _EXAMPLES
        else "",
        replacement=None if override.file else fixed,
        suppresses={value_key(path)},
    )


_EXAMPLES: Final[Mapping[str, str]] = {
    "integer": "an integer, such as 2",
    "double": "a double, such as 2.0",
    "bool": "true or false",
}


@rule("R2B213")
def parameter_not_representable(context: Context) -> Findings:
    """Find parameter values that ROS parameters cannot represent."""
    for _, node in context.nodes:
        for override in parameter_overrides(context, node):
            problem = _representation_problem(override.value)
            if problem:
                path = override.path
                yield Finding(
                    message=f"parameter {quote(override.name)} of {node.key} {problem[0]}",
                    path=path,
                    help=problem[1],
                    suppresses={value_key(path)},
                )


def _representation_problem(value: ParameterValue) -> tuple[str, str] | None:
    if isinstance(value, list) and not value:
        return "is an empty list, whose type ROS cannot determine", "remove the parameter"
    if parameter_type(value) is None:
        return (
            "is a list of different types, which ROS does not support",
            "make all items integers, doubles (1.0), strings or booleans",
        )
    return None


@rule("R2B614")
def parameter_file_unusable(context: Context) -> Findings:
    """Find parameter files that do not exist or that ROS cannot load."""
    for _, node in context.nodes:
        for path, name, file in parameter_files(context, node):
            problem = file.problem
            advice = "the layout is the node name, 'ros__parameters', then the parameters"
            if file.flat and node.node.kind.name != "plugin":
                problem = "names no node; only a component may have such a file"
                advice = f"write its values here, as a map; or in the file, {advice}"
            if not problem:
                continue
            yield Finding(
                message=f"parameter file {quote(name)} not found"
                if file.missing
                else f"parameter file {quote(name)} {problem}",
                path=path,
                help=path_help(context, name) if file.missing else advice,
                suppresses={value_key(path)},
                suppressed_by={value_key(path)},
            )


@rule("R2B618")
def parameter_file_node_mismatch(context: Context) -> Findings:
    """Find parameter files without parameters of the node."""
    used = {
        name
        for _, node in context.nodes
        for _, name, file in parameter_files(context, node)
        if file.matching(node.name)
    }
    for _, node in context.nodes:
        # A command may contain several nodes with any names.
        for path, name, file in (
            () if node.node.kind.any_program else parameter_files(context, node)
        ):
            keys = [] if file.problem else [key for key, _ in file.nodes]
            if keys and not file.matching(node.name):
                yield Finding(
                    message=f"parameter file {quote(name)} has no parameters of {quote(node.name)}",
                    path=path,
                    help=f"it has parameters of {quoted_list(keys)}; '/**' matches any node, and "
                    "with 'namespace: /' a node has no namespace",
                    severity="warning" if name in used else None,
                )


# bool comes before int, because it is a subclass of int.
_TYPES: tuple[tuple[type, ParameterType, ParameterType], ...] = (
    (bool, "bool", "bool_array"),
    (int, "integer", "integer_array"),
    (float, "double", "double_array"),
    (str, "string", "string_array"),
)


def parameter_type(value: ParameterValue) -> ParameterType | None:
    """Return the ROS type of a value.

    None if it has none, like a list of different types or with a null.
    """
    if not isinstance(value, list):
        return next((name for kind, name, _ in _TYPES if isinstance(value, kind)), None)
    types = {parameter_type(item) if not isinstance(item, list) else None for item in value}
    only = next(iter(types)) if len(types) == 1 else None
    return next((array for _, name, array in _TYPES if name == only), None)


class ParameterOverride(msgspec.Struct, frozen=True):
    """A parameter that the spec or a parameter file sets.

    Attributes:
        path: the value in the spec, or the reference to the parameter file.
        file: the parameter file; empty if the spec sets the parameter.
        of_one: whether the file has it for this node alone.
    """

    name: str
    value: ParameterValue
    path: Path
    file: str = ""
    of_one: bool = False


def parameter_overrides(context: Context, node: NodeWiring) -> Iterator[ParameterOverride]:
    """Yield the effective parameters of a node, each with the place that sets it."""
    is_plugin = node.node.kind.name == "plugin"
    for name, value in node.parameters.items():
        path = context.parameter_path(node, name)
        if path is not None and name in node.node.parameters:
            yield ParameterOverride(name, value, path)
            continue
        for place, file_name, file in parameter_files(context, node):
            if any(name in values for values in file.matching(node.name)):
                of_one = (file.flat and is_plugin) or any(
                    key == node.name and name in values for key, values in file.nodes
                )
                yield ParameterOverride(name, value, place, file_name, of_one)
                break


def parameter_files(
    context: Context, node: NodeWiring
) -> Iterator[tuple[Path, str, ParameterFile]]:
    """Yield the parameter files of a node, each with its path in the spec and its name there."""
    place: Path = (*node.path, "parameters")
    listed = isinstance(context.value_at(place), ListNode)
    for index, source in enumerate(node.node.parameter_sources):
        file = context.companion_files.parameter_files.get(source.file)
        if file is not None:
            yield ((*place, index) if listed else place), source.file, file


_NODE_REMAPPINGS = {"__ns": "namespace", "__node": "", "__name": ""}


@rule("R2B204")
def remapping_unmatched(context: Context) -> Findings:
    """Find remappings that match no topic of their node."""
    count = 0
    for phase, node in context.nodes:
        known = _remappable(node)
        used: dict[str, str] = {}
        for left, right in node.node.remappings.items():
            if left in _NODE_REMAPPINGS:
                yield _node_remapping_finding(phase, node, left)
            elif known is not None and node.names.full(left) not in known:
                count += 1
                used = used or {
                    name: node.names.resolve(name).name for name in node.interface.topics or ()
                }
                close = did_you_mean(left, used) if count <= MAX_SUGGESTIONS else ""
                finding = _unmatched_finding(phase, node, (left, right), close, used)
                interface = node.interface
                sources = (interface.subscribes_from, interface.publishes_from)
                yield with_record(context, finding, *((node, source) for source in sources))


def _remappable(node: NodeWiring) -> frozenset[str] | None:
    """Return the full names that a remapping of a node may have; None if they are not all known."""
    topics = node.interface.topics
    if topics is None or node.node.kind.names_own_nodes or not node.node.remappings:
        return None
    names = (*topics, *node.interface.other_remappable_names)
    return frozenset((*NODE_TOPICS, "/clock", *map(node.names.full, names)))


def _unmatched_finding(
    phase: str, node: NodeWiring, remapping: tuple[str, str], close: str, used: Mapping[str, str]
) -> Finding:
    """Return what is said of a remapping.

    `used` are the topics of the node, by their names in its code.

    Without a close name, any of them may be used instead of the intended one.
    """
    left, right = remapping
    # The spec may state topics only; services are remapped in the same way.
    sources = {node.interface.subscribes_from, node.interface.publishes_from}
    instead = {
        *map(node.names.full, remapping),
        *([used[close]] if close else used.values()),
    }
    finding = Finding(
        message=f"{node.key} has no topic {quote(left)} to remap",
        path=(*node.path, "remappings", left),
        key=True,
        help=_unmatched_help(left, right, close, tuple(used)),
        severity=None if sources <= COMPLETE_SOURCES else "warning",
        suppresses={flow_key(phase), *(topic_key(phase, topic) for topic in instead)},
    )
    return as_version_warning(node.interface, finding) if "catalogue" in sources else finding


def _unmatched_help(left: str, right: str, close: str, own: tuple[str, ...]) -> str:
    if close:
        return f"did you mean {quote(close)}?"
    if right in own:
        turned = quote(f"{right}: {left}")
        return f"the topic name of the node comes first: {turned}"
    return f"its topics: {quoted_list(own)}"


def _node_remapping_finding(phase: str, node: NodeWiring, left: str) -> Finding:
    instead = _NODE_REMAPPINGS[left]
    return Finding(
        message=f"{quote(left)} is not a topic; in ROS it renames the node",
        path=(*node.path, "remappings", left),
        key=True,
        help=f"set {quote(instead)} of the node" if instead else "rename the node's key instead",
        suppresses={flow_key(phase)},
    )
