"""Pairs of a base and a head, the units of a comparison: in new processes and own folders.

If the load permits it, both sides of a pair are up at once and are played by turns
(`r2bspec.compare.side_process`); they share the loaded data. Otherwise they are played one after
the other. A coin decides which side of a pair is first; its seed is in the record, and so is each
order (`r2bspec.judge.statistics.t_interval` has the reason).

Every such run is a complete one (`r2bspec.execute.controller`): it loads, starts, warms up, plays
each rate once, and ends all that it started. Sharing the loaded data would save a second or two,
and would give the second run of a pair warmer caches than the first.

All pairs are in one list, which policies extend (`r2bspec.execute.experiment`). If they fail, half
as many more confirm it, judged together with all before them.
"""

from __future__ import annotations

import contextlib
import datetime
import secrets
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from r2bspec.compare.interleaved_comparison import (
    NOTHING_BY_TURNS,
    BaseFailsError,
    ComparisonSide,
    ComparisonSpec,
)
from r2bspec.compare.report_input import judge_comparison_folder, read_pairs
from r2bspec.compare.side_process import BothSides, SideStart, both_sides
from r2bspec.errors import R2bspecError, without_output
from r2bspec.execute.controller import RunOptions, run_plan
from r2bspec.execute.errors import InterruptedRunError, RunError
from r2bspec.execute.experiment import Experiment, confirm, grow
from r2bspec.execute.processes.environment import applied_environment
from r2bspec.execute.processes.machine import check_machine
from r2bspec.execute.states import Interrupts, Progress
from r2bspec.judge import pair_comparison
from r2bspec.judge.decision_policy import decision_policy
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.result import Result
from r2bspec.judge.statistics.t_interval import PairOrder, pair_orders
from r2bspec.judge.verdict import Verdict
from r2bspec.language.secrets import shown_value
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.plan.comparability import single_run_plan
from r2bspec.plan.interim_looks import InterimLooks, pairs_that_confirm
from r2bspec.plan.plan import Plan
from r2bspec.plan.time_estimate import BOTH_SIDES
from r2bspec.record.comparison_folder import (
    ComparisonFolder,
    PairedComparison,
    PairRecord,
    PairsRecord,
    Side,
    open_comparison,
)
from r2bspec.record.run_folder import Run, RunFolder, open_run
from r2bspec.safe_io.private_files import private_files, remove_folder

_BUFFERS = ".buffers"
_KILLED = "R2B671: the comparison was killed"


def compare(comparison: ComparisonSpec, output: Path, progress: Progress | None = None) -> Result:
    """Play interleaved pairs on real ROS 2, and judge them.

    Args:
        comparison: to be made.
        output: the folder of the comparison, new or empty.
        progress: is notified of progress.

    Raises:
        RunError: a run failed; the folder has the pairs finished until then.
        OtherMachineError: this machine is not what the spec requires.
        RecordError: the folder cannot be created.
    """
    check_machine(comparison.head.plan)
    with private_files(), ComparisonFolder.create(output) as folder:
        try:
            measured = run_pairs(comparison, folder, progress or Progress())
        except R2bspecError:
            # Write a result of what was measured, marked as incomplete; if that fails, too, the
            # first failure is reported.
            with contextlib.suppress(R2bspecError, OSError):
                _write_result(folder)
            raise
        return _write_result(folder, measured)


def _write_result(
    folder: ComparisonFolder, measured: dict[str, RunSamples] | None = None
) -> Result:
    pairs = open_comparison(folder.path)
    result = judge_comparison_folder(pairs, measured=measured).result
    folder.write_result(to_json(result))
    return result


def run_pairs(
    comparison: ComparisonSpec, folder: ComparisonFolder, progress: Progress
) -> dict[str, RunSamples]:
    """Play all pairs and, if they fail, as many new pairs to confirm it.

    The folder is complete when this returns or raises: it has every pair that was finished.

    Args:
        comparison: to be made.
        folder: the folder of the comparison.
        progress: is notified of progress.

    Returns:
        What was measured, by the folders of the runs.

    Raises:
        RunError: a run failed twice, or cannot be made here at all.
        InterruptedRunError: the comparison was interrupted by a signal.
    """
    folder.write_plan(canonical_json(comparison.head.plan).decode())
    folder.write_base_plan(comparison.base.plan)
    folder.write_spec(comparison.head.spec_text)
    with Interrupts() as interrupts:
        pairs = _Pairs(comparison, folder, progress, interrupts)
        with pairs.by_turns():
            pairs.play_all()
    return pairs.measured


def _is_interrupted(failures: Mapping[Side, Exception]) -> bool:
    return any(isinstance(error, InterruptedRunError) for error in failures.values())


class Pair(NamedTuple):
    """A pair to be played; `why_again` is empty for the first time."""

    number: int
    order: PairOrder
    why_again: str = ""


class _Pairs(Experiment[Pair]):
    """The pairs of one comparison.

    Attributes:
        measured: the samples of its runs, by their folders: each is read once.
    """

    def __init__(
        self,
        comparison: ComparisonSpec,
        folder: ComparisonFolder,
        progress: Progress,
        interrupts: Interrupts,
    ) -> None:
        self._comparison, self._folder = comparison, folder
        self._progress, self._interrupts = progress, interrupts
        self._began_s = time.monotonic()
        self._plans: dict[Side, Plan] = {
            "base": single_run_plan(comparison.base.plan),
            "head": single_run_plan(comparison.head.plan),
        }
        self.measured: dict[str, RunSamples] = {}
        self._opened: dict[str, Run] = {}
        self._pairs: list[PairRecord] = []
        self._notes: list[str] = []
        self._confirmed_from = self._fresh = 0
        self._started_at = _now()
        self._run_id = secrets.token_hex(8)
        self._seed = secrets.randbits(32)
        self._both: BothSides | None = None

    @contextlib.contextmanager
    def by_turns(self) -> Iterator[None]:
        """Have the processes of both sides, if they can be played by turns."""
        comparison = self._comparison
        if comparison.alternates:
            if comparison.alternates != NOTHING_BY_TURNS:
                self._note(f"the sides are played one after the other: {comparison.alternates}")
            yield
            return
        sides: dict[Side, ComparisonSide] = {"base": comparison.base, "head": comparison.head}
        with both_sides(
            sides,
            self._folder.path / _BUFFERS,
            buffers_of=comparison.buffers_of,
            seed=self._seed,
            turns=comparison.turns,
            alone=frozenset({"base", "head"} if comparison.needs_base_alone else {"head"}),
        ) as self._both:
            try:
                yield
            finally:
                remove_folder(self._folder.path / _BUFFERS)

    def play_all(self) -> None:
        """Play pairs until they decide, and write the record in any case."""
        reason, exit_status = "", 0
        self._write_record(_KILLED)
        try:
            self.carry_out(grow, confirm)
        except R2bspecError as error:
            reason, exit_status = f"{error.code}: {error}", error.exit_code
            raise
        except BaseException as error:
            reason = f"{type(error).__name__}: {error}"
            raise
        finally:
            self._write_record(reason, exit_status)

    # What the policies ask for.

    def planned(self) -> Sequence[Pair]:
        """See `Experiment`."""
        number = self._fresh or self._comparison.pairs
        orders = pair_orders(number, self._seed, session=int(self._fresh > 0))
        return [Pair(*each) for each in enumerate(orders, start=self._confirmed_from + 1)]

    @property
    def looks(self) -> InterimLooks | None:
        """See `Experiment`; pairs of runs are judged when all have been played."""
        return self._counted_pairs().looks if self._both is not None else None

    def complete(self) -> int:
        """See `Experiment`: the pairs that can be judged."""
        return len(self._counted_pairs().head)

    def _judge(self) -> Verdict:
        plan = self._comparison.head.plan
        return pair_comparison.judge_pairs(
            plan.objectives, self._counted_pairs(), decision_policy(plan)
        )

    def on_decision(self) -> None:
        """See `Experiment`."""
        self._note(f"decided after {self._number} of {self._last_number} {self._noun}")

    def has_time(self, *, was_judged: bool) -> bool:
        """See `Experiment`; a confirmation that has begun is completed."""
        del was_judged
        return self._fresh > 0 or not self._is_over_budget(self._number)

    def unusable(self) -> Pair | None:
        """See `Experiment`."""
        last = self._pairs[-1]
        return Pair(last.number, last.order, last.unusable) if last.unusable else None

    def begin_confirmation(self) -> bool:
        """See `Experiment`."""
        if not self._comparison.head.plan.gate.confirm:
            return False
        self._confirmed_from = self._number
        self._fresh = pairs_that_confirm(self._number)
        self._note(f"it fails after {self._number} {self._noun}: {self._fresh} more confirm it")
        return True

    @property
    def _noun(self) -> str:
        return "pairs" if self._both is None else "starts of both sides"

    @property
    def _number(self) -> int:
        """The number of the last pair."""
        return max((pair.number for pair in self._pairs), default=0)

    @property
    def _last_number(self) -> int:
        """The number of the last pair that may be played."""
        return self._confirmed_from + (self._fresh or self._comparison.pairs)

    def _counted_pairs(self) -> pair_comparison.Pairs:
        """Return the pairs that count so far, as if the comparison ended now."""
        head, base = self._comparison.head.plan, self._comparison.base.plan
        # On disk it is incomplete while it is played.
        pairs = PairedComparison(self._folder.path, self._record(), head, base, self._opened)
        return read_pairs(pairs, self.measured)

    def _is_over_budget(self, played: int) -> bool:
        """Return whether one more pair would exceed the time budget of the spec."""
        budget_ns = self._comparison.head.plan.gate.time_budget_ns
        if not budget_ns:
            return False
        spent_s = time.monotonic() - self._began_s
        if spent_s * (played + 1) / played <= budget_ns / 1e9:
            return False
        self._note(f"the time budget ended the comparison after {played} pairs")
        return True

    # How a pair is played.

    def play(self, unit: Pair) -> None:
        """Play a pair; it is in the record afterwards."""
        if unit.why_again:
            # The record has all of it; a side that fails again is an error that has it, too.
            self._note(f"pair {unit.number} is played again: {without_output(unit.why_again)}")
        if self._both is None or not self._play_both(self._both, unit):
            self._play_in_turn(unit)
        if unit.why_again and (unusable := self._pairs[-1].unusable):
            self._note(f"pair {unit.number}, played again, cannot be judged: {unusable}")

    def _play_in_turn(self, unit: Pair) -> None:
        """Play one side, then the other one."""
        sides: tuple[Side, Side] = ("base", "head") if unit.order == "AB" else ("head", "base")
        confirms = ", confirmation" if self._fresh else ""
        unusable = ""
        for side in sides:
            self._progress.note(f"pair {unit.number} of {self._last_number}{confirms}: {side}")
            try:
                problem = self._run(side, _folder_name(unit))
            except RunError as error:
                # A failed run is repeated once, unless it was interrupted or cannot work here.
                if error.exit_code != RunError.exit_code or unit.why_again:
                    if side == "base" and not isinstance(error, InterruptedRunError):
                        raise BaseFailsError.of(error) from error
                    raise
                unusable = f"the {side} failed: {error}"
                break
            unusable = unusable or (problem and f"{side}: {problem}")
        self._add_pair(unit, unusable)

    def _play_both(self, both: BothSides, unit: Pair) -> bool:
        """Play both sides by turns; False if the first such start shows that this cannot be."""
        title = f"start {unit.number} of at most {self._last_number}, of both sides"
        self._progress.phase(BOTH_SIDES, title)
        starts: dict[Side, SideStart] = {
            side: SideStart(self._plans[side], self._folder.path / side / _folder_name(unit))
            for side in ("base", "head")
        }
        failures = both.play(starts, self._interrupts.check)
        self._interrupts.check()
        if failures and unit.number == 1 and not unit.why_again and not _is_interrupted(failures):
            # Two at once can need what one has alone: memory, a device, a port.
            self._both = None
            side, error = next(iter(failures.items()))
            self._note(
                f"the sides are played one after the other: beside the other one, {side}: "
                f"{without_output(str(error))}"
            )
            for start in starts.values():
                remove_folder(start.folder)
            return False
        unusable = ""
        for side, error in failures.items():
            certain = getattr(error, "exit_code", None) != RunError.exit_code
            if isinstance(error, InterruptedRunError) or not isinstance(error, RunError):
                raise error
            if certain or unit.why_again:
                raise BaseFailsError.of(error) if side == "base" else error
            unusable = f"the {side} failed: {error}"
        for side in ("base", "head") if not unusable else ():
            problem = self._read_run(side, _folder_name(unit))
            unusable = unusable or (problem and f"{side}: {problem}")
        if both.too_long and unit.number == 1:
            self._note(f"the sides are not played by turns: {both.too_long}")
        self._add_pair(unit, unusable)
        return True

    def _run(self, side: Side, name: str) -> str:
        """Make a run; return why it cannot be judged, or nothing."""
        self._interrupts.check()
        side_run = self._comparison.base if side == "base" else self._comparison.head
        with (
            RunFolder.create(self._folder.path / side / name) as folder,
            applied_environment(side_run.environment),
        ):
            run_plan(
                self._plans[side],
                base_dir=side_run.base_dir,
                folder=folder,
                run_id=secrets.token_hex(8),
                spec_text=side_run.spec_text,
                progress=self._progress,
                options=RunOptions(identity=side_run.identity, top=side_run.top),
            )
        return self._read_run(side, name)

    def _read_run(self, side: Side, name: str) -> str:
        """Read a finished run; see `_run`."""
        folder = self._folder.path / side / name
        if self._comparison.check_run is not None:
            self._comparison.check_run(side, folder)
        self._interrupts.check()
        run = open_run(folder)
        samples = read_samples(run)
        self._opened[f"{side}/{name}"], self.measured[f"{side}/{name}"] = run, samples
        return pair_comparison.why_unusable(samples)

    # What is recorded.

    def _add_pair(self, unit: Pair, unusable: str) -> None:
        name = _folder_name(unit)
        self._pairs.append(
            PairRecord(
                number=unit.number,
                order=unit.order,
                base=f"base/{name}",
                head=f"head/{name}",
                again=bool(unit.why_again),
                unusable=unusable,
            )
        )
        self._write_record(_KILLED)

    def _note(self, text: str) -> None:
        self._notes.append(text)
        self._progress.note(text)

    def _write_record(self, reason: str, exit_status: int = 0) -> None:
        self._folder.write_pairs(self._record(reason, exit_status))

    def _record(self, reason: str = "", exit_status: int = 0) -> PairsRecord:
        comparison = self._comparison
        return PairsRecord(
            run_id=self._run_id,
            head_plan=plan_hash(comparison.head.plan),
            base_plan=plan_hash(comparison.base.plan),
            against=comparison.against,
            control=comparison.control,
            seed=self._seed,
            planned=comparison.pairs,
            started_at=self._started_at,
            ended_at=_now(),
            status="incomplete" if reason else "complete",
            reason=reason,
            exit_status=exit_status,
            pairs=tuple(self._pairs),
            differences=comparison.differences,
            gate=comparison.gate,
            by_turns=self._both is not None,
            confirmed_from=self._confirmed_from,
            fresh=self._fresh,
            # That of a work tree leads to its code, and is no difference that matters.
            environment={
                name: shown_value(name, value)
                for name, value in comparison.base.environment.items()
                if comparison.check_run is None
            },
            notes=tuple(self._notes),
        )


def _folder_name(unit: Pair) -> str:
    return f"{unit.number:03d}{'-again' if unit.why_again else ''}"


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
