"""How the kernel schedules a process that has just been started: CPUs, priority, time slice."""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
from typing import Final

from r2bspec.execute.errors import RunError
from r2bspec.plan.plan import ProcessPlan

SLICE_NS: Final = 500_000
"""Less than the kernel's default, which is 1.4 ms on two cores and more on larger machines, and
longer than most of what player and monitor do for one message."""

_SCHED_OTHER: Final = 0
_SYSCALLS: Final = {"x86_64": (314, 315), "aarch64": (274, 275)}
"""sched_setattr and sched_getattr, which neither Python nor glibc before 2.41 can call."""


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


class _SchedAttr(ctypes.Structure):
    """struct sched_attr of linux/sched/types.h, in its first version."""

    _fields_ = (
        ("size", ctypes.c_uint32),
        ("policy", ctypes.c_uint32),
        ("flags", ctypes.c_uint64),
        ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32),
        ("runtime_ns", ctypes.c_uint64),
        ("deadline_ns", ctypes.c_uint64),
        ("period_ns", ctypes.c_uint64),
    )


def shorten_slice(pid: int, slice_ns: int = SLICE_NS) -> bool:
    """Let a process that has just been started wait less for a core, not run for longer.

    Since Linux 6.12 a thread that wakes up preempts one with a longer slice if its turn comes
    earlier (EEVDF); otherwise it waits until that slice is over, which shows as late publications
    and arrivals. The share of the processor that each gets does not change. Threads and descendants
    inherit it. No privilege is needed. Earlier kernels ignore it, and a real-time policy has no
    slices: neither is an error.

    Args:
        pid: the process, before it starts threads.
        slice_ns: the slice, in nanoseconds.

    Returns:
        Whether the kernel has accepted it.
    """
    found = _attributes(pid)
    if found is None or found.policy != _SCHED_OTHER:
        return False
    found.runtime_ns = slice_ns
    set_call, _ = _SYSCALLS[platform.machine()]
    return _syscall(set_call, pid, ctypes.byref(found), 0) == 0


def slice_of(pid: int) -> int:
    """The time slice of a process, in nanoseconds; 0 if the kernel does not tell."""
    found = _attributes(pid)
    return 0 if found is None else int(found.runtime_ns)


def _attributes(pid: int) -> _SchedAttr | None:
    found = _SchedAttr(size=ctypes.sizeof(_SchedAttr))
    calls = _SYSCALLS.get(platform.machine())
    if calls is None or _syscall(calls[1], pid, ctypes.byref(found), found.size, 0) != 0:
        return None
    return found


def _syscall(number: int, pid: int, *arguments: object) -> int:
    return int(ctypes.CDLL(None).syscall(number, pid, *arguments))
