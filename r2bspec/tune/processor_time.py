"""How much work the callbacks of a graph do in the time that they take.

The time of a callback is converted to the work that it is alone on a processor. With k(t) the
threads of the graph that work at t, and e the processors of the N that others want,

    work = integral of min(1, N / (k(t) + e)) over the time of the callback

The kernel counts how long the threads of the graph wait for a processor, but not for whom. Either e
is such that they wait as long, for others; or e is 0, and N is as small: they wait for each other,
as on processors that others have taken; or the time that they wait counts as work.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from r2bspec.judge.measure.anatomy_events import Events, Ints
from r2bspec.tune.queue_model import Seconds

WaitsFor = Literal["others", "each other", "nobody"]
"""What threads of the graph wait for while they wait for a processor; ``nobody``: whatever it is,
it is the same in every deployment."""

CAUSES: Final[tuple[WaitsFor, ...]] = ("others", "each other", "nobody")


class ProcessorTime:
    """Converts the time of callbacks to work, for all processes of a segment."""

    def __init__(self, events: Events, starts: Ints, cores: int) -> None:
        began, ended = events.began_ns[starts], events.callback_ended_ns[starts]
        times = np.concatenate((began, ended))
        change = np.concatenate((np.ones(began.size), -np.ones(ended.size)))
        order = np.argsort(times, kind="stable")
        self._times = times[order].astype(np.float64)
        self._running = np.cumsum(change[order])
        process = np.concatenate((events.process[starts],) * 2)[order]
        self._of_process = {
            int(number): np.cumsum(np.where(process == number, change[order], 0.0))
            for number in np.unique(process)
        }
        self._cores = cores
        self.cores = float(cores)
        self.others = 0.0
        self._integral = self._times * 0.0

    def divide(self, used: float, waited: float, waits_for: WaitsFor) -> None:
        """Find the speeds of threads.

        Args:
            used: the processor time per time of all threads of the graph.
            waited: how long they wait for a processor per time. Callbacks wait for the same share
                of the processor time that they need as the threads of the middleware do.
            waits_for: for whom.
        """
        if self._times.size < 2:
            return
        lengths, running = np.diff(self._times), self._running[:-1]
        needed_ns = (used + waited) * float(self._times[-1] - self._times[0])
        of_callbacks_ns = min(float((running * lengths).sum()), needed_ns)
        waited_ns = of_callbacks_ns * waited / max(used + waited, 1e-9)

        def set_level(level: float) -> None:
            if waits_for == "others":
                self.others = 4.0 * self._cores * level
            elif waits_for == "each other":
                self.cores = self._cores - level * (self._cores - 1.0)

        low, high = 0.0, 1.0
        for _ in range(30):
            middle = (low + high) / 2
            set_level(middle)
            slow_ns = float((running * (1 - self._speed(running)) * lengths).sum())
            low, high = (middle, high) if slow_ns < waited_ns else (low, middle)
        set_level(low)
        self._integral = np.concatenate(([0.0], np.cumsum(self._speed(running) * lengths)))

    def _speed(self, running: Seconds) -> Seconds:
        # Where no callback runs, it is a thread between two callbacks that works.
        wanted = np.maximum(running, 1.0) + self.others
        speed: Seconds = np.minimum(1.0, self.cores / wanted)
        return speed

    def work_before(self, times_ns: Ints) -> Seconds:
        """The work, in ns, that a thread would have done up to each of some times."""
        return np.interp(times_ns, self._times, self._integral)

    def busy_s(self, processes: list[int]) -> float:
        """The time that callbacks of processes take, alone on a processor."""
        if self._times.size < 2:
            return 0.0
        running = sum(self._of_process[each] for each in processes if each in self._of_process)
        return float((np.diff(self._integral) * np.asarray(running)[:-1]).sum()) / 1e9
