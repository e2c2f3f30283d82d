"""The scheduling of the processes of the graph and their threads: tested, set, and read back.

What the system forbids is determined before anything is started, by trying it on a short-lived
thread: a process may have the capability while its control group still refuses. Only then is the
responsible limit looked up. Threads and descendants inherit the settings that a process gets before
it starts any; named threads get theirs when the graph is ready and after the warm-up, because they
do not exist before.

Memory cannot be locked from outside, nor before a program is executed: an object that is preloaded
does it (``native/join.c``), and what the kernel says of it is read back.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import resource
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

import msgspec
import psutil

from r2bspec.execute.errors import RunError
from r2bspec.execute.processes.resources import family
from r2bspec.language.spec import ThreadScheduling
from r2bspec.plan.plan import ProcessPlan
from r2bspec.plan.this_machine import CAP_IPC_LOCK, CAP_SYS_NICE, has_capability
from r2bspec.record.run_record import AppliedSettings, ThreadSchedulingRecord

_POLICIES: Final = {
    "other": os.SCHED_OTHER,
    "batch": os.SCHED_BATCH,
    "idle": os.SCHED_IDLE,
    "fifo": os.SCHED_FIFO,
    "rr": os.SCHED_RR,
}
_NAMES: Final = {number: name for name, number in _POLICIES.items()}


def require_permitted(processes: Sequence[ProcessPlan]) -> None:
    """Check, on a thread of this process, that the system permits the scheduling of a plan.

    Raises:
        RunError: the machine has no such CPU, or does not permit the policy or the niceness; with
            the limit that forbids it.
    """
    for plan in processes:
        _try(plan, plan)
        if has_memory_lock(plan):
            _require_memory_lock(plan.name)
        for thread in plan.scheduling.threads if plan.scheduling else ():
            _try(plan, thread)


def _try(plan: ProcessPlan, wanted: ProcessPlan | ThreadScheduling) -> None:
    # Linux applies all of it to the calling thread alone, which then ends.
    with ThreadPoolExecutor(1) as alone:
        alone.submit(_apply, plan.name, wanted, 0).result()


def apply_to_process(plan: ProcessPlan, pid: int) -> None:
    """Schedule a process that has just been started, before its program starts a thread.

    Raises:
        RunError: as for `require_permitted`.
    """
    with contextlib.suppress(ProcessLookupError):
        _apply(plan.name, plan, pid)
        if has_memory_lock(plan):
            hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
            resource.prlimit(pid, resource.RLIMIT_MEMLOCK, (hard, hard))


def _apply(name: str, wanted: ProcessPlan | ThreadScheduling, task: int) -> None:
    """Schedule a task: a process that has one thread yet, or a thread; 0 is the calling one."""
    settings = wanted.scheduling if isinstance(wanted, ProcessPlan) else wanted
    if wanted.cpus:
        try:
            os.sched_setaffinity(task, wanted.cpus)
        except ProcessLookupError:
            raise
        except (OSError, ValueError) as error:
            raise _no_such_cpus(name, wanted.cpus) from error
    if wanted.nice:
        with _refused(name, f"a nice value of {wanted.nice}", lambda: _nice_limit(wanted.nice)):
            os.setpriority(os.PRIO_PROCESS, task, wanted.nice)
    if settings is not None and settings.policy is not None:
        priority = settings.priority
        what = f"the policy {settings.policy}" + (f" with priority {priority}" if priority else "")
        with _refused(name, what, lambda: _policy_limit(priority)):
            os.sched_setscheduler(task, _POLICIES[settings.policy], os.sched_param(priority))


def _no_such_cpus(name: str, cpus: Sequence[int]) -> RunError:
    allowed = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
    online = os.cpu_count() or 1
    hint = "Correct 'cpus', or use a machine that has these CPUs."
    if max(cpus) < online:
        hint = (
            "The machine has them, but the control group (cpuset) of r2bspec does not grant them: "
            "start it with more, as with 'docker run --cpuset-cpus'."
        )
    return RunError(
        f"process {name} cannot run on CPUs {', '.join(map(str, cpus))}; available: {allowed}",
        hint=hint,
        code="R2B636",
    )


@contextlib.contextmanager
def _refused(name: str, what: str, why: Callable[[], str]) -> Iterator[None]:
    try:
        yield
    except ProcessLookupError:
        raise
    except OSError as error:
        reason = why() if error.errno in {errno.EPERM, errno.EACCES} else str(error)
        raise RunError(
            f"process {name}: {what} is not permitted: {reason}",
            hint="Raise the limit for this user in /etc/security/limits.d, with LimitRTPRIO= and "
            "LimitNICE= of a systemd unit, or with 'docker run --ulimit rtprio=99 --cap-add "
            "SYS_NICE', and log in again.",
            code="R2B637",
        ) from error


def _nice_limit(nice: int) -> str:
    soft = resource.getrlimit(resource.RLIMIT_NICE)[0]
    return f"RLIMIT_NICE is {soft}, and {20 - nice} is needed{_capability()}"


def _policy_limit(priority: int) -> str:
    soft = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    if priority and (soft == resource.RLIM_INFINITY or soft >= priority):
        return f"RLIMIT_RTPRIO is enough, but the control group grants no real time{_capability()}"
    return f"RLIMIT_RTPRIO is {soft}, and {priority} is needed{_capability()}"


def _capability() -> str:
    return "" if has_capability(CAP_SYS_NICE) else ", or the capability CAP_SYS_NICE"


def has_memory_lock(plan: ProcessPlan) -> bool:
    """Return whether a process of a plan locks its memory."""
    return plan.scheduling is not None and plan.scheduling.memory_lock


def _require_memory_lock(name: str) -> None:
    """Refuse what would fail at an allocation in the middle of a run.

    All that a process maps is locked, much of which it never uses; so a limit below the memory of
    the machine may be met at any time.
    """
    hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
    enough = hard == resource.RLIM_INFINITY or hard >= psutil.virtual_memory().total
    if not enough and not has_capability(CAP_IPC_LOCK):
        raise RunError(
            f"process {name}: a memory lock is not permitted: RLIMIT_MEMLOCK is {hard >> 10} KiB, "
            "and 'unlimited' is needed, or the capability CAP_IPC_LOCK",
            hint="Raise 'memlock' for this user in /etc/security/limits.d, with LimitMEMLOCK= of a "
            "systemd unit, or with 'docker run --ulimit memlock=-1', and log in again.",
            code="R2B637",
        )


def locked_bytes(plan: ProcessPlan, pid: int) -> int:
    """Return how much memory of a process and its descendants is locked.

    Raises:
        RunError: none is, although the plan asks for it.
    """
    locked = sum(map(_locked_bytes_of, family(pid)))
    if not locked and psutil.pid_exists(pid):
        raise RunError(
            f"process {plan.name}: its memory is not locked: it does not initialise rcl, or "
            "has more memory than can be locked",
            hint="Its log may have the reason. A program without ROS has to call mlockall itself.",
            code="R2B637",
        )
    return locked


def _locked_bytes_of(pid: int) -> int:
    try:
        status = Path(f"/proc/{pid}/status").read_text(errors="replace")
    except OSError:
        return 0
    found = re.search(r"^VmLck:\s+(\d+) kB", status, re.MULTILINE)
    return 1024 * int(found[1]) if found else 0


def apply_when_ready(plan: ProcessPlan, pid: int, *, final: bool) -> AppliedSettings:
    """Apply the settings that need a running process; return all as the kernel has them.

    Args:
        plan: of the process.
        pid: its id.
        final: whether the warm-up is over, so that everything must be there.

    Raises:
        RunError: something is not, or is not permitted.
    """
    return AppliedSettings(
        scheduling=schedule_threads(plan, pid, final=final),
        locked_bytes=locked_bytes(plan, pid) if final and has_memory_lock(plan) else 0,
    )


def schedule_threads(
    plan: ProcessPlan, pid: int, *, final: bool = True
) -> tuple[ThreadSchedulingRecord, ...]:
    """Schedule the named threads of a process and its descendants, and return their settings.

    Args:
        plan: of the process.
        pid: its id.
        final: whether a name that no thread has is an error.

    Returns:
        As read back from the kernel; empty if the plan asks for nothing.

    Raises:
        RunError: no thread has a name of the plan, or as for `require_permitted`.
    """
    scheduling = plan.scheduling
    if scheduling is None and not plan.cpus and not plan.nice:
        return ()
    for thread in scheduling.threads if scheduling else ():
        named = [task for task, name in _threads(pid) if fnmatchcase(name, thread.name)]
        for task in named:
            with contextlib.suppress(ProcessLookupError):
                _apply(plan.name, thread, task)
        if not named and final:
            known = ", ".join(sorted({name for _, name in _threads(pid)})) or "none"
            raise RunError(
                f"process {plan.name} has no thread {thread.name!r} after the warm-up",
                hint=f"Its threads: {known}.",
                code="R2B653",
            )
    return read_scheduling(pid)


def read_scheduling(pid: int) -> tuple[ThreadSchedulingRecord, ...]:
    """Return the scheduling of the threads of a process and its descendants; equal threads once."""
    found: Counter[ThreadSchedulingRecord] = Counter()
    for task, name in _threads(pid):
        with contextlib.suppress(OSError):
            record = ThreadSchedulingRecord(
                thread=name,
                policy=_NAMES.get(os.sched_getscheduler(task) & ~os.SCHED_RESET_ON_FORK, "unknown"),
                priority=os.sched_getparam(task).sched_priority,
                nice=os.getpriority(os.PRIO_PROCESS, task),
                cpus=tuple(sorted(os.sched_getaffinity(task))),
            )
            found[record] += 1
    ordered = sorted(found, key=lambda each: (each.thread, each.policy, each.priority))
    return tuple(msgspec.structs.replace(each, count=found[each]) for each in ordered)


def _threads(pid: int) -> list[tuple[int, str]]:
    """Return the threads of a process and its descendants, with their names.

    Not those that have ended.
    """
    found = []
    for task in _tasks(family(pid)):
        with contextlib.suppress(OSError):
            name = (task / "comm").read_text(encoding="utf-8", errors="replace").rstrip()
            found.append((int(task.name), name))
    return found


def _tasks(pids: Iterable[int]) -> Iterator[Path]:
    """Yield the threads of processes, as the kernel shows them."""
    for pid in pids:
        yield from Path(f"/proc/{pid}/task").glob("*")


_MOST_PASSES: Final = 5
"""A thread that another thread starts meanwhile may miss the pass before."""


@contextlib.contextmanager
def on_core(core: int | None, pids: Sequence[int]) -> Iterator[None]:
    """Restrict processes to one core for the block.

    Threads whose CPUs or policy were set, by the spec or by their program, are left as they are,
    and so are those that this user may not move.

    Args:
        core: one of those that this process may use; None for no change.
        pids: of all the processes.
    """
    everywhere = os.sched_getaffinity(0)
    if core is None or everywhere == {core}:
        yield
        return
    bound = set(_ordinary_threads(pids, {core}))
    _move(pids, everywhere, {core})
    try:
        yield
    finally:
        _move(pids, {core}, everywhere, but=bound)


def _move(
    pids: Sequence[int], before: set[int], after: set[int], but: Set[int] = frozenset()
) -> None:
    """Let ordinary threads that run on certain CPUs run on others."""
    for _ in range(_MOST_PASSES):
        threads = set(_ordinary_threads(pids, before)) - but
        if not threads:
            return
        for thread in threads:
            with contextlib.suppress(OSError):
                os.sched_setaffinity(thread, after)


def _ordinary_threads(pids: Iterable[int], cpus: set[int]) -> Iterator[int]:
    """Yield the threads of processes that run on these CPUs, and whose policy is not set."""
    for task in _tasks(pids):
        thread = int(task.name)
        with contextlib.suppress(OSError):
            policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
            if policy == os.SCHED_OTHER and os.sched_getaffinity(thread) == cpus:
                yield thread
