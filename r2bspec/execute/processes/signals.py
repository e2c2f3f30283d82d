"""Signals that ask for an end: taken note of at once, acted on where it is safe."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from types import FrameType, TracebackType
from typing import Any

from r2bspec.execute.errors import InterruptedRunError

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_DEBOUNCE_S = 0.5
"""Signals that follow each other faster are one act: a terminal and a wrapper such as make or
timeout both pass one Ctrl-C on, so that it arrives twice."""


class _ImmediateInterrupt(BaseException):
    """Leaves whatever is under way; no Exception, which readers of damaged files catch."""


class Interrupts:
    """While active, the first signal makes `check` raise and a second ends the process at once.

    What the second leaves behind, the watchdog ends. In a thread other than the main one, where
    Python sets no handlers, signals stay with the program that started the run.
    """

    def __init__(self) -> None:
        self._received: signal.Signals | None = None
        self._received_s = 0.0
        self._reported = False
        self._is_immediate = False
        self._previous: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is not threading.main_thread():
            return self
        for each in _SIGNALS:
            # Whoever starts a run with nohup wants it to outlive the terminal.
            if each is signal.SIGHUP and signal.getsignal(each) is signal.SIG_IGN:
                continue
            self._previous[each] = signal.signal(each, self._note)
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        for each, handler in self._previous.items():
            signal.signal(each, handler)

    def _note(self, number: int, _frame: FrameType | None) -> None:
        now_s = time.monotonic()
        if self._received is None:
            self._received, self._received_s = signal.Signals(number), now_s
            if self._is_immediate:
                raise _ImmediateInterrupt
        elif now_s - self._received_s >= _DEBOUNCE_S:
            os._exit(InterruptedRunError.exit_code)

    @contextlib.contextmanager
    def immediate(self) -> Iterator[None]:
        """While active, a signal raises wherever the program is, instead of waiting for `check`.

        For long work that needs no cleaning up in order, such as reading a bag.

        Raises:
            InterruptedRunError: a signal has arrived, or arrives.
        """
        self.check()
        self._is_immediate = True
        try:
            yield
        except _ImmediateInterrupt:
            self.check()
        finally:
            self._is_immediate = False

    def check(self) -> None:
        """Raise once after a signal; cleaning up afterwards is not disturbed again.

        Raises:
            InterruptedRunError: a signal has arrived since the last call.
        """
        if self._received is not None and not self._reported:
            self._reported = True
            raise InterruptedRunError(
                f"interrupted by {self._received.name}",
                hint="What was measured until then is in the run folder, marked as incomplete.",
            )
