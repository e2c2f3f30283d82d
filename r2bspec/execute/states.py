"""The states of a run, and what each of them does.

`r2bspec.execute.controller` has the states of the whole run, `r2bspec.execute.start.start` those of
a start, `r2bspec.execute.measurement.measurement` those that measure. The record names the same
states, as its events; docs/running.md describes them.

Every state is left early in the same way. A fault of a process, a signal and a memory limit are
seen wherever the controller waits, and raise an error there; whatever the state, the controller
then ends all processes, writes the samples that there are, and a record that names the error.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from enum import StrEnum
from types import FrameType
from typing import Any

from r2bspec.execute.errors import InterruptedRunError
from r2bspec.safe_io.terminal import leave_terminal


class Progress:
    """Receives progress; every method returns immediately and never raises. These discard it."""

    def phase(self, name: str, text: str) -> None:
        """Receive the begin of a phase of the plan."""

    def step(self, done: int, total: int) -> None:
        """Receive how much of a countable phase is done."""

    def segment(self, title: str, steps: int) -> None:
        """Receive the begin of a segment of `steps` steps."""

    def playing(self, sent: int, received: int) -> None:
        """Receive the progress of the current segment; called four times a second.

        Args:
            sent: how many steps have been published.
            received: how many messages have been received: the minimum over all monitors.
        """

    def waiting(self, place: str, left: str) -> None:
        """Receive the place in the queue of this host; called five times a second.

        Args:
            place: in the queue, and whom it waits for.
            left: how long that will take.
        """
        if place != self._place:
            self._place = place
            self.note(f"{place}: {left}")

    _place = ""

    def note(self, text: str) -> None:
        """Receive a one-line message for the user."""


class RunState(StrEnum):
    """The states of a run, in their order."""

    PREPARE = "prepare"
    """What the plan needs is looked for: rclpy, middleware, profiler, secrets."""

    SETUP = "setup"
    """The setup steps run; what they build is part of the graph, whose identity is then known."""

    LOAD = "load"
    """The recordings are read into buffers, while the next processes import ROS."""

    PREPROCESS = "preprocess"
    """The preprocessors run on what was read, and end; their outputs are further buffers."""

    START = "start"
    """Player and monitors start, and the processes that import ROS."""

    GRAPH = "graph"
    """The nodes start; all endpoints are matched."""

    CONFIGURE = "configure"
    """Lifecycle nodes are configured, in the order of the spec."""

    ACTIVATE = "activate"
    """Lifecycle nodes are activated, likewise; `graph` follows: the endpoints are matched."""

    READY = "ready"
    """The readiness probes are waited for."""

    AFTER_READY = "after_ready"
    """The `after_ready` steps run."""

    WARM_UP = "warm_up"
    """The inputs are played until every monitor has received something."""

    SEARCH = "search"
    """Rates are probed for the peak."""

    SUSTAINED = "sustained"
    """The rates to be sustained are probed."""

    PLAY = "play"
    """Iterations are played; each further start of the processes comes from here."""

    CONFIRM = "confirm"
    """The run fails: it is repeated in new processes, as far as the failure depends on it."""

    PROFILE = "profile"
    """One more iteration, in processes with a profiler; these are started anew."""

    ANATOMY = "anatomy"
    """One more iteration, in processes that are observed from inside; these are started anew."""

    COLLECT = "collect"
    """All processes end."""


class RunStates:
    """The current state of a run, its earlier states, and the notes made on the way.

    Attributes:
        state: which it is in.
        events: states and notes, with the time of each (CLOCK_MONOTONIC).
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self.state = RunState.PREPARE
        self.events: list[tuple[int, str]] = []

    def enter(self, state: RunState, text: str) -> None:
        """Enter a state; `text` tells the user what happens in it."""
        self.state = state
        self.events.append((time.monotonic_ns(), f"phase {state}"))
        self._progress.phase(state.value, text)

    def note(self, text: str) -> None:
        """Show the user a message, and keep it for the record."""
        self.events.append((time.monotonic_ns(), text))
        self._progress.note(text)


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
        for number in _SIGNALS:
            # A run started with nohup must survive the end of its terminal.
            if number is signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN:
                continue
            self._previous[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _note(self, number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGHUP:
            leave_terminal()
        now_s = time.monotonic()
        if self._received is None:
            self._received, self._received_s = signal.Signals(number), now_s
            if self._is_immediate:
                raise _ImmediateInterrupt
        elif now_s - self._received_s >= _DEBOUNCE_S:
            os._exit(InterruptedRunError.exit_code)

    @contextlib.contextmanager
    def immediate(self) -> Iterator[None]:
        """Let a signal raise immediately instead of in the next `check`.

        For long work without ordered cleanup, such as reading a bag.

        Raises:
            InterruptedRunError: a signal has arrived, or arrives.
        """
        try:
            # In this order, no signal comes between the two.
            self._is_immediate = True
            self.check()
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
