"""Sharing out work among processes: answers in order, and no wait for a process that has died.

`multiprocessing.Pool` waits for ever for the answer of a worker that was killed, and the executor
of `concurrent.futures` does not know which task ended it. Here each of n workers has every n-th
task, and answers one after the other on a pipe of its own: the end of a pipe names the task at
which it ended. A new worker then takes the tasks after it: one file that crashes its check does not
hide the findings of the rest.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from r2bspec.cli.internal_error import Crash, InternalError, UncheckedFiles, WorkerEndedError
from r2bspec.errors import ExitStatus, R2bspecError

T = TypeVar("T")


_INTERRUPTS = frozenset({signal.SIGINT, signal.SIGTERM})


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
        R2bspecError: `function` raised it; after the results of the names before.
        InternalError: `function` raised another exception; after the results of the others.
        WorkerEndedError: a worker died, and the message has the name it was at; likewise.
    """
    failures = failures or UncheckedFiles()
    workers: dict[int, _Worker] = {}

    def start(first: int) -> None:
        # Blocked until the caller knows the worker, and until the worker ignores them: no moment
        # is left in which an interrupt leaves a process, or shows as a traceback of one.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _INTERRUPTS)
        try:
            others = [*workers.values()]
            workers[first % count] = _Worker(function, names[first::count], others)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    try:
        for first in range(count):
            start(first)
        for number, name in enumerate(names):
            try:
                answer = workers[number % count].answer(name)
            except WorkerEndedError as error:
                failures.add(name, error)
                start(number + count)
                continue
            if isinstance(answer, R2bspecError):
                raise answer
            if isinstance(answer, Crash):
                failures.add(name, InternalError(answer))
            else:
                (result,) = answer
                yield result
        failures.raise_first()
    finally:
        for worker in workers.values():
            worker.end()


class _Worker:
    """A process that has begun, and the end of its pipe on which it answers."""

    def __init__(
        self, function: Callable[[str], Any], names: Sequence[str], others: Sequence[_Worker]
    ) -> None:
        self._pipe, answers = multiprocessing.Pipe(duplex=False)
        # Held by a worker, they would keep the pipes of others open after the caller has gone.
        inherited = [self._pipe, *(other._pipe for other in others)]
        self._process = multiprocessing.get_context("fork").Process(
            target=_work, args=(function, names, answers, inherited), daemon=True
        )
        self._process.start()
        answers.close()

    def answer(self, name: str) -> tuple[Any] | R2bspecError | Crash:
        """What it says of `name`, its next one: the result, a foreseen error, or a crash.

        Raises:
            WorkerEndedError: it has ended.
        """
        try:
            answer: tuple[Any] | R2bspecError | Crash = self._pipe.recv()
        except (EOFError, OSError):
            self.end()
            raise WorkerEndedError(
                f"the process that checked {name!r} ended {self._how()}",
                hint="Check that file by itself. SIGKILL often means that memory was short.",
            ) from None
        return answer

    def _how(self) -> str:
        status = self._process.exitcode or 0
        if status >= 0:
            return f"with status {status}"
        try:
            return f"by {signal.Signals(-status).name}"
        except ValueError:
            return f"by signal {-status}"

    def end(self) -> None:
        """Kill it, if it has not ended by itself."""
        self._pipe.close()
        self._process.kill()
        self._process.join()


def _work(
    function: Callable[[str], Any], names: Sequence[str], answers: Any, inherited: Sequence[Any]
) -> None:
    """The life of a worker: it ends with its names, or with the caller."""
    for number in _INTERRUPTS:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _INTERRUPTS)
    for pipe in inherited:
        pipe.close()
    try:
        for name in names:
            answers.send(_done(function, name))
    except OSError:
        os._exit(ExitStatus.OK)
    except BaseException:
        # Too little memory even to describe what went wrong: the caller names the task.
        os._exit(ExitStatus.INTERNAL_ERROR)
    # Not what is registered for the exit of the caller.
    os._exit(ExitStatus.OK)


def _done(function: Callable[[str], Any], name: str) -> tuple[Any] | R2bspecError | Crash:
    try:
        return (function(name),)
    except R2bspecError as error:
        plain = R2bspecError(str(error), hint=error.hint, code=error.code)
        plain.exit_code = error.exit_code
        return plain
    except Exception as error:
        return Crash.of(error, f"while checking {name!r}")
