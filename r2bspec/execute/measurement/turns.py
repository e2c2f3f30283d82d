"""One side of a comparison by turns: head and base are up at once and are played step by step.

The speed of a shared machine changes by a third within seconds, so that runs that follow each
other are measured on different machines; steps that follow each other within milliseconds are not.
So each side has its own processes, domain and player, and the schedules of both players interleave:
a step of one side, then a step of the other one. While a side is not played, it waits.

The sides are in two processes (`r2bspec.compare.side_process`). They meet at the same points in the
same order: `Partner.meet` waits for the other side and returns the answer of the comparison.
"""

from __future__ import annotations

import itertools
import shutil
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final, get_args

import msgspec
import numpy as np

from r2bspec.execute.errors import InterruptedRunError
from r2bspec.execute.processes.scheduling import on_core
from r2bspec.execute.start.segment_observation import SegmentObservation
from r2bspec.execute.start.segments import SegmentHeading, SegmentPlayer
from r2bspec.ipc.schedule import Turns
from r2bspec.judge.measure.matching import MatchedMonitor
from r2bspec.judge.measure.times import Seconds, seconds
from r2bspec.plan.plan import Plan, PlayPlan
from r2bspec.record.run_record import TurnKind

_FILLED_FILE: Final = "filled"


class Filled(msgspec.Struct, frozen=True):
    """The contents of the buffers.

    Attributes:
        provenance: the provenance of each recording that was read.
        played: the digest of the messages that are played.
    """

    provenance: tuple[dict[str, Any], ...]
    played: str


class PartnerLeftError(InterruptedRunError):
    """The other side of the comparison has failed, or the comparison has ended."""


@dataclass
class Partner:
    """The connection of a side to the comparison.

    Attributes:
        connection: to the process of the comparison.
        buffers: the folder of the messages that both sides play.
        makes_buffers: whether this side makes them.
    """

    connection: Connection
    buffers: Path
    makes_buffers: bool

    def meet(self, point: str, value: Any = None) -> Any:
        """Tell the comparison that this side has reached a point, and wait for its answer.

        Raises:
            PartnerLeftError: the comparison goes on without this side.
        """
        try:
            self.connection.send(("meet", point, value))
            kind, answer = self.connection.recv()
        except (EOFError, OSError) as error:
            raise PartnerLeftError("the comparison has ended") from error
        if kind != "go":
            raise PartnerLeftError("the other side of the comparison has failed")
        return answer

    def take_buffers(self, buffer_dir: Path) -> Filled | None:
        """Return the buffers of the other side for use here; None if this side has to make them.

        Args:
            buffer_dir: where the side has its buffers; an empty folder.

        Raises:
            PartnerLeftError: the side that makes them has failed.
        """
        if self.makes_buffers and not self.buffers.exists():
            return None
        self.meet("buffers")
        buffer_dir.rmdir()
        buffer_dir.symlink_to(self.buffers)
        return msgspec.json.decode((self.buffers / _FILLED_FILE).read_bytes(), type=Filled)

    def share_buffers(self, buffer_dir: Path, filled: Filled) -> None:
        """Offer the buffers that this side has made to both sides.

        Raises:
            PartnerLeftError: the other side has failed.
            OSError: the disk is full.
        """
        (buffer_dir / _FILLED_FILE).write_bytes(msgspec.json.encode(filled))
        shutil.move(buffer_dir, self.buffers)
        buffer_dir.symlink_to(self.buffers)
        self.meet("buffers")


def play_by_turns(plan: Plan, player: SegmentPlayer, partner: Partner) -> None:
    """Play each rate in turns with the other side, then on this side alone if required.

    Args:
        plan: the plan of one run of a pair.
        player: the player of the graph that is up and warm.
        partner: the other side.

    Raises:
        RunError: a process exited, failed, or does not respond.
        PartnerLeftError: the other side has failed.
    """
    for number, play in enumerate(plan.play, start=1):
        for kind in get_args(TurnKind):
            _play_turns(kind, play, number, player, partner)
        place: int | None = partner.meet("alone")
        for turn in range(2):
            if place == turn:
                _play_alone(player, play)
            partner.meet(f"alone-{turn}")


def _play_turns(
    kind: TurnKind, play: PlayPlan, number: int, player: SegmentPlayer, partner: Partner
) -> None:
    """Play a rate by turns, and again while the comparison asks for longer turns."""
    for attempt in itertools.count(1):
        turns: Turns | None = partner.meet("turns", (kind, play.rate_hz))
        if turns is None:
            return
        name = kind.replace("_", "-") + f"-{play.rate_hz:g}Hz"
        name += f"-{attempt}" if attempt > 1 else ""
        heading = SegmentHeading(kind, name, "by turns with the other side", number)
        with on_core(turns.core, player.graph_pids):
            played = player.play(heading, turns.pair_hz, len(turns.delays_ns), turns=turns)
        if not partner.meet("played", usual_step_s(played)):
            return


def usual_step_s(observed: SegmentObservation) -> float:
    """Return the third quartile of the duration of steps, for the slowest output, in seconds.

    0 if no output answers steps.
    """
    usual = (
        float(np.quantile(times, 0.75))
        for times in map(_latencies_s, observed.all_matched().values())
        if times.size
    )
    return max(usual, default=0.0)


def _play_alone(player: SegmentPlayer, play: PlayPlan) -> None:
    name = f"rate-{play.rate_hz:g}Hz" if play.rate_hz else "iteration"
    heading = SegmentHeading("iteration", f"{name}-001", "alone", 1)
    player.play_for(heading, play.rate_hz, play.duration_ns)


def _latencies_s(matched: MatchedMonitor) -> Seconds:
    if matched.match == "own_pace":
        return np.empty(0)
    matching, steps = matched.matching, matched.steps
    received_ns = matched.rows["received_ns"][matching.first_row[matching.answered]]
    return seconds(received_ns - steps["published_ns"][matching.trigger_steps[matching.answered]])
