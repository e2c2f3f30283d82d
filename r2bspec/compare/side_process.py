"""The two processes of a comparison by turns, one for each side, and how they meet.

Each side is played by the controller of an ordinary run (`r2bspec.execute.controller`), with its
own run folder, domain, processes and player. Controllers change the environment of their process
and handle its signals, so that each needs a process of its own, which serves all starts of a side.

In a start, both sides come to the same points in the same order
(`r2bspec.execute.measurement.turns`). Here is what they are answered: when the steps of either side
are due, and which side is played alone first.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import random
import secrets
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any, Final, NamedTuple

from r2bspec.compare.interleaved_comparison import STEPS, ComparisonSide
from r2bspec.execute.controller import RunOptions, run_plan
from r2bspec.execute.errors import RunError
from r2bspec.execute.measurement.turns import Partner, PartnerLeftError
from r2bspec.execute.processes.environment import applied_environment
from r2bspec.execute.states import Progress
from r2bspec.ipc.schedule import Turns
from r2bspec.plan.plan import Plan
from r2bspec.record.comparison_folder import Side
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import TurnKind
from r2bspec.safe_io.private_files import private_files

LONGEST_TURN_S: Final = 2.0
"""Where a step takes longer, the sides are not played by turns."""

_ROOM: Final = 1.5
"""A turn is so many times as long as three in four steps of the slower side took in the start
before. Where more than a quarter outlast their turns, they are played again with turns twice as
long: the work of such a step is counted with the next step, and the other side slows it down."""

_MOST_LENGTHENED: Final = 3
"""So many times turns become twice as long; then the sides are not played by turns."""

_LEAD_NS: Final = 150_000_000
"""From the answer to the first due time, so that both players have their schedules."""

TurnsOfRate = tuple[TurnKind, float]
"""What is played by turns, and the offered rate in hertz."""

_POLL_S: Final = 0.1
_END_TIMEOUT_S: Final = 60.0
_SIDES: Final[tuple[Side, Side]] = ("base", "head")


class SideStart(NamedTuple):
    """A start of one side: the plan of its run, and the folder that receives it."""

    plan: Plan
    folder: Path


def serve(connection: Connection, side: ComparisonSide, partner: Partner) -> None:
    """Play the starts of a side until the connection is closed."""
    with contextlib.suppress(EOFError, OSError, KeyboardInterrupt), private_files():
        while True:
            start: SideStart = connection.recv()
            try:
                with (
                    RunFolder.create(start.folder) as run_folder,
                    applied_environment(side.environment),
                ):
                    run_plan(
                        start.plan,
                        base_dir=side.base_dir,
                        folder=run_folder,
                        run_id=secrets.token_hex(8),
                        spec_text=side.spec_text,
                        progress=Progress(),
                        options=RunOptions(identity=side.identity, partner=partner),
                    )
            except Exception as error:
                connection.send(("ended", _sendable(error), None))
            else:
                connection.send(("ended", None, None))


def _sendable(error: Exception) -> Exception:
    """Return an error that another process can read: itself, or one with its text."""
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301 - it was made here
    except Exception:
        return RunError(f"{type(error).__name__}: {error}", hint=getattr(error, "hint", ""))
    return error


@dataclass
class _Channel:
    """A process of a side, as the comparison has it."""

    process: SpawnProcess
    connection: Connection
    ended: bool = False
    failure: Exception | None = None
    met: tuple[str, Any] | None = None


@dataclass
class BothSides:
    """The processes of both sides.

    Attributes:
        seed: the seed of the coin that decides each pair of steps.
        turns: what is played by turns at each rate.
        alone: the sides that are also played alone in each start, at each rate.
        cores: those on which work is measured, one in each start.
        too_long: why a rate could not be played by turns; both sides are then played alone.
    """

    seed: int
    turns: tuple[TurnKind, ...]
    alone: frozenset[Side]
    cores: tuple[int, ...]
    channels: Mapping[Side, _Channel]
    too_long: str = ""
    _start: int = field(default=0, init=False)
    _turn_s: dict[TurnsOfRate, float] = field(default_factory=dict, init=False)
    _played: TurnsOfRate = field(default=("turns", 0.0), init=False)
    _lengthened: int = field(default=0, init=False)

    def play(
        self, starts: Mapping[Side, SideStart], check: Callable[[], None]
    ) -> dict[Side, Exception]:
        """Play a start of both sides.

        Args:
            starts: the starts of either side.
            check: is called several times a second, and raises an error to end the start.

        Returns:
            What failed, by side; a side that only ended because the other one failed is left out.
        """
        self._start += 1
        self._lengthened = 0
        for side, channel in self.channels.items():
            channel.ended, channel.failure, channel.met = False, None, None
            channel.connection.send(starts[side])
        while not all(channel.ended for channel in self.channels.values()):
            check()
            for channel in self._readable():
                self._receive(channel)
            self._answer()
        return {
            side: channel.failure
            for side, channel in self.channels.items()
            if channel.failure is not None and not isinstance(channel.failure, PartnerLeftError)
        }

    def _readable(self) -> Iterator[_Channel]:
        running = {
            channel.connection: channel for channel in self.channels.values() if not channel.ended
        }
        for connection in wait(list(running), timeout=_POLL_S):
            yield running[connection]  # type: ignore[index]

    def _receive(self, channel: _Channel) -> None:
        try:
            kind, first, second = channel.connection.recv()
        except (EOFError, OSError):
            channel.ended = True
            channel.failure = RunError("the process that plays this side was ended")
            return
        if kind == "meet":
            channel.met = (first, second)
        else:
            channel.ended, channel.failure = True, first

    def _answer(self) -> None:
        """Answer both sides once they have come to the same point; one alone cannot go on."""
        waiting = {side: each for side, each in self.channels.items() if each.met is not None}
        if len(waiting) == len(self.channels):
            points = {side: each.met for side, each in waiting.items() if each.met is not None}
            answers = self._answers(points)
            for side, channel in waiting.items():
                channel.met = None
                channel.connection.send(("go", answers[side]))
        elif waiting and any(channel.ended for channel in self.channels.values()):
            for channel in waiting.values():
                channel.met = None
                channel.connection.send(("end", None))

    def _answers(self, points: Mapping[Side, tuple[str, Any]]) -> Mapping[Side, Any]:
        (point, head), (_, base) = points["head"], points["base"]
        if point == "turns":
            return self._turns(head)
        if point == "played":
            return dict.fromkeys(_SIDES, self._again(max(head, base)))
        if point == "alone":
            order = [side for side in _SIDES if side in self._alone()]
            self._coin("alone").shuffle(order)
            return {side: order.index(side) if side in order else None for side in _SIDES}
        return dict.fromkeys(_SIDES)

    def _alone(self) -> frozenset[Side]:
        return frozenset(_SIDES) if self.too_long else self.alone

    def _coin(self, what: str) -> random.Random:
        return random.Random(f"{self.seed}/{self._start}/{what}")  # noqa: S311 - no secret

    def _turns(self, asked: TurnsOfRate) -> Mapping[Side, Turns | None]:
        """Return when each side is played: a coin decides the order in each pair of steps."""
        kind, rate_hz = asked
        if kind not in self.turns:
            return dict.fromkeys(_SIDES)
        if not rate_hz:
            self.too_long = "the recording has its own times"
            return dict.fromkeys(_SIDES)
        turn_s = self._turn_s.setdefault(asked, 0.5 / rate_hz)
        if turn_s > LONGEST_TURN_S or self._lengthened > _MOST_LENGTHENED:
            self._lengthened = 0
            self.too_long = f"a turn would take {turn_s:.1f} s"
            return dict.fromkeys(_SIDES)
        turn_ns = round(turn_s * 1e9)
        coin = self._coin(f"{kind}/{rate_hz:g}")
        base_first = [coin.random() < 0.5 for _ in range(STEPS)]
        begin_ns = time.monotonic_ns() + _LEAD_NS
        delays = {
            "base": tuple(0 if first else turn_ns for first in base_first),
            "head": tuple(turn_ns if first else 0 for first in base_first),
        }
        self._played = asked
        core = self.cores[self._start % len(self.cores)] if kind == "work_turns" else None
        return {side: Turns(begin_ns, 0.5e9 / turn_ns, delays[side], core) for side in _SIDES}

    def _again(self, step_s: float) -> bool:
        """Choose the length of the next turns; True if those of now are played again."""
        (_, rate_hz), turn_s = self._played, self._turn_s[self._played]
        if step_s > turn_s:
            self._turn_s[self._played] = 2 * turn_s
            self._lengthened += 1
            return True
        self._turn_s[self._played] = max(0.5 / rate_hz, _ROOM * step_s)
        self._lengthened = 0
        return False


def _free_cores(sides: Mapping[Side, ComparisonSide]) -> tuple[int, ...]:
    """Return the cores that no process of either side has to itself; all if there are none."""
    allowed = os.sched_getaffinity(0)
    taken = {cpu for side in sides.values() for each in side.plan.processes for cpu in each.cpus}
    return tuple(sorted(allowed - taken or allowed))


@contextlib.contextmanager
def both_sides(
    sides: Mapping[Side, ComparisonSide],
    buffers: Path,
    *,
    buffers_of: Side,
    seed: int,
    turns: tuple[TurnKind, ...],
    alone: frozenset[Side],
) -> Iterator[BothSides]:
    """Start a process for each side, and end both after the block.

    Args:
        sides: the sides of the comparison.
        buffers: a folder that does not exist yet; has the messages that both sides play.
        buffers_of: the side whose recording and preprocessors make them.
        seed: the seed of the coins.
        turns: see `BothSides`, and likewise for `alone`.
        alone: sides.
    """
    context = multiprocessing.get_context("spawn")
    channels: dict[Side, _Channel] = {}
    try:
        for side in _SIDES:
            ours, theirs = context.Pipe()
            partner = Partner(theirs, buffers, makes_buffers=side == buffers_of)
            process = context.Process(target=serve, args=(theirs, sides[side], partner))
            process.start()
            theirs.close()
            channels[side] = _Channel(process, ours)
        yield BothSides(seed, turns, alone, _free_cores(sides), channels)
    finally:
        for channel in channels.values():
            channel.connection.close()
            if not channel.ended and channel.process.pid is not None:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(channel.process.pid, signal.SIGINT)
        for channel in channels.values():
            channel.process.join(_END_TIMEOUT_S)
            if channel.process.is_alive():
                channel.process.kill()
