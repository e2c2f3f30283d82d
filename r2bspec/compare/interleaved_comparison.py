"""A comparison that can be played: its two sides, checked."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.execute.errors import RunError, UnwritableRunError, WorkspaceError
from r2bspec.execute.processes.environment import inherited_environment
from r2bspec.execute.processes.prerequisites import check_middleware
from r2bspec.judge.measure.metric import MetricInfo
from r2bspec.judge.measure.metric_catalogue import MetricError, Subjects, resolve
from r2bspec.judge.ratio_of_starts import can_be_played_by_turns, turn_kind
from r2bspec.plan import comparability
from r2bspec.plan.comparability import IncomparableError
from r2bspec.plan.plan import Plan
from r2bspec.plan.time_estimate import TimeEstimate, estimate_pairs, estimate_turns
from r2bspec.record.comparison_folder import Side
from r2bspec.record.graph_identity import GraphIdentity
from r2bspec.record.run_record import TurnKind


@dataclass(frozen=True)
class ComparisonSide:
    """One side of a comparison.

    Attributes:
        plan: as it was compiled, with all iterations.
        base_dir: the folder of its spec.
        spec_text: the resolved spec.
        environment: the variables of its runs that differ from this process; see
            `environment.applied_environment`.
        identity: the identity of its graph; each run looks it up itself if None.
        top: the top of the work tree of `identity`.
    """

    plan: Plan
    base_dir: Path
    spec_text: str
    environment: Mapping[str, str] = field(default_factory=dict)
    identity: GraphIdentity | None = None
    top: Path | None = None


class BaseFailsError(R2bspecError):
    """The base of a comparison cannot be played: its spec is not valid, or its graph fails."""

    code = "R2B698"
    exit_code = ExitStatus.USAGE
    way_out = "Mend the base, or judge the head alone: --allow base."

    @classmethod
    def of(cls, error: R2bspecError, text: str = "") -> BaseFailsError:
        """Return an error of the base, with the way out.

        The exit status is that of its cause, which may say that another attempt can help. A run
        that failed was already repeated, so its cause is the base's code, and a pipeline need not
        try again; only a disk that cannot be written is no fault of the code.
        """
        failure = cls(text or f"the base fails: {error}")
        graph_failed = isinstance(error, RunError) and not isinstance(error, UnwritableRunError)
        failure.exit_code = ExitStatus.USAGE if graph_failed else error.exit_code
        return failure


CheckRun = Callable[[Side, Path], None]
"""Checks the folder of a finished run of one side; raises an error that ends the comparison."""


@dataclass(frozen=True)
class ComparisonSpec:
    """A comparison to be played; see `PairsRecord` for the fields.

    Attributes:
        check_run: is called after each run.
        alternates: why the sides are not played by turns; empty if they are.
        needs_base_alone: whether a requirement compares what turns do not show, so that the base
            is played alone, too.
        turns: what is played by turns.
        buffers_of: the side whose recording both sides play, by turns.
    """

    base: ComparisonSide
    head: ComparisonSide
    pairs: int
    against: str = ""
    control: bool = False
    differences: tuple[str, ...] = ()
    gate: tuple[str, ...] = ()
    check_run: CheckRun | None = None
    alternates: str = ""
    needs_base_alone: bool = False
    turns: tuple[TurnKind, ...] = ()
    buffers_of: Side = "base"


def prepare_comparison(
    base: ComparisonSide,
    head: ComparisonSide,
    *,
    against: str,
    pairs: int | None = None,
    control: bool = False,
    force: bool = False,
    gate: tuple[str, ...] = (),
    check_run: CheckRun | None = None,
) -> ComparisonSpec:
    """Check that two sides are comparable, and return their comparison.

    Args:
        base: to compare with.
        head: to be judged.
        against: the base, as the user named it.
        pairs: how many; as many as the head's spec has iterations if None.
        control: whether base and head are meant to be the same.
        force: compare even with different loads.
        gate: what reports say of the merge gate that compares them.
        check_run: checks that each run has loaded the files of its side, of a base with its own
            work tree, which may have the same plan.

    Raises:
        IncomparableError: the two are offered different loads, or are the same.
        MiddlewareError: the middleware of one of them has no such transport.
    """
    differences = comparability.graph_differences(base.plan, head.plan)
    if not control and not differences and not base.environment and check_run is None:
        raise IncomparableError(
            f"the base, {against}, is the same as the head",
            hint="Use --control to compare a graph with itself and see the noise.",
        )
    otherwise = comparability.load_differences(base.plan, head.plan)
    if otherwise and not force:
        raise IncomparableError(
            "base and head differ in load or monitors:\n"
            + "\n".join(
                f"  {difference_line}"
                for difference_line in comparability.difference_lines(otherwise)
            ),
            hint="Use --force to compare them anyway.",
        )
    _check_environment_inherited(head, base.environment)
    for side in (base, head):
        check_middleware(side.plan, {**os.environ, **side.environment})
    alternates = why_not_by_turns(base.plan, head.plan)
    usual = comparability.pair_count(head.plan) if alternates else STARTS_OF_BOTH
    return ComparisonSpec(
        base=base,
        head=head,
        pairs=pairs or usual,
        alternates=alternates,
        needs_base_alone=needs_base_alone(head.plan),
        turns=turns_of(head.plan),
        against=against,
        control=control,
        differences=tuple(comparability.difference_lines(differences)),
        gate=gate,
        check_run=check_run,
    )


STARTS_OF_BOTH: Final = 12
"""The most starts of both sides by turns; fewer are played where they decide."""

NOTHING_BY_TURNS: Final = "no requirement is judged by turns"


def why_not_by_turns(base: Plan, head: Plan) -> str:
    """Return why two sides cannot be played by turns; empty if they can."""
    for plan in (base, head):
        single = comparability.single_run_plan(plan)
        if plan.external:
            return "external nodes cannot be up twice"
        if plan.playback_mode not in {"looping", "sweeping"} or plan.arrivals or not plan.inputs:
            return "the load has its own times"
        if plan.called or single.search or single.sustained_hz or not single.play:
            return "a search, probes or calls are not played step by step"
    if not turns_of(head):
        return NOTHING_BY_TURNS
    return ""


def turns_of(head: Plan) -> tuple[TurnKind, ...]:
    """Return which values have to be measured by turns for the requirements of a plan."""
    kinds = map(turn_kind, filter(can_be_played_by_turns, _baseline_metrics(head)))
    return tuple(dict.fromkeys(kinds))


def needs_base_alone(head: Plan) -> bool:
    """Return True if a requirement compares values that turns do not show."""
    return not all(map(can_be_played_by_turns, _baseline_metrics(head)))


def _baseline_metrics(plan: Plan) -> Iterator[MetricInfo]:
    """Yield the metrics of the requirements of the baseline."""
    monitors = [monitor.name for monitor in plan.monitors]
    for objective in plan.objectives.values():
        for requirement in objective.require:
            if requirement.bound is not None and requirement.bound.of_baseline:
                with contextlib.suppress(MetricError):
                    yield resolve(requirement.metric, monitors, Subjects.of_plan(plan))[1]


def _check_environment_inherited(head: ComparisonSide, environment: Mapping[str, str]) -> None:
    """Check that processes of a run inherit the variables; most are not inherited."""
    arrives = inherited_environment(environment, head.plan.environment)
    if environment and not arrives:
        raise WorkspaceError(
            f"no process of a run inherits {', '.join(sorted(environment))}",
            hint="List the variables that nodes need under 'environment' in the spec.",
        )


STEPS: Final = 40
"""Of each side, for each rate, in each start that is played by turns."""


def estimate_comparison(head: Plan, pairs: int | None = None) -> TimeEstimate:
    """Return the time that a comparison with a plan of the same kind will take.

    Args:
        head: with all iterations.
        pairs: the most pairs of runs, or starts of both sides; the usual number if None.
    """
    if why_not_by_turns(head, head):
        return estimate_pairs(head, pairs)
    steps = STEPS * len(turns_of(head))
    starts = pairs or STARTS_OF_BOTH
    return estimate_turns(head, starts, steps, base_alone=needs_base_alone(head))
