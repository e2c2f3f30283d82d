"""Runs of a base and a head: in pairs, each in new processes and with its own folder.

Where the load permits it, both sides of a pair are up at once and are played by turns
(`r2bspec.compare.side_process`); they share the loaded data. Otherwise one follows the other:

A coin decides which side of a pair is first; its seed is in the record, and so is each order
(`r2bspec.judge.statistics.t_interval` has the reason).

Every such run is a complete one (`r2bspec.execute.controller`): it loads, starts, warms up, plays
each rate once, and ends all that it started. Sharing the loaded data would save a second or two,
and would give the second run of a pair warmer caches than the first.
"""

from __future__ import annotations

import contextlib
import datetime
import secrets
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from r2bspec.compare.interleaved_comparison import (
    NOTHING_BY_TURNS,
    BaseFailsError,
    ComparisonSide,
    ComparisonSpec,
)
from r2bspec.compare.report_input import judge_comparison_folder, read_pair_set
from r2bspec.compare.side_process import BothSides, both_sides
from r2bspec.errors import R2bspecError, without_output
from r2bspec.execute.controller import RunOptions, run_plan
from r2bspec.execute.errors import InterruptedRunError, RunError
from r2bspec.execute.processes.environment import applied_environment
from r2bspec.execute.processes.machine import check_machine
from r2bspec.execute.progress import Progress
from r2bspec.execute.states import Interrupts
from r2bspec.judge import pair_comparison
from r2bspec.judge.confirmation import needs_confirmation
from r2bspec.judge.decision_policy import DecisionPolicy, decide_after_look, decision_policy
from r2bspec.judge.judge_run import to_json
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.result import Result
from r2bspec.judge.statistics.t_interval import PairOrder, pair_orders
from r2bspec.judge.verdict import RequirementKey, Verdict
from r2bspec.language.secrets import shown_value
from r2bspec.language.spec import Objective
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.plan.comparability import single_run_plan
from r2bspec.plan.plan import Plan
from r2bspec.record.comparison_folder import (
    ComparisonFolder,
    PairRecord,
    PairsRecord,
    Side,
    open_comparison,
)
from r2bspec.record.run_folder import Run, RunFolder, open_run
from r2bspec.safe_io.private_files import private_files, remove_folder

_MAX_AFFECTED_RERUNS = 2
"""Reruns that are affected again. After that the machine counts as always busy."""


_LEAST_FRESH_STARTS = 3
"""Of both sides, that confirm a failure."""

_BUFFERS = ".buffers"


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
    """Play all pairs and, if they fail, as many new ones to confirm it.

    The folder is complete when this returns or raises: it has every pair that was finished.

    Args:
        comparison: to be made.
        folder: of the comparison.
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
        runner = _PairRunner(comparison, folder, progress, interrupts)
        with runner.by_turns():
            runner.play_all()
    return runner.measured


def _is_interrupted(failures: Mapping[Side, Exception]) -> bool:
    return any(isinstance(error, InterruptedRunError) for error in failures.values())


@dataclass
class _PairRunner:
    """The state of one comparison.

    Attributes:
        measured: the samples of its runs, by their folders: each is read once.
    """

    _comparison: ComparisonSpec
    _folder: ComparisonFolder
    _progress: Progress
    _interrupts: Interrupts
    measured: dict[str, RunSamples] = field(default_factory=dict)
    _opened: dict[str, Run] = field(default_factory=dict)

    def __post_init__(self) -> None:
        comparison = self._comparison
        self._began_s = time.monotonic()
        self._plans: dict[Side, Plan] = {
            "base": single_run_plan(comparison.base.plan),
            "head": single_run_plan(comparison.head.plan),
        }
        self._pairs: list[PairRecord] = []
        self._notes: list[str] = []
        self._failed: set[RequirementKey] = set()
        self._planned = comparison.pairs
        self._started_at = _now()
        self._run_id = secrets.token_hex(8)
        self._seed = secrets.randbits(32)
        self._both: BothSides | None = None
        self._confirmed_from = 0

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
            self._plans,
            self._folder.path / _BUFFERS,
            buffers_of=comparison.buffers_of,
            seed=self._seed,
            alone=frozenset({"base", "head"} if comparison.needs_base_alone else {"head"}),
        ) as self._both:
            try:
                yield
            finally:
                remove_folder(self._folder.path / _BUFFERS)

    def play_all(self) -> None:
        """Play pairs until they decide, and write the record in any case."""
        reason, exit_status = "", 0
        self._write_record("R2B671: the comparison was killed")
        try:
            verdict = self._play_pairs(confirms=False)
            if self._both is not None:
                return
            if self._comparison.head.plan.gate.confirm and needs_confirmation(verdict):
                self._note("the comparison failed: new pairs are played to confirm it")
                self._failed = verdict.failed_keys
                self._play_pairs(confirms=True)
        except R2bspecError as error:
            reason, exit_status = f"{error.code}: {error}", error.exit_code
            raise
        except BaseException as error:
            reason = f"{type(error).__name__}: {error}"
            raise
        finally:
            self._write_record(reason, exit_status)

    def _play_pairs(self, *, confirms: bool) -> Verdict:
        """Play the pairs of a session, and again the affected ones that the outcome depends on."""
        disturbed: list[PairRecord] = []
        orders = pair_orders(self._planned, self._seed, session=int(confirms))
        for place, order in enumerate(orders, start=1):
            pair = self._play(place, order, confirms=confirms)
            if pair.unusable:
                self._play_again(pair, pair.unusable)
            elif pair.disturbed:
                disturbed.append(pair)
            if self._is_decided(place, confirms=confirms):
                break
            if not confirms and place < self._planned and self._over_budget(place):
                break
        self._write_record("")
        if self._both is not None:
            return self._confirm_by_turns(self._both, len({pair.number for pair in self._pairs}))
        return self._play_affected_again(disturbed, confirms=confirms)

    def _confirm_by_turns(self, both: BothSides, played: int) -> Verdict:
        """Play half as many starts again after a failure, in the same list; the verdict on all."""
        verdict, _ = self._judge(confirms=False)
        if not self._comparison.head.plan.gate.confirm or not needs_confirmation(verdict):
            return verdict
        self._confirmed_from = played
        self._planned = played + max(_LEAST_FRESH_STARTS, played // 2)
        self._note(f"it fails after {played} starts: {self._planned - played} more confirm it")
        orders = pair_orders(self._planned, self._seed)
        for place in range(played + 1, self._planned + 1):
            pair = self._play_both(both, place, orders[place - 1], again=False)
            if pair.unusable:
                self._play_again(pair, pair.unusable)
        self._write_record("")
        return self._judge(confirms=False)[0]

    def _is_decided(self, played: int, *, confirms: bool) -> bool:
        """Whether the pairs so far decide all that counts; those that come later are left out."""
        if played == self._planned:
            return False
        pair_set, objectives, policy = self._session(confirms=confirms)
        looks, usable = pair_set.looks, len(pair_set.played.head)
        if looks is None or usable not in looks.iterations:
            return False
        verdict = pair_comparison.judge_pair_set(objectives, pair_set, policy)
        counted = [
            requirement
            for requirement in verdict.requirements
            if requirement.level == "error" and (not confirms or requirement.key in self._failed)
        ]
        if decide_after_look(looks, looks.completed_looks(usable), counted) == "go on":
            return False
        noun = "pairs" if self._both is None else "starts of both sides"
        self._note(f"decided after {played} of {self._planned} {noun}")
        return True

    def _play_affected_again(self, disturbed: Sequence[PairRecord], *, confirms: bool) -> Verdict:
        """Play affected pairs again while that can change the outcome; the verdict afterwards."""
        verdict, may_change = self._judge(confirms=confirms)
        affected_reruns = 0
        for pair in disturbed:
            if not may_change or self._over_budget(len(self._pairs)):
                break
            if affected_reruns == _MAX_AFFECTED_RERUNS:
                self._note(
                    f"{affected_reruns} pairs were affected again: the machine is always busy, "
                    "and no more pairs are played again"
                )
                break
            again = self._play_again(pair, f"host interference ({pair.disturbed})")
            affected_reruns += bool(again.disturbed or again.unusable)
            self._write_record("")
            verdict, may_change = self._judge(confirms=confirms)
        return verdict

    def _judge(self, *, confirms: bool) -> tuple[Verdict, bool]:
        """The verdict on a session, and whether reruns of affected pairs can change its outcome."""
        pair_set, objectives, policy = self._session(confirms=confirms)
        verdict = pair_comparison.judge_pair_set(objectives, pair_set, policy)
        return verdict, pair_comparison.reruns_can_decide(verdict, objectives, pair_set, policy)

    def _session(
        self, *, confirms: bool
    ) -> tuple[pair_comparison.PairSet, Mapping[str, Objective], DecisionPolicy]:
        """The pairs of a session so far, and by what they are judged."""
        pairs = open_comparison(self._folder.path, self._opened)
        objectives: Mapping[str, Objective] = pairs.plan.objectives
        policy = decision_policy(pairs.plan)
        if confirms:
            objectives, policy = pair_comparison.confirmation_terms(objectives, policy)
        return read_pair_set(pairs, self.measured, confirms=confirms), objectives, policy

    def _play_again(self, pair: PairRecord, why: str) -> PairRecord:
        # The record has all of it; a side that fails again is an error that has it, too.
        self._note(f"pair {pair.number} is played again: {without_output(why)}")
        again = self._play(pair.number, pair.order, confirms=pair.confirms, again=True)
        if again.unusable:
            self._note(f"pair {pair.number} again cannot be judged: {again.unusable}")
        return again

    def _play(
        self, number: int, order: PairOrder, *, confirms: bool, again: bool = False
    ) -> PairRecord:
        """Play one pair; it is in the record afterwards."""
        if self._both is not None:
            return self._play_both(self._both, number, order, again=again)
        name = f"{'confirm-' if confirms else ''}{number:03d}{'-again' if again else ''}"
        sides: tuple[Side, Side] = ("base", "head") if order == "AB" else ("head", "base")
        unusable, disturbed = "", ""
        for side in sides:
            title = f"pair {number} of {self._planned}{', confirmation' if confirms else ''}"
            self._progress.note(f"{title}: {side}")
            try:
                pair_run = self._run(side, name)
            except RunError as error:
                # A failed run is repeated once, unless it was interrupted or cannot work here.
                if error.exit_code != RunError.exit_code or again:
                    if side == "base" and not isinstance(error, InterruptedRunError):
                        raise BaseFailsError.of(error) from error
                    raise
                unusable = f"the {side} failed: {error}"
                break
            unusable = unusable or (pair_run[0] and f"{side}: {pair_run[0]}")
            if pair_run[1]:
                disturbed += f"{'; ' if disturbed else ''}{side}: {pair_run[1]}"
        return self._add_pair(
            name,
            number=number,
            order=order,
            again=again,
            confirms=confirms,
            unusable=unusable,
            disturbed=disturbed,
        )

    def _add_pair(self, name: str, **fields: Any) -> PairRecord:
        """Return the pair whose runs are in the folders of this name; it is in the record."""
        pair = PairRecord(base=f"base/{name}", head=f"head/{name}", **fields)
        self._pairs.append(pair)
        self._write_record("R2B671: the comparison was killed")
        return pair

    def _play_both(
        self, both: BothSides, number: int, order: PairOrder, *, again: bool
    ) -> PairRecord:
        """Play one start of both sides by turns; it is in the record afterwards."""
        name = f"{number:03d}{'-again' if again else ''}"
        self._progress.note(f"start {number} of at most {self._planned}, of both sides")
        folders: dict[Side, Path] = {
            side: self._folder.path / side / name for side in ("base", "head")
        }
        failures = both.play(folders, self._interrupts.check)
        self._interrupts.check()
        if failures and number == 1 and not again and not _is_interrupted(failures):
            # Two at once can need what one has alone: memory, a device, a port.
            self._both = None
            side, error = next(iter(failures.items()))
            self._note(
                f"the sides are played one after the other: beside the other one, {side}: "
                f"{without_output(str(error))}"
            )
            for folder in folders.values():
                remove_folder(folder)
            return self._play(number, order, confirms=False)
        unusable = ""
        for side, error in failures.items():
            certain = getattr(error, "exit_code", None) != RunError.exit_code
            if isinstance(error, InterruptedRunError) or not isinstance(error, RunError):
                raise error
            if certain or again:
                raise BaseFailsError.of(error) if side == "base" else error
            unusable = f"the {side} failed: {error}"
        for side in ("base", "head") if not unusable else ():
            why = self._read_run(side, name)[0]
            unusable = unusable or (why and f"{side}: {why}")
        if both.too_long and number == 1:
            self._note(f"the sides are not played by turns: {both.too_long}")
        return self._add_pair(name, number=number, order=order, again=again, unusable=unusable)

    def _run(self, side: Side, name: str) -> tuple[str, str]:
        """One run: why it cannot be judged, and which interference affected it, or empty texts."""
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

    def _read_run(self, side: Side, name: str) -> tuple[str, str]:
        """Read a finished run; see `_run`."""
        folder = self._folder.path / side / name
        if self._comparison.check_run is not None:
            self._comparison.check_run(side, folder)
        self._interrupts.check()
        run = open_run(folder)
        samples = read_samples(run)
        self._opened[f"{side}/{name}"], self.measured[f"{side}/{name}"] = run, samples
        return pair_comparison.why_unusable(samples), pair_comparison.interference_text(samples)

    def _over_budget(self, played: int) -> bool:
        """Whether one more pair would exceed the time budget of the spec."""
        budget_ns = self._comparison.head.plan.gate.time_budget_ns
        if not budget_ns:
            return False
        spent_s = time.monotonic() - self._began_s
        if spent_s * (played + 1) / played <= budget_ns / 1e9:
            return False
        self._note(f"the time budget ended the comparison after {played} pairs")
        return True

    def _note(self, text: str) -> None:
        self._notes.append(text)
        self._progress.note(text)

    def _write_record(self, reason: str, exit_status: int = 0) -> None:
        comparison = self._comparison
        record = PairsRecord(
            run_id=self._run_id,
            head_plan=plan_hash(comparison.head.plan),
            base_plan=plan_hash(comparison.base.plan),
            against=comparison.against,
            control=comparison.control,
            seed=self._seed,
            planned=self._planned,
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
            # That of a work tree leads to its code, and is no difference that matters.
            environment={
                name: shown_value(name, value)
                for name, value in comparison.base.environment.items()
                if comparison.check_run is None
            },
            notes=tuple(self._notes),
        )
        self._folder.write_pairs(record)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
