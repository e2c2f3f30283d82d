"""Where a process runs, and with what priority."""

from __future__ import annotations

import contextlib
import os

from r2bspec.execute.errors import RunError
from r2bspec.plan.plan import ProcessPlan


def apply_affinity(plan: ProcessPlan, pid: int) -> None:
    """Bind a process that has just been started to its processors, and set its priority.

    Done from outside, before the program has started its first thread: threads and descendants
    inherit both.

    Raises:
        RunError: the machine has no such processor, or does not allow the priority.
    """
    with contextlib.suppress(ProcessLookupError):
        if plan.cpus:
            try:
                os.sched_setaffinity(pid, plan.cpus)
            except ProcessLookupError:
                raise
            except (OSError, ValueError) as error:
                here = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
                raise RunError(
                    f"process {plan.name} cannot run on processors "
                    f"{', '.join(map(str, plan.cpus))}; this machine has {here}",
                    hint="Correct 'cpus', or run on a machine that has them.",
                    code="R2B636",
                ) from error
        if plan.nice:
            try:
                os.setpriority(os.PRIO_PROCESS, pid, plan.nice)
            except PermissionError as error:
                raise RunError(
                    f"process {plan.name} may not have a nice value of {plan.nice}",
                    hint="Only a privileged user may lower it below 0.",
                    code="R2B637",
                ) from error
