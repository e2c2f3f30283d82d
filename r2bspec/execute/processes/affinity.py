"""CPU affinity and priority of a process."""

from __future__ import annotations

import contextlib
import os

from r2bspec.execute.errors import RunError
from r2bspec.plan.plan import ProcessPlan


def apply_affinity(plan: ProcessPlan, pid: int) -> None:
    """Bind a process that has just been started to its CPUs, and set its priority.

    This is done before the program starts its first thread; threads and descendants inherit both.

    Raises:
        RunError: the machine has no such CPU, or does not permit the priority.
    """
    with contextlib.suppress(ProcessLookupError):
        if plan.cpus:
            try:
                os.sched_setaffinity(pid, plan.cpus)
            except ProcessLookupError:
                raise
            except (OSError, ValueError) as error:
                available = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
                raise RunError(
                    f"process {plan.name} cannot run on CPUs "
                    f"{', '.join(map(str, plan.cpus))}; available: {available}",
                    hint="Correct 'cpus', or use a machine that has these CPUs.",
                    code="R2B636",
                ) from error
        if plan.nice:
            try:
                os.setpriority(os.PRIO_PROCESS, pid, plan.nice)
            except PermissionError as error:
                raise RunError(
                    f"process {plan.name}: a nice value of {plan.nice} is not permitted",
                    hint="Only a privileged user may set values below 0.",
                    code="R2B637",
                ) from error
