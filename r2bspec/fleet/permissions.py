"""What a spec does on a host besides running what is installed there: commands, and Python.

The owner of a host allows each. Executables, components and Python classes of packages that are
installed there are always allowed: the owner has installed them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from r2bspec.fleet.errors import NotAllowedError
from r2bspec.plan.command_lines import is_own_program
from r2bspec.plan.plan import Plan, ProcessPlan

COMMANDS: Final = "commands"
PYTHON: Final = "python"

_LOADER_VARIABLES: Final = ("LD_", "PYTHON", "AMENT_", "BASH_", "ROS_PYTHON")
"""Variables with which a process runs other code than that of its program."""


def check_allowed(plan: Plan, allows: tuple[str, ...], host: str) -> None:
    """See that a host may run a plan.

    Raises:
        NotAllowedError: it may not.
    """
    for kind, found in ((COMMANDS, _commands(plan)), (PYTHON, _python(plan))):
        what = next(found, None)
        if what is not None and kind not in allows:
            raise NotAllowedError(
                f"the host {host} may not run {what}, because its worker was started without "
                f"--allow-{kind}",
                hint="Its owner decides: what a spec brings along can do there whatever the "
                "user of the worker can.",
            )


def _commands(plan: Plan) -> Iterator[str]:
    for process in plan.processes:
        if (called := _command_of(process)) is not None:
            yield f"the command {called!r}"
        for name in process.env:
            if name == "PATH" or name.startswith(_LOADER_VARIABLES):
                yield f"a process with the variable {name} of the spec"
    for setup in plan.setup:
        yield f"the setup command {setup.name!r}"
    for step in plan.after_ready:
        if step.argv:
            yield f"the command {step.argv[0]!r}"


def _command_of(process: ProcessPlan) -> str | None:
    """The program of a process, if the spec names it as a command or before one."""
    first = process.argv[0] if process.argv else ""
    if is_own_program(process.argv) or first == "" or first.startswith("$(executable "):
        return None
    if process.argv[:2] == ("ros2", "launch"):
        return None
    return first


def _python(plan: Plan) -> Iterator[str]:
    for process in plan.processes:
        for node in process.nodes:
            if ":" in node.target:
                yield f"the Python file {node.target.rpartition(':')[0]!r}"
        # A launch file that a spec brings along is Python, too.
        if process.argv[:2] == ("ros2", "launch"):
            for word in process.argv:
                if word.startswith("file:=") and not any(
                    each.startswith("package:=") for each in process.argv
                ):
                    yield f"the launch file {word.removeprefix('file:=')!r}"
        for word in process.argv[1:]:
            if word.startswith("./") and ".py:" in word:
                yield f"the Python file {word.rpartition(':')[0]!r}"
