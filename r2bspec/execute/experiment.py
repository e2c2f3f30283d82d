"""The loop of every experiment: a policy chooses the next unit, it is played, and judged.

A unit is what a verdict counts as one value: the iterations of one start of a run, or one pair of a
comparison, which is a run of the base and one of the head, or a start of both by turns. All units
of an experiment are in one list. A policy is a generator: with what has been played and what that
shows it yields the next unit, or ends. Every experiment is

    grow       the planned units, until a look at what was played decides
    again      units that others disturbed, while playing them again can change the outcome
    confirm    after a failure: both of these once more, with fresh units

`r2bspec.execute.measurement.measurement` plays the starts of a run so, and
`r2bspec.compare.interleaved_runs` the pairs of a comparison. Of neither does this know how a unit
is played or judged.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, TypeVar

from r2bspec.judge.confirmation import needs_confirmation
from r2bspec.judge.decision_policy import decide_after_look
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.plan.interim_looks import InterimLooks

Unit = TypeVar("Unit")


class Experiment(ABC, Generic[Unit]):
    """What was played so far, and the verdict on it."""

    _verdict: Verdict | None = None

    @property
    def verdict(self) -> Verdict:
        """The verdict if the experiment ended now; judged at most once after each unit."""
        if self._verdict is None:
            self._verdict = self._judge()
        return self._verdict

    def carry_out(self, *policies: Policy[Unit]) -> Verdict:
        """Play what the policies ask for, one after the other.

        Raises:
            RunError: a unit cannot be played.
        """
        for policy in policies:
            for unit in policy(self):
                self.play(unit)
                self._verdict = None
        return self.verdict

    @property
    @abstractmethod
    def looks(self) -> InterimLooks | None:
        """The numbers of units after which it is judged early; None if only at the end."""

    @abstractmethod
    def planned(self) -> Sequence[Unit]:
        """Return all units that may be played, in their order."""

    @abstractmethod
    def play(self, unit: Unit) -> None:
        """Play a unit and record it."""

    @abstractmethod
    def complete(self) -> int:
        """Return how many iterations, or pairs, count so far; looks are planned in these."""

    @abstractmethod
    def _judge(self) -> Verdict:
        """Judge what was played."""

    def counted(self) -> list[RequirementVerdict]:
        """Return the requirements on which the outcome depends."""
        return [one for one in self.verdict.requirements if one.level == "error"]

    def on_decision(self) -> None:
        """Report that a look has decided before the last planned unit."""

    def unusable(self) -> Unit | None:
        """Return the last unit if it cannot be judged and has to be played again, else None."""
        return None

    def affected(self) -> Unit | None:
        """Return a disturbed unit whose repetition can change the outcome; None without one."""
        return None

    @abstractmethod
    def has_time(self, *, was_judged: bool) -> bool:
        """Return True if time allows the next unit or, after a look, all up to the next look."""

    @abstractmethod
    def begin_confirmation(self) -> bool:
        """Set the failed units aside, and plan fresh units that confirm the failure.

        Return False if the spec wants no confirmation, or no time is left.
        """


Policy = Callable[[Experiment[Unit]], Iterator[Unit]]


def grow(experiment: Experiment[Unit]) -> Iterator[Unit]:
    """Yield the planned units until a look decides, or the time is over."""
    units, complete = experiment.planned(), experiment.complete()
    for unit in units:
        yield unit
        if (repeated := experiment.unusable()) is not None:
            yield repeated
        if unit is units[-1]:
            return
        before, complete = complete, experiment.complete()
        looks = experiment.looks
        is_look = looks is not None and complete > before and complete in looks.iterations
        if looks is not None and is_look:
            decision = decide_after_look(
                looks, looks.completed_looks(complete), experiment.counted()
            )
            if decision != "go on":
                experiment.on_decision()
                return
        if not experiment.has_time(was_judged=is_look):
            return


def again(experiment: Experiment[Unit]) -> Iterator[Unit]:
    """Yield disturbed units as long as a repetition can change the outcome."""
    while (unit := experiment.affected()) is not None:
        yield unit


def confirm(experiment: Experiment[Unit]) -> Iterator[Unit]:
    """Yield fresh units if the first units fail."""
    if needs_confirmation(experiment.verdict) and experiment.begin_confirmation():
        yield from grow(experiment)
        yield from again(experiment)
