"""From a comparison of interleaved runs to its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from r2bspec.judge.decision_policy import terms_of
from r2bspec.judge.judge_run import result_with
from r2bspec.judge.pair_comparison import Batch, Interleaved, in_best_light, judge_comparison
from r2bspec.judge.result import PairsResult, Result
from r2bspec.language.spec import Objective
from r2bspec.measure.compute_metrics import summarise
from r2bspec.measure.run_samples import read_samples
from r2bspec.measure.samples import RunSamples
from r2bspec.record.comparison_folder import PairRecord, Pairs, Side
from r2bspec.record.merged_run import MergedRun

_MOST = 3
"""Disturbed pairs that a sentence names; ``pairs`` of the result has all of them."""


@dataclass(frozen=True)
class JudgedPairs:
    """A comparison and what it came to.

    Attributes:
        base: the base's runs of the pairs that count, as one.
        head: the head's.
    """

    result: Result
    base: MergedRun
    head: MergedRun


def judge_pairs_folder(
    pairs: Pairs, objectives: Mapping[str, Objective] | None = None, judged_by: str = ""
) -> JudgedPairs:
    """Measure and judge a comparison. Needs no ROS; the same folder gives the same bytes.

    Args:
        pairs: the opened comparison.
        objectives: what to judge it by; those of the head if None.
        judged_by: the name of the spec that `objectives` are from, where it is another.

    Raises:
        RecordError: a file of one of its runs is missing or damaged.
    """
    asked = pairs.plan.objectives if objectives is None else objectives
    counted = pairs.played()
    head = pairs.merged(counted, "head")
    read: dict[str, RunSamples] = {}
    first = read_batch(pairs, read, confirms=False)
    confirms = any(each.confirms for each in pairs.record.pairs)
    again = read_batch(pairs, read, confirms=True) if confirms else None
    verdict = judge_comparison(asked, first, again, terms_of(pairs.plan))
    result = result_with(
        head,
        asked,
        judged_by,
        metrics=summarise(first.played.merged),
        verdict=verdict,
        pairs=_told(pairs),
    )
    return JudgedPairs(result, pairs.merged(counted, "base"), head)


def read_batch(
    pairs: Pairs, read: dict[str, RunSamples] | None = None, *, confirms: bool = False
) -> Batch:
    """The samples of the pairs of one batch.

    Args:
        pairs: the comparison.
        read: the samples of runs by their folder, filled as they are read.
        confirms: whether the fresh pairs are meant that follow a failure.

    Raises:
        RecordError: a file of one of the runs is missing or damaged.
    """
    known = {} if read is None else read
    played, calm = pairs.played(confirms=confirms), pairs.calm(confirms=confirms)
    disturbed = [each for each in played if each.disturbed]
    first = _interleaved(pairs, played, known)
    return Batch(
        played=first,
        planned=pairs.record.planned,
        calm=_interleaved(pairs, calm, known) if disturbed else None,
        best=in_best_light(first) if disturbed else None,
        told=_disturbed_text(disturbed),
    )


def _disturbed_text(disturbed: Sequence[PairRecord]) -> str:
    """Which pairs the machine disturbed, as the beginning of a sentence; empty for none."""
    named = [f"{each.number} ({each.disturbed})" for each in disturbed[:_MOST]]
    more = f" and {len(disturbed) - _MOST} more" if len(disturbed) > _MOST else ""
    return f"The machine disturbed pair {', '.join(named)}{more}" if disturbed else ""


def _interleaved(
    pairs: Pairs, chosen: Sequence[PairRecord], read: dict[str, RunSamples]
) -> Interleaved:
    def samples(side: Side) -> list[RunSamples]:
        found = []
        for pair in chosen:
            folder = pair.base if side == "base" else pair.head
            if folder not in read:
                read[folder] = read_samples(pairs.run(pair, side))
            found.append(read[folder])
        return found

    return Interleaved(
        base=samples("base"),
        head=samples("head"),
        merged=read_samples(pairs.merged(chosen, "head")),
    )


def _told(pairs: Pairs) -> PairsResult:
    record = pairs.record
    return PairsResult(
        against=record.against,
        control=record.control,
        base_plan=record.base_plan,
        differences=record.differences,
        environment=record.environment,
        planned=record.planned,
        used=len(pairs.played()),
        pairs=record.pairs,
        notes=record.notes,
    )
