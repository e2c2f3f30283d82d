"""What a spec may do on a host: an allow-list, because a deny-list is never complete.

Without a permission of its owner, a host starts programs of r2bspec, executables, components,
Python classes and launch files of ROS packages that are installed there, each by the command line
that r2bspec itself writes: with names, remappings and parameters, and without arguments of the
spec, because what a program does with those nobody knows (a file to load, a prefix to start).
Other Python is not allowed, even if it is installed: ``pytest.main`` runs what lies in its folder.
Processes get variables of `_VARIABLES` only: any other one may name code, such as ``LD_PRELOAD``,
``HOME`` (a user site) or ``OPENSSL_CONF`` (an engine). Whatever is not on these lists needs
``--allow-commands`` or, for Python and launch files that a spec brings along, ``--allow-python``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from r2bspec.fleet.errors import NotAllowedError
from r2bspec.plan.command_lines import INCLUDED_LAUNCH, THREADED_CONTAINER, is_own_program
from r2bspec.plan.installed_packages import ament_packages
from r2bspec.plan.plan import Plan, ProcessPlan

COMMANDS: Final = "commands"
PYTHON: Final = "python"

_VARIABLES: Final = frozenset(
    (
        *("OMP_NUM_THREADS", "OMP_PROC_BIND", "OMP_PLACES", "OMP_SCHEDULE", "OMP_DYNAMIC"),
        *("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "TBB_NUM_THREADS"),
        *("CUDA_VISIBLE_DEVICES", "CUDA_LAUNCH_BLOCKING", "NVIDIA_VISIBLE_DEVICES"),
        *("OPENCV_FOR_THREADS_NUM", "MALLOC_ARENA_MAX"),
        *("RCUTILS_COLORIZED_OUTPUT", "RCUTILS_LOGGING_USE_STDOUT"),
        *("RCUTILS_LOGGING_BUFFERED_STREAM", "RCUTILS_CONSOLE_OUTPUT_FORMAT"),
    )
)
"""None of them names a file, a program or a plugin."""

_LOADED_UNASKED: Final = frozenset(
    (
        *("DEFAULT_FASTRTPS_PROFILES.xml", "DEFAULT_FASTDDS_PROFILES.xml"),
        *("USER_QOS_PROFILES.xml", "matplotlibrc"),
    )
)
"""What middleware and libraries read from the working directory, which is that of the spec: logs
that are written anywhere, and plugins."""

_PACKAGE: Final = re.compile(r"[A-Za-z0-9_][\w-]*")
_EXECUTABLE: Final = re.compile(rf"\$\(executable {_PACKAGE.pattern} (?!\.\.?\))[^/\s)]+\)")
_MODULE: Final = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+")
_LAUNCH_NAMES: Final = ("namespace", "remappings", "arguments")
_LOAD_NODE: Final = "composition_interfaces/srv/LoadNode"
_OWN_NODES: Final = "r2bspec.nodes."


def check_allowed(
    plan: Plan,
    allows: Sequence[str],
    host: str,
    environments: Sequence[str] = (),
    files: Iterable[str] = (),
) -> None:
    """See that a host may run a plan.

    Args:
        plan: of a benchmark.
        allows: the permissions of the owner of the host.
        host: its name.
        environments: setup files and variables of the base of a comparison.
        files: the paths of what the spec brings along.

    Raises:
        NotAllowedError: it may not.
    """
    needs = [*_needs(plan), *((COMMANDS, f"the environment {text!r}") for text in environments)]
    needs += ((COMMANDS, f"with {path!r}") for path in files if Path(path).name in _LOADED_UNASKED)
    for permission, what in sorted(needs):
        if permission not in allows:
            raise NotAllowedError(
                f"the host {host} may not run {what}, because its worker was started without "
                f"--allow-{permission}",
                hint="Its owner decides: what a spec brings along can do there whatever the "
                "user of the worker can.",
            )


def _needs(plan: Plan) -> Iterator[tuple[str, str]]:
    """The permissions that a plan needs, each with what needs it."""
    for process in plan.processes:
        yield from _needs_of_process(process)
    for setup in plan.setup:
        yield COMMANDS, f"the setup command {setup.name!r}"
    for step in plan.after_ready:
        if step.argv:
            yield COMMANDS, f"the command {step.argv[0]!r}"
        if step.service_type == _LOAD_NODE:
            yield COMMANDS, f"the call of {step.service!r}, which loads a library"


def _needs_of_process(process: ProcessPlan) -> Iterator[tuple[str, str]]:
    argv = process.argv
    if (launched := _launch_place(argv)) is not None:
        if not _is_installed_launch(launched):
            yield PYTHON, f"the launch file {launched[-1].removeprefix('file:=')!r}"
        if argv[-1] != _NO_LAUNCH_ARGUMENTS:
            yield COMMANDS, f"the launch file {launched[-1].removeprefix('file:=')!r} {_ARGUMENTS}"
    elif argv and _EXECUTABLE.fullmatch(argv[0]):
        if not _are_names_and_parameters(argv[1:]):
            yield COMMANDS, f"{argv[0]!r} {_ARGUMENTS}"
    elif not is_own_program(argv):
        yield COMMANDS, f"the command {argv[0] if argv else ''!r}"
    for name in sorted(set(process.env) - _VARIABLES):
        yield COMMANDS, f"a process with the variable {name} of the spec"
    for node in process.nodes:
        if node.package and not _PACKAGE.fullmatch(node.package):
            yield COMMANDS, f"a component of {node.package!r}"
    for target in (node.target for node in process.nodes if node.target):
        if ":" in target:
            yield PYTHON, f"the Python file {target.rpartition(':')[0]!r}"
        elif not _is_installed_class(target):
            yield PYTHON, f"{target!r}, which is not of a ROS package that is installed there"


_ARGUMENTS: Final = "with arguments of the spec"
_NO_LAUNCH_ARGUMENTS: Final = "arguments:={}"


def _are_names_and_parameters(words: Sequence[str]) -> bool:
    """Whether what follows a program on its command line is what r2bspec gives every node."""
    own = tuple(words[words[:1] == (THREADED_CONTAINER,) :])
    return not own or (own[0] == "--ros-args" and {*own[1::2]} <= {"-r", "-p"} and len(own) % 2 > 0)


def _launch_place(argv: Sequence[str]) -> Sequence[str] | None:
    """Of r2bspec's own launch line, the words that say which file; None for any other line."""
    before, after = ("ros2", "launch", INCLUDED_LAUNCH), len(_LAUNCH_NAMES)
    place, rest = argv[len(before) : -after], argv[-after:]
    is_ours = (
        tuple(argv[: len(before)]) == before
        and tuple(word.partition(":=")[0] for word in rest) == _LAUNCH_NAMES
        and [word.partition(":=")[0] for word in place] in (["file"], ["package", "file"])
    )
    return place if is_ours else None


def _is_installed_launch(place: Sequence[str]) -> bool:
    """Whether a launch file is one of a package: it is below the package's own share folder."""
    path = PurePosixPath(place[-1].removeprefix("file:="))
    is_inside = not path.is_absolute() and ".." not in path.parts
    package = place[0].removeprefix("package:=")
    return len(place) > 1 and _PACKAGE.fullmatch(package) is not None and is_inside


def _is_installed_class(target: str) -> bool:
    """Whether a target is of r2bspec's reference nodes, or of a package in the ament index."""
    if _MODULE.fullmatch(target) is None:
        return False
    return target.startswith(_OWN_NODES) or target.partition(".")[0] in ament_packages()
