"""Interrupting a run by signals: recorded immediately, handled where it is safe."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from types import FrameType
from typing import Any

from r2bspec.execute.errors import InterruptedRunError

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_DEBOUNCE_S = 0.5
"""Signals within this time count as one: a terminal and a wrapper such as make or timeout both
forward one Ctrl-C, so that it arrives twice."""


class _ImmediateInterrupt(BaseException):
    """Interrupts the current work; not an Exception, which readers of damaged files catch."""


class Interrupts:
    """While active, the first signal makes `check` raise; a second one exits immediately.

    After a second signal, the watchdog cleans up. In a thread other than the main one, where
    Python sets no handlers, the program that started the run handles signals.
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
            # A run started with nohup must survive the end of its terminal.
            if each is signal.SIGHUP and signal.getsignal(each) is signal.SIG_IGN:
                continue
            self._previous[each] = signal.signal(each, self._note)
        return self

    def __exit__(self, *_: object) -> None:
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
        """While active, a signal raises immediately instead of in the next `check`.

        For long work without ordered cleanup, such as reading a bag.

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
        """Raise once after a signal, so that the cleanup is not interrupted again.

        Raises:
            InterruptedRunError: a signal has arrived since the last call.
        """
        if self._received is not None and not self._reported:
            self._reported = True
            raise InterruptedRunError(
                f"interrupted by {self._received.name}",
                hint="The measurements so far are in the run folder, marked as incomplete.",
            )
