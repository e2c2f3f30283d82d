"""How much longer a run will take, from its phases and the estimate of its plan."""

from __future__ import annotations

import time
from collections.abc import Callable

from r2bspec.plan.time_estimate import TimeEstimate, time_text


class RemainingTime:
    """Follows the phases of a run, or of several runs of one plan, and estimates what is left."""

    def __init__(
        self,
        estimate: TimeEstimate,
        *,
        after_s: float = 0.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start before the first phase.

        Args:
            estimate: of the runs.
            after_s: the time that other runs will take afterwards.
            clock: seconds, in steps of no fixed size.
        """
        self._estimate = estimate
        self._names = list(estimate.phases)
        self._runs_left = estimate.runs
        self._after_s = after_s
        self._clock = clock
        self._phase = -1
        self._began_s = clock()

    def begin(self, name: str) -> None:
        """A phase begins.

        One that is earlier than the last belongs to the next run, or to a later start of this one,
        of which the time is a part of the estimate of ``play``.
        """
        if name == "confirm":
            # What was played is played once more.
            self._phase = -1
        if name not in self._names:
            return
        number = self._names.index(name)
        if number < self._phase:
            if self._runs_left <= 1:
                return
            self._runs_left -= 1
        elif number == self._phase:
            return
        self._phase, self._began_s = number, self._clock()

    def seconds(self) -> float:
        """The estimated rest; a phase that takes longer than expected adds nothing."""
        times = list(self._estimate.phases.values())
        later = sum(times[self._phase + 1 :])
        current = times[self._phase] if self._phase >= 0 else 0.0
        rest = max(0.0, current - (self._clock() - self._began_s))
        return rest + later + (self._runs_left - 1) * self._estimate.run_s + self._after_s

    def text(self) -> str:
        """The rest in words."""
        return f"about {time_text(max(self.seconds(), 1.0))} left"
