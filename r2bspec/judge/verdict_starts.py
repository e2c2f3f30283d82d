"""What a verdict is about: one start of the processes, or the graph, of which several are a sample.

Starts of one graph differ by more than the iterations of a start show. So a verdict on one start is
true of that start, and says so; another start may have another verdict.
"""

from __future__ import annotations

import msgspec

from r2bspec.judge.methods.method_registry import METHODS
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from r2bspec.measure.samples import RunSamples


def starts_of(samples: RunSamples) -> int:
    """The number of starts whose complete segments were judged; at least 1."""
    played = [each for found in samples.iterations.values() for each in found]
    return max(1, len({each.segment.start for each in (*played, *samples.sustained.values())}))


def with_starts(verdict: Verdict, samples: RunSamples) -> Verdict:
    """A verdict on a run that says of how many starts it is.

    A run that is not judged is left as it is, and so is one without a requirement.

    Args:
        verdict: on the run.
        samples: of the run.
    """
    if verdict.outcome in {"invalid", "incomplete"} or not verdict.requirements:
        return verdict
    starts = starts_of(samples)
    return msgspec.structs.replace(
        verdict,
        starts=starts,
        reason=f"{starts_phrase(starts)}: {verdict.reason[:1].lower()}{verdict.reason[1:]}",
        requirements=tuple(_with_probed_start(one, starts) for one in verdict.requirements),
    )


def starts_phrase(starts: int) -> str:
    """What a verdict is about, as the beginning of a sentence."""
    if starts == 1:
        return "Of this start of the processes"
    return f"Over {starts} starts of the processes"


def _with_probed_start(one: RequirementVerdict, starts: int) -> RequirementVerdict:
    """A requirement that rests on probes, which are made in the first start alone, says so."""
    if starts == 1 or METHODS[one.method].rests_on == "iterations":
        return one
    note = "Probed in the first start of the processes alone."
    return msgspec.structs.replace(one, notes=(*one.notes, note))
