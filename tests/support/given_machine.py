"""A machine for searches whose every answer is given."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from r2bspec.plan.tuning_space import Deployment
from r2bspec.tune.machine import Measurement, Pairs, Start
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
    """A machine whose starts take ten seconds, and measure what `answer` says."""

    answer: Callable[[Deployment], Measurement]
    width: int = 1
    seconds: float = 0.0
    starts: list[str] = field(default_factory=list)
    batches: list[Sequence[Start]] = field(default_factory=list)
    compared: list[tuple[set[str], set[str]]] = field(default_factory=list)

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

    def compare(
        self, base: Deployment, head: Deployment, pairs: int, name: str, lever: str = ""
    ) -> Pairs:
        self.compared.append((changed(base), changed(head)))
        before, after = self.measure([Start(base, name), Start(head, name)])
        self.seconds += pairs * 20.0 - 20.0 / self.width
        ratio = after.cost / before.cost if after.cost and before.cost else None
        gain = Gain(
            change=head.text,
            lever=lever,
            metric="cpu.graph.mean",
            unit="share",
            before=before.cost,
            after=after.cost,
            ratio=ratio,
            lower=None if ratio is None else 0.98 * ratio,
            upper=None if ratio is None else 1.02 * ratio,
            pairs=pairs,
        )
        return Pairs(
            gain=gain,
            costs_more=ratio is not None and 0.98 * ratio > 1,
            margins=after.margins,
            reason="" if ratio is not None else "R2B631: a process died",
        )
