"""Sharing out work among processes: answers in order, and no wait for a process that has died.

`multiprocessing.Pool` waits for ever for the answer of a worker that was killed, and the executor
of `concurrent.futures` does not know which task ended it. Here each worker answers task by task on
a pipe of its own, so that the end of a pipe names the task. Another worker then takes its other
tasks: one file that crashes its check does not hide the findings of the rest.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from multiprocessing import connection
from multiprocessing.context import ForkProcess
from typing import Any, TypeVar

from r2bspec.cli.internal_error import Crash, InternalError, UncheckedFiles, WorkerEndedError
from r2bspec.errors import ExitStatus, R2bspecError

T = TypeVar("T")


_INTERRUPTS = frozenset({signal.SIGINT, signal.SIGTERM})

_TASKS_AHEAD = 16
"""Tasks that a worker has at most, so that it need not wait for the next one."""


@dataclass(slots=True)
class _Worker:
    process: ForkProcess
    pipe: connection.Connection
    tasks: list[int] = field(default_factory=list)


@dataclass(slots=True)
class _Answer:
    """What a worker says of a task: its result, a foreseen error, a crash, or that it has ended."""

    task: int
    result: Any = None
    error: R2bspecError | None = None
    crash: Crash | None = None
    ended: WorkerEndedError | None = None


def map_in_processes(
    function: Callable[[str], T],
    names: Sequence[str],
    count: int,
    failures: UncheckedFiles | None = None,
) -> Iterator[T]:
    """`function` of every name, by `count` processes, in the order of the names.

    Interrupts are the caller's: the workers ignore them, and are killed when the iterator is
    closed or left by an exception.

    Args:
        function: applied in the workers.
        names: its arguments.
        count: the number of workers.
        failures: what has failed before, to be raised with what fails here.

    Raises:
        R2bspecError: `function` raised it; at once.
        InternalError: `function` raised another exception; after the results of the others.
        WorkerEndedError: a worker died, and the message has the name it was at; likewise.
    """
    shift = _Shift(function, names, failures or UncheckedFiles())
    try:
        for _ in range(count):
            shift.start()
        yield from shift.results()
    finally:
        for worker in shift.workers:
            worker.pipe.close()
            worker.process.kill()
        for worker in shift.workers:
            worker.process.join()


class _Shift:
    """The workers of one call, and what is left to do."""

    def __init__(
        self, function: Callable[[str], Any], names: Sequence[str], failures: UncheckedFiles
    ) -> None:
        self._failures = failures
        self._function = function
        self._names = names
        self._waiting: Iterator[int] = iter(range(len(names)))
        self._by_pipe: dict[Any, _Worker] = {}
        self.workers: list[_Worker] = []

    def start(self) -> _Worker:
        """One more worker, which has tasks already."""
        worker = _start(self._function, self._names, self.workers)
        self.workers.append(worker)
        self._by_pipe[worker.pipe] = worker
        _assign(worker, self._waiting)
        return worker

    def results(self) -> Iterator[Any]:
        """Every result, in the order of the names; then the failures are raised."""
        done: dict[int, _Answer] = {}
        following = 0
        while following < len(self._names):
            for ready in connection.wait(list(self._by_pipe)):
                worker = self._by_pipe[ready]
                answer = _receive(worker, self._names)
                done[answer.task] = answer
                worker.tasks.remove(answer.task)
                if answer.error is not None:
                    raise answer.error
                if answer.crash is not None:
                    self._failures.add(self._names[answer.task], InternalError(answer.crash))
                if answer.ended is not None:
                    self._failures.add(self._names[answer.task], answer.ended)
                    self._replace(worker)
                else:
                    _assign(worker, self._waiting)
            while following in done:
                answer = done.pop(following)
                following += 1
                if answer.crash is None and answer.ended is None:
                    yield answer.result
        self._failures.raise_first()

    def _replace(self, ended: _Worker) -> None:
        """Let a new worker do what one that has ended can no longer do."""
        del self._by_pipe[ended.pipe]
        self._waiting = chain(ended.tasks, self._waiting)
        ended.tasks = []
        self.start()


def _start(
    function: Callable[[str], T], names: Sequence[str], others: Sequence[_Worker]
) -> _Worker:
    own, theirs = multiprocessing.Pipe()
    inherited = [own, *(other.pipe for other in others)]
    # Blocked until the worker ignores them: no moment is left in which an interrupt of the whole
    # process group shows as a traceback of the worker.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _INTERRUPTS)
    try:
        process = multiprocessing.get_context("fork").Process(
            target=_work, args=(function, names, theirs, inherited), daemon=True
        )
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    theirs.close()
    return _Worker(process, own)


def _assign(worker: _Worker, waiting: Iterator[int]) -> None:
    """Give a worker tasks; one that has died is noticed when its answer is read."""
    with contextlib.suppress(OSError):
        while len(worker.tasks) < _TASKS_AHEAD and (number := next(waiting, None)) is not None:
            worker.tasks.append(number)
            worker.pipe.send(number)


def _receive(worker: _Worker, names: Sequence[str]) -> _Answer:
    try:
        answer: _Answer = worker.pipe.recv()
    except (EOFError, OSError):
        worker.process.join()
        checked = repr(names[worker.tasks[0]]) if worker.tasks else "nothing yet"
        ended = WorkerEndedError(
            f"the process that checked {checked} ended {_how(worker)}",
            hint="Check that file by itself. SIGKILL often means that memory was short.",
        )
        if not worker.tasks:
            raise ended from None
        return _Answer(worker.tasks[0], ended=ended)
    return answer


def _how(worker: _Worker) -> str:
    status = worker.process.exitcode or 0
    if status >= 0:
        return f"with status {status}"
    try:
        return f"by {signal.Signals(-status).name}"
    except ValueError:
        return f"by signal {-status}"


def _work(
    function: Callable[[str], T],
    names: Sequence[str],
    pipe: connection.Connection,
    inherited: Sequence[connection.Connection],
) -> None:
    """The life of a worker: it ends with its pipe."""
    for number in _INTERRUPTS:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _INTERRUPTS)
    for descriptor in inherited:
        # Held here, they would keep other pipes open after the caller has gone.
        descriptor.close()
    try:
        while True:
            task: int = pipe.recv()
            pipe.send(_done(function, names[task], task))
    except (EOFError, OSError):
        os._exit(ExitStatus.OK)
    except BaseException:
        # Too little memory even to describe what went wrong: the caller names the task.
        os._exit(ExitStatus.INTERNAL_ERROR)


def _done(function: Callable[[str], T], name: str, task: int) -> _Answer:
    try:
        return _Answer(task, result=function(name))
    except R2bspecError as error:
        plain = R2bspecError(str(error), hint=error.hint, code=error.code)
        plain.exit_code = error.exit_code
        return _Answer(task, error=plain)
    except Exception as error:
        return _Answer(task, crash=Crash.of(error, f"while checking {name!r}"))
