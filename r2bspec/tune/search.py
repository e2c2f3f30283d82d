"""The search for the deployment that meets the objectives at the least cost, and its proof.

Four stages, in a budget of time that holds:

1. *Trials*: `Proposals` says what to try, a start measures it.
2. *Race*: the best of the trials were lucky, too. A few of them are started again, one after the
   other in rounds, and whoever is shown to be worse than the best one is left out. What the trials
   saw of them does not count: it chose them.
3. *Levers*: each lever of the winner is compared with today's setting of it, in interleaved pairs.
   One that gives nothing, and without which the limits hold, is dropped.
4. *Proof*: what is left is compared with today's deployment in interleaved pairs, each run a new
   start. The claim is what these pairs say, and none of them was seen before. Where today's does
   not work, there is nothing to compare with, and the winner's own runs decide. Whether today's
   meets the objectives its own runs decide where its start does not.

So a search that believed noise ends with a claim that is not shown, and not with a wrong one: the
chance that the first proof shows a gain where there is none is that of the pairs, 5 %
(`r2bspec.judge.statistics.t_interval`). Each further one, because the first refutes a limit or the
search is resumed, has half the chance of the one before, so that of all of them is below 10 %.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter
from typing import Any, Final

import msgspec

from r2bspec.diagnostics.quote import pluralize, time_text
from r2bspec.plan.tuning_space import Deployment, TuningSpace
from r2bspec.tune.machine import Machine, Measurement, Pairs, Start, Terms
from r2bspec.tune.proposals import Proposals, single_levers
from r2bspec.tune.race import FIRST_DROP, Finalist, excess_of, finalists_of, is_worse
from r2bspec.tune.tuning_result import Gain, Trial, TrialState, TuningOutcome, TuningResult
from r2bspec.tune.tuning_texts import (
    claim_text,
    failed_text,
    open_text,
    plan_line,
    trial_line,
    unproven_text,
)

_SINGLES_SHARE: Final = 0.6
"""Of the trials: the most that levers get by themselves. In simulated graphs 91 of 100 searches end
within 5 % of the best deployment; with a third of the trials 83 do
(`tests/simulation/test_tuning_worlds.py`)."""

_FINALISTS: Final = 4
_RACE_ROUNDS: Final = 5
_LEVER_PAIRS: Final = 5
_FEWEST_PAIRS: Final = 3
"""Pairs that can show anything: the first look is at three."""

_PROOF_SHARE: Final = 0.5
"""Of the budget: the most that race, levers and proof are given."""

_REASONS_SHOWN: Final = 100

_RULED_OUT: Final = 20
"""Deployments in a row that a model rules out; the next is tried whatever the model says."""

_MET_TODAY: Final = (
    "Its own runs show that today's deployment meets the objectives; none is shown to cost less."
)

_NOT_ENDED: Final = "The search has not ended."

_MAY_MEET: Final[frozenset[TrialState]] = frozenset({"meets", "open", "invalid"})
"""Whoever is in one of these states is not seen to miss an objective."""


class SearchSettings(msgspec.Struct, frozen=True, kw_only=True):
    """How long a search may take.

    Attributes:
        trials: the most deployments that are tried, today's among them.
        budget_s: the time of the whole search, proof included.
        pairs: the most pairs of the proof.
        seed: of proposals and orders.
    """

    trials: int
    budget_s: float
    pairs: int
    seed: int = 0


class Forecast(msgspec.Struct, frozen=True, kw_only=True):
    """What a model says of a deployment before it is tried.

    Attributes:
        rank: deployments with less of it are tried first.
        ruled_out: why it cannot meet the objectives, in a sentence; empty where it may.
    """

    rank: float = 0.0
    ruled_out: str = ""


Predict = Callable[[Deployment], Forecast]
"""Says what is known of a deployment before it is tried."""


def know_nothing(_: Deployment) -> Forecast:
    """The prediction without a model: the deployment may be as good as any other."""
    return Forecast()


class SearchListener:
    """Is told how a search goes, and may know what comes of it; this one does neither."""

    def found(self, result: TuningResult) -> None:
        """What the search has found so far."""

    def line(self, text: str) -> None:
        """A line for the user."""

    def predictor(self, today: Trial) -> Predict:
        """What predicts other deployments, from the run of today's."""
        del today
        return know_nothing


class Search:
    """A search, from its first trial or from those of an earlier one that was interrupted.

    Args:
        blank: the result of a search without a trial: the names, the space, the goal.
        machine: where deployments are tried.
        settings: how long it may take.
        listener: is told how it goes.
        earlier: what an earlier call found in the same space, with the same goal.
    """

    def __init__(
        self,
        blank: TuningResult,
        machine: Machine,
        settings: SearchSettings,
        listener: SearchListener | None = None,
        earlier: TuningResult | None = None,
    ) -> None:
        self._machine, self._settings = machine, settings
        self._listener = listener or SearchListener()
        self._space: TuningSpace = blank.space
        before = earlier or blank
        self._trials = list(before.trials)
        self._proofs = before.proofs
        self._notes = [*blank.notes]
        self._predicted: list[str] = []
        self._own: Pairs | None = None
        self._began_s = machine.now() - before.duration_s
        self._result = msgspec.structs.replace(
            blank,
            outcome="incomplete",
            reason=_NOT_ENDED,
            started_at=before.started_at,
            seed=settings.seed,
            **self._limits,
        )
        # What was claimed stands until there is another proof.
        self._standing = earlier if earlier is not None and earlier.is_proved else None

    def run(self) -> TuningResult:
        """Search, race and prove; the result is stored, too."""
        self._listener.line(plan_line(self._result, self._settings.trials))
        # From now on there is a search that can be resumed.
        self._store()
        if self._trials:
            self._listener.line(f"going on after {pluralize(len(self._trials), 'trial')}")
        today = self._today()
        result = self._found(today)
        if result.outcome == "not shown" and self._todays_is_shown_to_meet(today):
            self._notes.append(result.reason)
            self._propose_nothing()
            return self._keep("met today", _MET_TODAY)
        return result

    def _found(self, today: Trial) -> TuningResult:
        """What comes of trials, race and proof."""
        self._try_others(today)
        if len(self._trials) == 1 and not self._predicted:
            return self._keep(
                "incomplete",
                "Only today's deployment was tried: give more --trials or a larger --budget; a "
                f"trial takes {time_text(self._longest_trial_s())}.",
            )
        racing = self._race()
        meeting = [finalist.deployment for finalist in racing if finalist.order[0] == 0.0]
        if not meeting:
            return self._end_unmet(racing)
        if not meeting[0].choices:
            return self._end_at_today(today, meeting)
        result = self._prove(meeting[0], today)
        misses = [each.text for each in result.requirements if each.outcome != "pass"]
        if not misses or result.winner is None:
            return result
        # The cheapest one may just miss a limit that another one keeps. Only once: each proof has
        # its own chance to be wrong.
        other = self._best_without(result.winner, meeting)
        pairs = self._affordable_pairs(self._settings.pairs, comparisons=1)
        if other is None or not other.choices or pairs < _FEWEST_PAIRS:
            return result
        self._notes.append(
            f"Pairs do not show that {result.winner.text} meets {', '.join(misses)}, so the next "
            "best deployment was compared, too."
        )
        return self._prove(other, today)

    def _best_without(self, refuted: Deployment, racing: Sequence[Deployment]) -> Deployment | None:
        """The best one that seemed to meet the objectives and has not all levers of another."""
        levers = set(refuted.choices)
        candidates = self._seeming_to_meet(racing)
        return next((each for each in candidates if not levers <= set(each.choices)), None)

    def _seeming_to_meet(self, racing: Sequence[Deployment]) -> list[Deployment]:
        """The deployments that seemed to meet the objectives, those that raced first."""
        meeting = sorted(
            (trial for trial in self._trials if trial.state == "meets"),
            key=lambda trial: math.inf if trial.cost is None else trial.cost,
        )
        return [*racing, *(trial.deployment for trial in meeting)]

    # 1: trials

    def _today(self) -> Trial:
        if not self._trials:
            self._try([self._space.today()])
        return self._trials[0]

    def _try_others(self, today: Trial) -> None:
        predict = self._listener.predictor(today)
        singles = single_levers(self._space)
        ranks: dict[Deployment, float] = {}
        for each in singles:
            if not self._has_time():
                break
            ranks[each] = predict(each).rank
        singles.sort(key=lambda each: ranks.get(each, 0.0))
        first = singles[: math.ceil(_SINGLES_SHARE * self._settings.trials)]
        proposals = Proposals(self._space, self._settings.seed, first)
        for trial in self._trials:
            _tell(proposals, trial)
        while len(self._trials) < self._settings.trials:
            width = min(self._machine.width, self._settings.trials - len(self._trials))
            if not (batch := list(self._proposed(proposals, predict, width))):
                if not self._has_time():
                    self._notes.append(
                        f"The time allowed {len(self._trials)} of {self._settings.trials} trials."
                    )
                return
            for trial in self._try(batch):
                _tell(proposals, trial)

    def _proposed(self, proposals: Proposals, predict: Predict, most: int) -> Iterator[Deployment]:
        """The next deployments to try, at most so many; those that a model rules out are noted."""
        found = ruled_out = 0
        while found < most and self._has_time() and (deployment := proposals.next()) is not None:
            if ruled_out < _RULED_OUT and (why := predict(deployment).ruled_out):
                ruled_out += 1
                self._predicted.append(f"{deployment.text}: {why}")
                proposals.skip(deployment)
                continue
            found, ruled_out = found + 1, 0
            yield deployment

    def _try(self, deployments: Sequence[Deployment]) -> list[Trial]:
        began_s = self._machine.now()
        first = len(self._trials)
        starts = [
            Start(deployment, f"{number:03d}")
            for number, deployment in enumerate(deployments, first)
        ]
        measured = self._machine.measure(starts)
        duration_s = self._machine.now() - began_s
        for start, seen in zip(starts, measured, strict=True):
            trial = Trial(
                number=len(self._trials),
                deployment=start.deployment,
                state=_state(seen),
                cost=seen.cost,
                margins=seen.margins,
                starts=int(seen.state == "played"),
                duration_s=duration_s,
                reason=seen.reason,
                run=seen.run,
            )
            self._trials.append(trial)
            self._listener.line(trial_line(trial, self._result))
        self._store()
        return self._trials[first:]

    # 2: race

    def _race(self) -> list[Finalist]:
        """The deployments that may be the best, the best first."""
        racing = finalists_of(self._trials, _FINALISTS)
        chance = random.Random(self._settings.seed)  # noqa: S311 - chance, not a secret
        played = 0
        while played < _RACE_ROUNDS and len(racing) > 1:
            if self._left_s() < self._round_s(len(racing)) + self._proof_s(race=False):
                self._notes.append(
                    f"The race had {played} of {_RACE_ROUNDS} rounds: the rest of the time was "
                    "kept for the proof."
                )
                break
            names = ", ".join(str(each.trial.number) for each in racing)
            self._listener.line(f"race of trials {names}, from round {played + 1}")
            last = min(_RACE_ROUNDS, played + self._machine.width)
            starts = {
                Start(racing[place].deployment, f"race-{number}-{place}", round=number): place
                for number in range(played + 1, last + 1)
                for place in chance.sample(range(len(racing)), len(racing))
            }
            seen = dict(zip(starts, self._machine.measure(list(starts)), strict=True))
            # What the machine could not play says nothing of one, so the others have no pair.
            lost = {start.round for start, one in seen.items() if one.state == "invalid"}
            for start, one in seen.items():
                if start.round not in lost:
                    racing[starts[start]].add(one)
            played = last
            best = min(racing, key=attrgetter("order"))
            racing = [finalist for finalist in racing if not is_worse(finalist, best)]
            self._store()
        return sorted(racing, key=attrgetter("order"))

    def _end_unmet(self, racing: Sequence[Finalist]) -> TuningResult:
        """No deployment keeps every limit: which one is the nearest, and what takes its time."""
        judged = [trial for trial in self._trials if trial.state != "invalid"]
        if not judged:
            why = self._trials[0].reason
            return self._keep(
                "incomplete", f"No start could be judged, so search in a new folder: {why}"
            )
        if any(trial.state in {"meets", "open"} and trial.cost is None for trial in judged):
            return self._keep(
                "not shown",
                f"The goal, {self._result.goal}, has no value where a start meets the objectives, "
                "so no deployment is known to cost less than another.",
            )
        count = pluralize(len(judged), "deployment")
        tried = f"None of {count} meets the objectives"
        measured = [Finalist(trial) for trial in self._trials if trial.margins]
        if not measured:
            why = judged[0].reason
            whose = "today's" if judged[0] is self._trials[0] else judged[0].deployment.text
            return self._keep("not met", f"{tried}: none of them works; {whose}: {why}")
        nearest = min(racing or measured, key=attrgetter("order"))
        anatomy = ""
        if self._left_s() > 2 * self._longest_trial_s():
            anatomy = self._machine.slowest_part(nearest.deployment, "nearest")
        number = nearest.trial.number
        self._trials[number] = msgspec.structs.replace(nearest.trial, anatomy=anatomy)
        reason = f"{tried}; the nearest, {nearest.deployment.text}, misses {nearest.missed}"
        return self._keep("not met", f"{reason}; {anatomy}." if anatomy else f"{reason}.")

    def _end_at_today(self, today: Trial, meeting: Sequence[Deployment]) -> TuningResult:
        """No deployment seems to meet the objectives at less than today's costs.

        Where a start does not decide whether today's meets them, its own runs do. If they do not
        show it, the next best one is proved.
        """
        if today.state == "meets":
            return self._keep("met today", "No deployment was found that costs less than today's.")
        if self._todays_is_shown_to_meet(today):
            return self._keep("met today", _MET_TODAY)
        other = next((each for each in self._seeming_to_meet(meeting) if each.choices), None)
        if other is not None:
            return self._prove(other, today)
        own = self._own_runs_of_today()
        return self._keep(
            "not met" if failed_text(own) else "not shown",
            f"No other deployment seems to meet the objectives; {_todays_text(own)}.",
        )

    def _todays_is_shown_to_meet(self, today: Trial) -> bool:
        """Whether today's deployment is shown to meet the objectives by its own runs."""
        return today.state in {"open", "invalid"} and self._own_runs_of_today().head_meets

    def _own_runs_of_today(self) -> Pairs:
        if self._own is None:
            self._own = self._machine.judge(
                self._space.today(), "today", self._terms(comparisons=2)
            )
        return self._own

    # 3 and 4: levers and proof

    def _propose_nothing(self) -> None:
        self._result = msgspec.structs.replace(
            self._result,
            winner=None,
            proof=None,
            requirements=(),
            levers=(),
            dropped=(),
            unproven=None,
            for_others=(),
        )

    def _prove(self, winner: Deployment, today: Trial) -> TuningResult:
        self._propose_nothing()
        unproven = next(trial.cost for trial in self._trials if trial.deployment == winner)
        self._result = msgspec.structs.replace(self._result, unproven=unproven)
        winner, kept, dropped = self._without_idle_levers(winner)
        self._result = msgspec.structs.replace(
            self._result,
            winner=winner,
            levers=tuple(kept),
            dropped=tuple(dropped),
            for_others=tuple(dict.fromkeys(winner.for_others())),
        )
        if not winner.choices:
            self._result = msgspec.structs.replace(self._result, winner=None, unproven=None)
            nothing = "No lever of the best deployment gives anything that pairs show"
            if today.state == "meets":
                return self._keep("met today", f"{nothing}; today's meets the objectives.")
            return self._keep("not shown", f"{nothing}.")
        seen, today_works = self._proof(winner, today)
        if seen is None:
            return self._keep("incomplete", "The time was over before the proof.")
        if not seen.reason:
            self._proofs += 1
            self._standing = None
        self._result = msgspec.structs.replace(
            self._result,
            proof=seen.gain if today_works else None,
            requirements=seen.margins,
        )
        shown = f"{seen.gain.metric} {claim_text(seen.gain)}" if today_works else "the winner alone"
        self._listener.line(f"proof: {shown}")
        if seen.may_retry:
            return self._keep(
                "incomplete", f"The proof could not be made: {seen.reason}; --resume tries again."
            )
        if not seen.head_meets:
            return self._keep("not shown", unproven_text(seen))
        if not today_works:
            return self._keep(
                "meets", "The deployment meets the objectives; today's does not work."
            )
        if today.state not in _MAY_MEET:
            return self._keep(
                "meets", "The deployment meets the objectives; today's did not when it was tried."
            )
        if seen.gain.is_shown:
            return self._keep(
                "improved",
                f"The deployment meets the objectives: {seen.gain.metric} {claim_text(seen.gain)}.",
            )
        return self._end_without_gain(seen, today)

    def _end_without_gain(self, seen: Pairs, today: Trial) -> TuningResult:
        """Pairs show that the winner meets the objectives, and not that it costs less."""
        why = f" ({seen.no_ratio})" if seen.no_ratio else ""
        no_gain = f"The pairs do not show a gain: {seen.gain.metric} {claim_text(seen.gain)}{why}"
        if today.state == "meets":
            return self._keep(
                "not shown", f"{no_gain}; --resume with more --pairs and --budget goes on."
            )
        if self._todays_is_shown_to_meet(today):
            return self._keep("not shown", f"{no_gain}.")
        return self._keep(
            "meets",
            f"The deployment meets the objectives; {_todays_text(self._own_runs_of_today())}.",
        )

    def _proof(self, winner: Deployment, today: Trial) -> tuple[Pairs | None, bool]:
        """What proves the winner, None without the time for it; and whether today's works.

        Where today's does not work there are no pairs: the winner's own runs decide.
        """
        works = today.state != "broken"
        if works:
            pairs = self._affordable_pairs(self._settings.pairs, comparisons=1)
            if pairs < _FEWEST_PAIRS:
                return None, works
            seen = self._machine.compare(
                self._space.today(), winner, pairs, "proof", self._terms(proves=True)
            )
            if not seen.base_fails:
                return seen, works
            self._notes.append(f"Today's deployment failed in the pairs: {seen.reason}")
        if self._left_s() < self._longest_trial_s():
            return None, False
        return self._machine.judge(winner, "proof", self._terms(proves=True)), False

    def _without_idle_levers(self, winner: Deployment) -> tuple[Deployment, list[Gain], list[Gain]]:
        """The winner without the levers that give nothing, with what each of them gives."""
        kept: list[Gain] = []
        dropped: list[Gain] = []
        for choice in winner.choices if len(winner.choices) > 1 else ():
            if choice not in winner.choices:
                continue  # It has no effect without one that was dropped.
            left = len(winner.choices) - len(kept)
            pairs = self._affordable_pairs(_LEVER_PAIRS, comparisons=left + 1)
            if pairs < _FEWEST_PAIRS:
                self._notes.append(f"The time did not allow pairs for {choice.lever}.")
                continue
            places = {each.lever: each.place for each in winner.choices}
            without = self._space.deployment(places | {choice.lever: 0})
            name = f"lever-{len(kept) + len(dropped)}"
            terms = self._terms(comparisons=left + 1, lever=choice.lever)
            seen = self._machine.compare(winner, without, pairs, name, terms)
            self._store()
            gain = _of_lever(seen.gain, f"{choice.lever}: {choice.setting.text}")
            if seen.costs_more or seen.head_may_fail or seen.reason or seen.no_ratio:
                kept.append(gain)
            else:
                dropped.append(gain)
                winner = without
            self._listener.line(f"{gain.change}: {claim_text(gain)}")
        return winner, kept, dropped

    # The budget.

    def _left_s(self) -> float:
        return self._settings.budget_s - (self._machine.now() - self._began_s)

    def _has_time(self) -> bool:
        """Whether there is time for a trial beside what is kept for the rest."""
        return self._left_s() >= self._longest_trial_s() + self._kept_s()

    def _terms(self, *, comparisons: int = 1, lever: str = "", proves: bool = False) -> Terms:
        """Those of the next of some comparisons that share the rest of the time."""
        return Terms(
            limit_s=max(0.0, self._left_s()) / comparisons,
            error_share=0.5**self._proofs if proves else 1.0,
            lever=lever,
        )

    def _longest_trial_s(self) -> float:
        """Of the trials but today's, which is observed from inside, too."""
        others = self._trials[1:] or self._trials
        return max(trial.duration_s for trial in others)

    def _round_s(self, finalists: int) -> float:
        return finalists * self._longest_trial_s()

    def _proof_s(self, *, race: bool = True) -> float:
        """What is kept for the rest: the race, pairs for two levers, and the proof."""
        runs = 2 * (self._settings.pairs + 2 * _LEVER_PAIRS)
        needed = runs * self._longest_trial_s()
        if race:
            rounds = math.ceil(FIRST_DROP / self._machine.width)
            needed += rounds * self._round_s(_FINALISTS)
        return min(_PROOF_SHARE * self._settings.budget_s, needed)

    def _kept_s(self) -> float:
        """What is kept for the rest while trials go on; little before something can be proved."""
        today, *others = self._trials
        if any(
            trial.excess <= 0
            and trial.cost is not None
            and (today.state != "meets" or trial.cost < (today.cost or math.inf))
            for trial in others
        ):
            return self._proof_s()
        return min(self._proof_s(), 2 * _FEWEST_PAIRS * self._longest_trial_s())

    def _affordable_pairs(self, most: int, *, comparisons: int) -> int:
        """The pairs that the rest of the time allows, shared by some comparisons."""
        each_s = max(0.0, self._left_s()) / comparisons
        return min(most, int(each_s / (2 * self._longest_trial_s())))

    # The result.

    @property
    def _limits(self) -> dict[str, Any]:
        settings = self._settings
        return {
            "budget_s": settings.budget_s,
            "max_trials": settings.trials,
            "max_pairs": settings.pairs,
        }

    def _so_far(self, result: TuningResult) -> TuningResult:
        """A result with what has been tried until now."""
        return msgspec.structs.replace(
            result,
            trials=tuple(self._trials),
            predicted=tuple(self._predicted[:_REASONS_SHOWN]),
            duration_s=self._machine.now() - self._began_s,
            proofs=self._proofs,
        )

    def _store(self) -> None:
        """Keep what there is, so that a call that is interrupted now can be resumed."""
        if self._standing is not None:
            # With the limits of its own search, so that another call goes on.
            self._listener.found(self._so_far(self._standing))
            return
        unfinished: dict[str, Any] = {"outcome": "incomplete", "reason": _NOT_ENDED}
        kept = msgspec.structs.replace(self._result, notes=tuple(self._notes), **unfinished)
        self._listener.found(self._so_far(kept))

    def _keep(self, outcome: TuningOutcome, reason: str) -> TuningResult:
        """Keep the result of the search, or the claim that stands if there is no other proof."""
        if self._standing is not None:
            notes = (
                *self._standing.notes,
                *self._notes,
                f"No other proof was made, so the claim is that of the earlier call: {reason}",
            )
            once = tuple(dict.fromkeys(notes))
            result = msgspec.structs.replace(self._standing, notes=once, **self._limits)
        else:
            result = msgspec.structs.replace(
                self._result, outcome=outcome, reason=reason, notes=tuple(self._notes)
            )
        self._result = self._so_far(result)
        self._listener.found(self._result)
        return self._result


def _todays_text(own: Pairs) -> str:
    """What today's own runs say, where they do not show that it meets the objectives."""
    if missed := failed_text(own):
        return f"today's own runs show that it misses {missed}"
    return f"today's own runs do not show that it does: {own.reason or open_text(own)}"


def _state(seen: Measurement) -> TrialState:
    if seen.state != "played":
        return seen.state
    if excess_of(seen) > 0:
        return "misses"
    return "meets" if all(margin.outcome == "pass" for margin in seen.margins) else "open"


def _tell(proposals: Proposals, trial: Trial) -> None:
    if trial.state == "invalid":
        proposals.skip(trial.deployment)
    else:
        proposals.tell(trial.deployment, trial.cost, trial.excess)


def _of_lever(reverse: Gain, change: str) -> Gain:
    """The gain by a lever, from pairs of the winner and of the winner without it."""

    def inverse(ratio: float | None) -> float | None:
        return 1 / ratio if ratio else None

    return msgspec.structs.replace(
        reverse,
        change=change,
        before=reverse.after,
        after=reverse.before,
        ratio=inverse(reverse.ratio),
        lower=inverse(reverse.upper),
        upper=inverse(reverse.lower),
    )
