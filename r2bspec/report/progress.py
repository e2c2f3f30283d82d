"""The progress of a run on standard error, with the time left: live on a terminal, else lines."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from r2bspec.diagnostics.plain_text import plain
from r2bspec.diagnostics.quote import time_text
from r2bspec.execute.states import Progress
from r2bspec.plan.time_estimate import BOTH_SIDES, TimeEstimate
from r2bspec.report.output import console, write

if TYPE_CHECKING:
    from rich.console import Console
    from rich.status import Status


class RemainingTime:
    """Follows the phases of a run, or of several runs of one plan, and estimates the time left.

    Of several runs, the next is expected to take as long as the previous run.
    """

    def __init__(
        self,
        estimate: TimeEstimate,
        *,
        after_s: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start before the first phase.

        Args:
            estimate: the estimate of the runs.
            after_s: the time that other runs will take afterwards.
            clock: seconds, in steps of no fixed size.
        """
        self._estimate = estimate
        self._names = list(estimate.phases)
        self._runs_left = estimate.runs
        self._after_s = after_s
        self._clock = clock
        self._phase = -1
        self._began_s = self._run_began_s = clock()
        self._run_s = estimate.run_s
        self._is_known = True

    def begin(self, name: str) -> None:
        """Note the begin of a phase.

        A phase before the last belongs to the next run, or to a later start of this run, whose time
        is a part of the estimate of ``play``.
        """
        if name == "confirm":
            # What was played is played once more.
            self._phase = -1
        if name not in self._names:
            return
        number = self._names.index(name)
        if number < self._phase or (number == self._phase and name == BOTH_SIDES):
            if self._runs_left <= 1:
                # A confirmation, of which nobody knows how long it is.
                self._is_known = self._estimate.runs == 1
                return
            self._run_s = self._clock() - self._run_began_s
            if self._runs_left == self._estimate.runs:
                self._run_s = max(self._run_s - self._estimate.once_s, 0.0)
            self._runs_left -= 1
            self._run_began_s = self._clock()
        elif number == self._phase:
            return
        self._phase, self._began_s = number, self._clock()

    def seconds(self) -> float:
        """Return the estimated time left; a phase longer than expected adds nothing."""
        times = [seconds * self._factor for seconds in self._estimate.phases.values()]
        later = sum(times[self._phase + 1 :])
        elapsed_s = self._clock() - self._began_s if self._phase >= 0 else 0.0
        rest = max(0.0, self._current_s - elapsed_s)
        return rest + later + (self._runs_left - 1) * self._run_s + self._after_s

    @property
    def _factor(self) -> float:
        """How much longer the last run took than expected."""
        return self._run_s / self._estimate.run_s if self._estimate.run_s else 1.0

    @property
    def _current_s(self) -> float:
        """How long the current phase should take in all."""
        is_first = self._runs_left == self._estimate.runs and self._phase < 1
        once_s = self._estimate.once_s if is_first else 0.0
        if self._phase < 0:
            return once_s
        return list(self._estimate.phases.values())[self._phase] * self._factor + once_s

    def text(self) -> str:
        """Return the time left in words, as far as it is known."""
        late_s = self._clock() - self._began_s - self._current_s
        if not self._is_known or (self._phase >= 0 and late_s > max(_LATE_S, self._current_s / 3)):
            return "takes longer than estimated"
        left = f"about {time_text(max(self.seconds(), 1.0))} left"
        return f"{left} if all are played" if self._estimate.is_open else left


_LATE_S = 5.0
"""A phase that takes so much longer than estimated, or a third longer, makes the rest unknown."""

_LINE_INTERVAL_S = 10.0
"""Logs should be short, and show that the run continues."""

_RARE_INTERVAL_S = 60.0
"""Of a CI job, whose log is read only when it has failed, and while others have the host."""

_REFRESH_INTERVAL_S = 0.5
"""Faster updates are not readable, and each takes time from the run."""


def progress_text(sent: int, received: int, steps: int) -> str:
    """Return the progress of a segment of `steps` steps, in a line."""
    return f"{sent} of {steps} sent · {received} received"


class _ShownProgress(Progress):
    """What every progress that is shown follows."""

    def __init__(self, remaining: RemainingTime | None) -> None:
        self._remaining = remaining
        self._began = time.monotonic()
        self._phase_text = self._title = ""
        self._steps = 0
        self._next = 0.0

    def phase(self, name: str, text: str) -> None:
        if self._remaining is not None:
            self._remaining.begin(name)
        self._phase_text, self._title = text, ""

    def segment(self, title: str, steps: int) -> None:
        self._title, self._steps = title, steps

    def _is_due(self, interval_s: float) -> bool:
        """Return True at most once in an interval."""
        is_due = time.monotonic() >= self._next
        if is_due:
            self._next = time.monotonic() + interval_s
        return is_due

    def waiting(self, place: str, left: str) -> None:
        if place != self._place:
            self._place, self._next = place, 0.0
        if self._is_due(self._waiting_interval_s):
            self._show_place(place, left)

    _waiting_interval_s = _RARE_INTERVAL_S

    def _show_place(self, place: str, left: str) -> None:
        """Show the place in the queue of this host."""

    def _rest(self) -> str:
        return self._remaining.text() if self._remaining is not None else ""


class _Lines(_ShownProgress):
    """A line for each event, with the seconds since the start; rarely if the log is of CI."""

    def __init__(self, remaining: RemainingTime | None, *, rare: bool) -> None:
        super().__init__(remaining)
        self._rare = rare
        self._notes: set[str] = set()

    def _write_line(self, *parts: str) -> None:
        text = " · ".join(filter(None, parts))
        write(sys.stderr, f"[{time.monotonic() - self._began:6.1f} s] {plain(text)}\n")

    def _write_rarely(self, detail: str = "") -> None:
        if self._is_due(_RARE_INTERVAL_S):
            self._write_line(self._phase_text, self._title, detail, self._rest())

    def phase(self, name: str, text: str) -> None:
        super().phase(name, text)
        if self._rare:
            self._write_rarely()
        else:
            self._write_line(text, self._rest() if name == BOTH_SIDES else "")

    def segment(self, title: str, steps: int) -> None:
        super().segment(title, steps)
        if self._rare:
            self._write_rarely()
        else:
            self._write_line(f"  {title}")
            self._next = time.monotonic() + _LINE_INTERVAL_S

    def playing(self, sent: int, received: int) -> None:
        if self._rare:
            self._write_rarely(progress_text(sent, received, self._steps))
        elif self._is_due(_LINE_INTERVAL_S):
            self._write_line(f"    {progress_text(sent, received, self._steps)}", self._rest())

    def _show_place(self, place: str, left: str) -> None:
        self._write_line(place, left)

    def note(self, text: str) -> None:
        if text not in self._notes:
            self._notes.add(text)
            self._write_line(f"  {text}")


class _Live(_ShownProgress):
    """A line that changes in place; notes stay above."""

    _waiting_interval_s = _REFRESH_INTERVAL_S

    def __init__(self, console: Console, status: Status, remaining: RemainingTime | None) -> None:
        super().__init__(remaining)
        self._console = console
        self._status = status

    def _show(self, detail: str = "") -> None:
        from rich.text import Text

        elapsed = f"{time.monotonic() - self._began:.0f} s"
        times = " · ".join(filter(None, (elapsed, self._rest())))
        # A wrapped line would not be erased by the next one.
        line = Text(no_wrap=True, overflow="ellipsis")
        line.append(self._phase_text, "bold").append(f"  {detail}  ").append(times, "dim")
        self._status.update(line)

    def phase(self, name: str, text: str) -> None:
        super().phase(name, text)
        self._show()

    def step(self, done: int, total: int) -> None:
        self._show(f"{done}/{total}")

    def segment(self, title: str, steps: int) -> None:
        super().segment(title, steps)
        self._show(title)

    def playing(self, sent: int, received: int) -> None:
        if self._is_due(_REFRESH_INTERVAL_S):
            self._show(f"{self._title}: {progress_text(sent, received, self._steps)}")

    def _show_place(self, place: str, left: str) -> None:
        self._phase_text = place
        self._show(left)

    def note(self, text: str) -> None:
        self._console.print(f"  {text}", markup=False, highlight=False, style="dim")


@contextlib.contextmanager
def shown_progress(
    *, quiet: bool = False, remaining: RemainingTime | None = None
) -> Iterator[Progress]:
    """Show the progress of a run for the block.

    CI systems keep what is printed, so a live view there would be a thousand lines; with the
    variable ``CI`` there is a line a minute.

    Args:
        quiet: show nothing.
        remaining: is told of the phases, and shown; None shows no remaining time.
    """
    if quiet:
        yield Progress()
    elif os.environ.get("CI") or not sys.stderr.isatty():
        yield _Lines(remaining, rare=bool(os.environ.get("CI")))
    else:
        terminal = console(sys.stderr)
        with terminal.status("starting") as status:
            yield _Live(terminal, status, remaining)
