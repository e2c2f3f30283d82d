"""A machine for searches whose every answer is given."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from r2bspec.plan.tuning_space import Deployment
from r2bspec.tune.machine import Measurement, Pairs, Start, Terms
from r2bspec.tune.tuning_result import Gain, RequirementMargin


def changed(deployment: Deployment) -> set[str]:
    return {choice.lever for choice in deployment.choices}


def margin(excess: float) -> RequirementMargin:
    return RequirementMargin(
        text="latency.p99 < 50 ms",
        outcome="pass" if excess <= 0 else "fail",
        estimate=0.05,
        limit=0.05,
        unit="s",
        excess=excess,
    )


def played(cost: float, excess: float = -0.5) -> Measurement:
    return Measurement(state="played", cost=cost, margins=(margin(excess),))


@dataclass
class GivenMachine:
    """A machine whose starts take ten seconds, and measure what `answer` says.

    What pairs and own runs show follows from that, unless `pairs_show` (given the base, the head
    and what follows) and `own_runs_show` say otherwise.
    """

    answer: Callable[[Deployment], Measurement]
    pairs_show: Callable[[Deployment, Deployment, Pairs], Pairs] = lambda _base, _head, seen: seen
    own_runs_show: Callable[[Pairs], Pairs] = lambda seen: seen
    width: int = 1
    seconds: float = 0.0
    starts: list[str] = field(default_factory=list)
    batches: list[Sequence[Start]] = field(default_factory=list)
    compared: list[tuple[set[str], set[str]]] = field(default_factory=list)
    terms: list[Terms] = field(default_factory=list)

    def now(self) -> float:
        return self.seconds

    def measure(self, starts: Sequence[Start]) -> list[Measurement]:
        self.seconds += 10.0 * math.ceil(len(starts) / self.width)
        self.starts += [start.name for start in starts]
        self.batches.append(starts)
        return [self.answer(start.deployment) for start in starts]

    def slowest_part(self, deployment: Deployment, name: str) -> str:
        """What takes most of the latency."""
        del deployment, name
        return "first: callback takes 41 ms of 58 ms in the mean"

    def judge(self, deployment: Deployment, name: str, terms: Terms) -> Pairs:
        self.terms.append(terms)
        (seen,) = self.measure([Start(deployment, name)])
        gain = self._gain(deployment, terms, 0, None, seen.cost)
        return self.own_runs_show(Pairs(gain=gain, margins=seen.margins, reason=seen.reason))

    def compare(
        self, base: Deployment, head: Deployment, pairs: int, name: str, terms: Terms
    ) -> Pairs:
        self.terms.append(terms)
        self.compared.append((changed(base), changed(head)))
        before, after = self.measure([Start(base, name), Start(head, name)])
        self.seconds += pairs * 20.0 - 20.0 / self.width
        ratio = after.cost / before.cost if after.cost and before.cost else None
        works = before.state == after.state == "played"
        seen = Pairs(
            gain=self._gain(head, terms, pairs, before.cost, after.cost),
            costs_more=ratio is not None and 0.98 * ratio > 1,
            margins=after.margins,
            reason="" if works else "R2B631: a process died",
            no_ratio="" if ratio is not None else "the metric has no value",
            base_fails=before.state == "broken",
        )
        return self.pairs_show(base, head, seen)

    def _gain(
        self,
        head: Deployment,
        terms: Terms,
        pairs: int,
        before: float | None,
        after: float | None,
    ) -> Gain:
        ratio = after / before if after and before else None
        return Gain(
            change=head.text,
            lever=terms.lever,
            metric="cpu.graph.mean",
            unit="share",
            before=before,
            after=after,
            ratio=ratio,
            lower=None if ratio is None else 0.98 * ratio,
            upper=None if ratio is None else 1.02 * ratio,
            pairs=pairs,
        )


class NoGain(GivenMachine):
    """One whose pairs show that nothing costs less than anything else."""

    def compare(
        self, base: Deployment, head: Deployment, pairs: int, name: str, terms: Terms
    ) -> Pairs:
        seen = super().compare(base, base, pairs, name, terms)
        self.compared[-1] = (changed(base), changed(head))
        return seen
