"""Judges a comparison of interleaved runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from r2bspec.judge.decision_policy import decision_policy
from r2bspec.judge.judge_run import build_result
from r2bspec.judge.measure.metrics import summarise
from r2bspec.judge.measure.run_samples import read_samples
from r2bspec.judge.measure.samples import RunSamples
from r2bspec.judge.pair_comparison import InterleavedRuns, PairSet, judge_comparison
from r2bspec.judge.result import PairsResult, Result
from r2bspec.language.spec import Objective
from r2bspec.plan.plan import GatePlan
from r2bspec.record.comparison_folder import MergedRun, PairedComparison, PairRecord, Side

_MAX_NAMED_PAIRS = 3
"""Affected pairs listed in a sentence; ``pairs`` of the result has all of them."""


@dataclass(frozen=True)
class JudgedComparison:
    """A comparison and its result.

    Attributes:
        base: the base's runs of the pairs that count, as one.
        head: the head's.
    """

    result: Result
    base: MergedRun
    head: MergedRun


def judge_comparison_folder(
    pairs: PairedComparison,
    objectives: Mapping[str, Objective] | None = None,
    judged_by: str = "",
    gate: GatePlan | None = None,
) -> JudgedComparison:
    """Measure and judge a comparison. Needs no ROS; the same folder gives the same bytes.

    Args:
        pairs: the opened comparison.
        objectives: to judge by; those of the head if None.
        judged_by: the name of the spec of `objectives`, if it is another.
        gate: of that spec; that of the head if None.

    Raises:
        RecordError: a file of one of its runs is missing or damaged.
    """
    objectives = pairs.plan.objectives if objectives is None else objectives
    counted = pairs.usable_pairs()
    base, head = pairs.merged(counted, "base"), pairs.merged(counted, "head")
    first = read_pair_set(pairs)
    confirms = any(pair.confirms for pair in pairs.record.pairs)
    again = read_pair_set(pairs, confirms=True) if confirms else None
    verdict = judge_comparison(objectives, first, again, decision_policy(pairs.plan, gate))
    result = build_result(
        head,
        objectives,
        judged_by,
        metrics=summarise(first.played.merged),
        verdict=verdict,
        pairs=_pairs_result(pairs),
        base_identity=base.record.identity,
    )
    return JudgedComparison(result, base, head)


def read_pair_set(pairs: PairedComparison, *, confirms: bool = False) -> PairSet:
    """The samples of the pairs of one session.

    Args:
        pairs: the comparison.
        confirms: read the pairs of the confirmation.

    Raises:
        RecordError: a file of one of the runs is missing or damaged.
    """
    read: dict[str, RunSamples] = {}
    played, unaffected = pairs.usable_pairs(confirms=confirms), pairs.unaffected(confirms=confirms)
    disturbed = [each for each in played if each.disturbed]
    return PairSet(
        played=_interleaved(pairs, played, read),
        planned=pairs.record.planned,
        unaffected=_interleaved(pairs, unaffected, read) if disturbed else None,
        disturbance_text=_affected_pairs_text(disturbed),
    )


def _affected_pairs_text(disturbed: Sequence[PairRecord]) -> str:
    """The pairs with host interference, as the beginning of a sentence; empty for none."""
    named = [f"{each.number} ({each.disturbed})" for each in disturbed[:_MAX_NAMED_PAIRS]]
    more = (
        f" and {len(disturbed) - _MAX_NAMED_PAIRS} more"
        if len(disturbed) > _MAX_NAMED_PAIRS
        else ""
    )
    return f"Host interference in pair {', '.join(named)}{more}" if disturbed else ""


def _interleaved(
    pairs: PairedComparison, chosen: Sequence[PairRecord], read: dict[str, RunSamples]
) -> InterleavedRuns:
    def samples(side: Side) -> list[RunSamples]:
        found = []
        for pair in chosen:
            folder = pair.base if side == "base" else pair.head
            if folder not in read:
                read[folder] = read_samples(pairs.run(pair, side))
            found.append(read[folder])
        return found

    return InterleavedRuns(
        base=samples("base"),
        head=samples("head"),
        merged=read_samples(pairs.merged(chosen, "head")),
    )


def _pairs_result(pairs: PairedComparison) -> PairsResult:
    record = pairs.record
    return PairsResult(
        against=record.against,
        control=record.control,
        base_plan=record.base_plan,
        differences=record.differences,
        environment=record.environment,
        planned=record.planned,
        used=len(pairs.usable_pairs()),
        pairs=record.pairs,
        notes=record.notes,
    )
