"""The scheduling of the processes of the graph: tested, set, and read back.

What the system forbids is determined before anything is started, by trying it on a short-lived
thread: a process may have the capability while its control group still refuses. Only then is the
responsible limit looked up. Threads and descendants inherit the settings that a process gets before
it starts any.
"""

from __future__ import annotations

import contextlib
import errno
import os
import resource
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.execute.errors import RunError
from r2bspec.execute.processes.resources import family
from r2bspec.plan.plan import ProcessPlan
from r2bspec.plan.this_machine import CAP_SYS_NICE, has_capability
from r2bspec.record.run_record import ThreadSchedulingRecord

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
        # Linux applies all of it to the calling thread alone, which then ends.
        with ThreadPoolExecutor(1) as alone:
            alone.submit(apply_to_process, plan, 0).result()


def apply_to_process(plan: ProcessPlan, pid: int) -> None:
    """Schedule a process that has just been started, before its program starts a thread.

    Args:
        plan: the plan of the process.
        pid: its id; 0 is the calling thread.

    Raises:
        RunError: as for `require_permitted`.
    """
    with contextlib.suppress(ProcessLookupError):
        if plan.cpus:
            try:
                os.sched_setaffinity(pid, plan.cpus)
            except ProcessLookupError:
                raise
            except (OSError, ValueError) as error:
                raise _no_such_cpus(plan.name, plan.cpus) from error
        if plan.nice:
            with _refused(plan.name, f"a nice value of {plan.nice}", _nice_limit(plan.nice)):
                os.setpriority(os.PRIO_PROCESS, pid, plan.nice)
        if plan.scheduling is not None and plan.scheduling.policy is not None:
            policy, priority = plan.scheduling.policy, plan.scheduling.priority
            what = f"the policy {policy}" + (f" with priority {priority}" if priority else "")
            with _refused(plan.name, what, _policy_limit(priority)):
                os.sched_setscheduler(pid, _POLICIES[policy], os.sched_param(priority))


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
def _refused(name: str, what: str, limit: str) -> Iterator[None]:
    try:
        yield
    except ProcessLookupError:
        raise
    except OSError as error:
        reason = limit if error.errno in {errno.EPERM, errno.EACCES} else str(error)
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


def read_scheduling(pid: int) -> tuple[ThreadSchedulingRecord, ...]:
    """Return the scheduling of the threads of a process and its descendants; equal threads once."""
    threads: Counter[ThreadSchedulingRecord] = Counter()
    for task, name in _threads(pid):
        with contextlib.suppress(OSError):
            record = ThreadSchedulingRecord(
                thread=name,
                policy=_NAMES.get(os.sched_getscheduler(task) & ~os.SCHED_RESET_ON_FORK, "unknown"),
                priority=os.sched_getparam(task).sched_priority,
                nice=os.getpriority(os.PRIO_PROCESS, task),
                cpus=tuple(sorted(os.sched_getaffinity(task))),
            )
            threads[record] += 1
    ordered = sorted(threads, key=lambda record: (record.thread, record.policy, record.priority))
    return tuple(msgspec.structs.replace(each, count=threads[each]) for each in ordered)


def _threads(pid: int) -> list[tuple[int, str]]:
    """Return the threads of a process and its descendants, with their names.

    Not those that have ended.
    """
    threads = []
    for task in _tasks(family(pid)):
        with contextlib.suppress(OSError):
            name = (task / "comm").read_text(encoding="utf-8", errors="replace").rstrip()
            threads.append((int(task.name), name))
    return threads


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
        pids: the pids of all the processes.
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
