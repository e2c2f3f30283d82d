"""Where the time of a run went: its phases, and what was waited for in each."""

from __future__ import annotations

import msgspec


class WaitTime(msgspec.Struct, frozen=True, kw_only=True):
    """All waits of the controller for the same thing in one phase.

    Attributes:
        what: such as ``relay: ready``, or ``answers after the last input``.
        count: how often it was waited for.
        took_ns: for how long, all together.
    """

    what: str
    count: int
    took_ns: int


class PhaseTime(msgspec.Struct, frozen=True, kw_only=True):
    """A phase of a run; phases follow each other without gaps. Times are CLOCK_MONOTONIC.

    Attributes:
        name: as in the events of the record; ``prepare`` before the first of them.
        began_ns: when it began.
        ended_ns: when it ended.
        cpu_ns: the processor time of the controller in it.
        waits: the longest first. What is left of the phase is work of the controller.
    """

    name: str
    began_ns: int
    ended_ns: int
    cpu_ns: int
    waits: tuple[WaitTime, ...] = ()

    @property
    def took_ns(self) -> int:
        """From its beginning to its end."""
        return self.ended_ns - self.began_ns
