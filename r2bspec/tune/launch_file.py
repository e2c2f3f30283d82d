"""A launch file that starts the graph of a plan without r2bspec, as people write such files.

It has the processes of the graph with their nodes, parameters, remappings, environment, CPUs and
priorities: no player, monitors, preprocessors. Python nodes run in a copy of
`r2bspec.harness.deployed_nodes`. Everything from the plan is data in the file: a literal, or a
comment of one line. What a launch file cannot say is in a comment where it belongs.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import r2bspec
from r2bspec.plan.command_lines import (
    CONTAINER_PACKAGE,
    HARNESS_ARGV,
    INCLUDED_LAUNCH,
    parameter_text,
)
from r2bspec.plan.plan import NodePlan, Plan, ProcessPlan
from r2bspec.tune.python_source import (
    WIDTH,
    Call,
    Code,
    comment_lines,
    commented,
    names,
    one_line,
    render,
)

LAUNCH_FILE: Final = "deployment.launch.py"
NODES_FILE: Final = "deployment_nodes.py"

_EXECUTABLE: Final = re.compile(r"\$\(executable (\S+) (\S+)\)")
_SECRET: Final = re.compile(r"\$\((?:quoted_)?env ([A-Za-z_][A-Za-z0-9_]*)\)")
_IMPORTS: Final = {
    "ComposableNode": "launch_ros.descriptions",
    "ComposableNodeContainer": "launch_ros.actions",
    "EnvironmentVariable": "launch.substitutions",
    "ExecutableInPackage": "launch_ros.substitutions",
    "ExecuteProcess": "launch.actions",
    "FindPackageShare": "launch_ros.substitutions",
    "GroupAction": "launch.actions",
    "IncludeLaunchDescription": "launch.actions",
    "LaunchDescription": "launch",
    "AnyLaunchDescriptionSource": "launch.launch_description_sources",
    "Node": "launch_ros.actions",
    "ParameterValue": "launch_ros.parameter_descriptions",
    "PathJoinSubstitution": "launch.substitutions",
    "PushRosNamespace": "launch_ros.actions",
    "SetEnvironmentVariable": "launch.actions",
    "SetRemap": "launch_ros.actions",
}

_STANDARD_IMPORTS: Final = {
    "json.dumps": "import json",
    "sys.executable": "import sys",
    "PYTHON_NODES": "from pathlib import Path",
    "List[str]": "from typing import List",
}


def launch_files(plan: Plan, base_dir: Path, about: Sequence[str] = ()) -> dict[str, str]:
    """The texts of a launch file and of what it needs, by the names of the files.

    Args:
        plan: of the graph.
        base_dir: the folder to which paths in the plan are relative.
        about: sentences for the beginning of the file.
    """
    actions = [action for process in plan.processes for action in _actions(process)]
    measured = plan.states_in("measure")
    states = {name: state for name, state in measured.items() if state != "unconfigured"}
    if states:
        comment = "Configures the lifecycle nodes in this order, then activates them."
        actions.append(commented(_python_program({"states": states}, name="bring_up"), [comment]))
    description = Call("LaunchDescription", (actions,))
    body = render(description, 4)
    used = set(names(description))
    needs_nodes = "PYTHON_NODES" in used
    lines = [
        '"""' + f"The graph {one_line(plan.name)}, to be started without r2bspec.",
        "",
        f"    ros2 launch {LAUNCH_FILE}",
        *(["", *(one_line(sentence) for sentence in about)] if about else []),
        '"""',
        "",
        *_imports(used),
        "",
        "# Paths are relative to the folder of the spec, which is the working directory.",
        f"FOLDER = {str(base_dir.absolute())!r}",
        *([f"PYTHON_NODES = str(Path(__file__).with_name({NODES_FILE!r}))"] if needs_nodes else []),
        *(line for note in _left_out(plan) for line in comment_lines(note, 0)),
        "",
        "",
        "def generate_launch_description():",
        f"    return {body}",
        "",
    ]
    files = {LAUNCH_FILE: "\n".join(lines)}
    if needs_nodes:
        source = Path(r2bspec.__file__).parent / "harness" / "deployed_nodes.py"
        files[NODES_FILE] = source.read_text(encoding="utf-8")
    return files


def _imports(used: set[str]) -> Iterator[str]:
    standard = [line for name, line in _STANDARD_IMPORTS.items() if name in used]
    yield from standard
    if standard:
        yield ""
    for module in sorted({_IMPORTS[name] for name in used & _IMPORTS.keys()}):
        names = sorted(name for name in used & _IMPORTS.keys() if _IMPORTS[name] == module)
        line = f"from {module} import {', '.join(names)}"
        wrapped = [f"    {name}," for name in names]
        yield from [line] if len(line) <= WIDTH else [f"from {module} import (", *wrapped, ")"]


def _actions(process: ProcessPlan) -> Iterator[Call]:
    if process.phase != "measure":
        return
    if process.role == "container":
        yield _container(process)
    elif process.role in {"host", "harness"} and process.nodes:
        yield _host(process)
    elif process.role == "command":
        yield _command(process)


def _container(process: ProcessPlan) -> Call:
    place = next(
        index
        for index, word in enumerate(process.argv)
        if word.startswith(f"$(executable {CONTAINER_PACKAGE} ")
    )
    called = process.argv[place:]
    # The rules of `r2bspec.plan.command_lines` are at its end: of the name, and the namespace.
    end = max(index for index, word in enumerate(called) if word == "--ros-args")
    rules = dict(word.split(":=", 1) for word in called[end:] if ":=" in word)
    parameters = {"thread_num": int(rules["thread_num"])} if "thread_num" in rules else {}
    return Call(
        "ComposableNodeContainer",
        keywords={
            "package": CONTAINER_PACKAGE,
            "executable": _executable(called[0])[1],
            "name": rules["__node"],
            "namespace": rules["__ns"],
            "arguments": _texts(called[1:end]) or None,
            "parameters": [parameters] if parameters else None,
            **_process_keywords(process, process.argv[:place]),
            "composable_node_descriptions": [_component(node) for node in process.nodes],
        },
        comments=tuple(_not_here(process)),
    )


def _component(node: NodePlan) -> Call:
    extra: dict[str, Any] = {}
    if node.intra_process is True:
        extra["use_intra_process_comms"] = True
    if isinstance(node.extra_arguments, dict):
        extra |= node.extra_arguments
    return Call(
        "ComposableNode",
        keywords={
            "package": node.package,
            "plugin": node.plugin,
            **_node_keywords(node),
            "extra_arguments": [_parameters(extra)] if extra else None,
        },
    )


def _node_keywords(node: NodePlan) -> dict[str, Any]:
    return {
        "name": node.node,
        "namespace": node.namespace,
        "parameters": [_parameters(node.parameters)] if node.parameters else None,
        "remappings": list(node.remappings.items()) or None,
    }


def _host(process: ProcessPlan) -> Call:
    nodes = [
        {
            "target": node.target,
            "name": node.node,
            "namespace": node.namespace,
            "remappings": dict(node.remappings),
            "parameters": node.parameters,
        }
        for node in process.nodes
    ]
    wanted = {"executor": process.executor, "threads": process.threads, "nodes": nodes}
    prefix = process.argv[: -len(HARNESS_ARGV)]
    if process.role == "harness":
        prefix = ()
    keywords = {"name": process.name, **_process_keywords(process, prefix)}
    return commented(_python_program(wanted, **keywords), list(_not_here(process)))


def _python_program(wanted: dict[str, Any], **keywords: Any) -> Call:
    words = [Code("sys.executable"), "-P", Code("PYTHON_NODES")]
    return Call(
        "ExecuteProcess",
        keywords={
            "cmd": [*words, Call("json.dumps", (wanted,))],
            "cwd": Code("FOLDER"),
            "output": "screen",
        }
        | keywords,
    )


def _command(process: ProcessPlan) -> Call:
    if INCLUDED_LAUNCH in process.argv:
        return _included(process)
    place = next((i for i, word in enumerate(process.argv) if _EXECUTABLE.fullmatch(word)), None)
    node = process.nodes[0] if process.nodes else None
    if place is not None and node is not None:
        tail = _ros_arguments(node)
        if process.argv[place + 1 :][-len(tail) :] == tail:
            package, executable = _executable(process.argv[place])
            return Call(
                "Node",
                keywords={
                    "package": package,
                    "executable": executable,
                    **_node_keywords(node),
                    "arguments": _texts(process.argv[place + 1 : -len(tail)]) or None,
                    **_process_keywords(process, process.argv[:place]),
                },
                comments=tuple(_not_here(process)),
            )
    return Call(
        "ExecuteProcess",
        keywords={
            "cmd": _texts(process.argv),
            "name": process.name,
            **_process_keywords(process, ()),
        },
        comments=tuple(_not_here(process)),
    )


def _ros_arguments(node: NodePlan) -> tuple[str, ...]:
    """The ROS arguments at the end of the command line of an executable."""
    rules = [f"__node:={node.node}", f"__ns:={node.namespace}"]
    rules += [f"{before}:={after}" for before, after in node.remappings.items()]
    words = [word for rule in rules for word in ("-r", rule)]
    for name, value in node.parameters.items():
        words += ["-p", f"{name}:={parameter_text(value)}"]
    return ("--ros-args", *words)


def _included(process: ProcessPlan) -> Call:
    given = dict(word.split(":=", 1) for word in process.argv if ":=" in word)
    file: Any = given["file"]
    if given.get("package"):
        package = Call("FindPackageShare", (given["package"],))
        file = Call("PathJoinSubstitution", ([package, file],))
    else:
        file = Call("PathJoinSubstitution", ([Code("FOLDER"), file],))
    source = Call("AnyLaunchDescriptionSource", (file,))
    arguments = json.loads(given.get("arguments") or "{}")
    included = Call(
        "IncludeLaunchDescription",
        (source,),
        {"launch_arguments": [(name, _text(value)) for name, value in arguments.items()] or None},
    )
    remappings = json.loads(given.get("remappings") or "{}")
    actions = [
        Call("PushRosNamespace", (given.get("namespace", "/"),)),
        *(Call("SetRemap", rule) for rule in remappings.items()),
        *(Call("SetEnvironmentVariable", (key, _text(to))) for key, to in process.env.items()),
        included,
    ]
    return Call("GroupAction", (actions,))


def _executable(word: str) -> tuple[str, str]:
    found = _EXECUTABLE.fullmatch(word)
    return (found[1], found[2]) if found is not None else ("", word)


def _process_keywords(process: ProcessPlan, prefix: Sequence[str]) -> dict[str, Any]:
    words = [*_scheduling_words(process), *prefix]
    return {
        "prefix": _text(shlex.join(words)) if words else None,
        "additional_env": {name: _text(value) for name, value in process.env.items()} or None,
        "cwd": Code("FOLDER"),
        "output": "screen",
    }


def _scheduling_words(process: ProcessPlan) -> Iterator[str]:
    """The programs that schedule a process before it starts."""
    if process.cpus:
        yield from ("taskset", "-c", ",".join(map(str, process.cpus)))
    if process.nice:
        yield from ("nice", "-n", str(process.nice))
    scheduling = process.scheduling
    if scheduling is not None and scheduling.policy is not None:
        yield from ("chrt", f"--{scheduling.policy}", str(scheduling.priority))


def _not_here(process: ProcessPlan) -> Iterator[str]:
    """What a launch file cannot say of a process."""
    scheduling = process.scheduling
    if process.nice < 0 or (scheduling is not None and scheduling.policy in {"fifo", "rr"}):
        yield "Needs the right to raise its priority: rtprio and nice in limits.conf."
    if scheduling is not None and scheduling.memory_lock:
        yield "Not done here: lock its memory in its code, with mlockall(MCL_CURRENT | MCL_FUTURE)."
    for thread in scheduling.threads if scheduling is not None else ():
        wanted = {
            "policy": thread.policy,
            "priority": thread.priority,
            "nice": thread.nice,
            "cpus": list(thread.cpus),
        }
        settings = ", ".join(f"{name} {value}" for name, value in wanted.items() if value)
        yield (
            f"Not done here: its threads {thread.name}: {settings}; set it in its code, or with "
            "chrt, renice and taskset once they are there."
        )
    if process.memory_limit_bytes:
        yield (
            f"Not done here: the run ended if it took more than {process.memory_limit_bytes} B of "
            "memory; a control group can."
        )


def _left_out(plan: Plan) -> Iterator[str]:
    """What the run did besides starting the processes."""
    if plan.transport != "inherit":
        size = f", segments of {plan.segment_bytes} B" if plan.segment_bytes else ""
        yield (
            f"Measured with 'transport: {plan.transport}'{size}, on one host. Here the middleware "
            "has its own default."
        )
    for external in plan.external:
        if external.phase == "measure":
            yield f"{external.name} has to run already."
    for name, kind in [
        *((step.name, "before the start") for step in plan.setup),
        *((step.name, "when the graph was ready") for step in plan.after_ready),
    ]:
        yield f"Not done here: the step {name}, which the run did {kind}."


def _parameters(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _parameter(value) for name, value in values.items()}


def _parameter(value: Any) -> Any:
    """A parameter; without its type, launch would read the text ``10`` as a number."""
    if isinstance(value, str):
        return Call("ParameterValue", (_text(value),), {"value_type": Code("str")})
    if isinstance(value, list) and value and all(isinstance(item, str) for item in value):
        return Call("ParameterValue", ([*map(_text, value)],), {"value_type": Code("List[str]")})
    return value


def _texts(words: Sequence[str]) -> list[Any]:
    """Words of a command line: programs of packages are looked for when it is started."""
    found = [(word, _EXECUTABLE.fullmatch(word)) for word in words]
    return [
        Code("sys.executable")
        if word == "$(python)"
        else _text(word)
        if executable is None
        else Call(
            "ExecutableInPackage", (), {"package": executable[1], "executable": executable[2]}
        )
        for word, executable in found
    ]


def _text(text: str) -> Any:
    """A text, in which references to secrets are read from the environment."""
    parts: list[Any] = []
    at = 0
    for found in _SECRET.finditer(text):
        parts += [text[at : found.start()], Call("EnvironmentVariable", (found[1],))]
        at = found.end()
    return [part for part in (*parts, text[at:]) if part] if parts else text
