"""What host interference does to a verdict, as ``gate.interference`` says.

    tolerate    nothing: the run is judged as it was measured, and reports show the interference
    note        a FAIL that interference can explain becomes INCONCLUSIVE
    strict      also, a PASS becomes INCONCLUSIVE if it rests on anything that was affected: on an
                iteration without an unaffected rerun, on a probe, or on a start that others
                disturbed while its processes came up

In all of them, what no interference can explain stays a FAIL. Iterations are examined in
`r2bspec.judge.affected_iterations`; this module has the rest: the PASS under ``strict``,
requirements that rest on probes, and starts.

What others do while a start comes up is over before its first iteration, whose own interference
counts. It can only have changed where processes and their memory lie, which differs from start to
start anyway: starts are the highest level of the sample, and a FAIL is confirmed in fresh ones. So
it is stated, and changes no FAIL.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final, Literal

import msgspec

from r2bspec.judge.methods.method_registry import METHODS
from r2bspec.judge.verdict import DisturbedIteration, RequirementVerdict
from r2bspec.measure.samples import RunSamples
from r2bspec.record.run_record import Probe, RunRecord

InterferencePolicy = Literal["tolerate", "note", "strict"]

REMEDY: Final = "Run again on an otherwise idle machine."
STRICT_REMEDY: Final = f"{REMEDY[:-1]}, or allow interference: 'interference: note'."


def strict_pass(
    judged: RequirementVerdict,
    unaffected: RequirementVerdict,
    disturbed: Mapping[str, DisturbedIteration],
    disturbance_text: str,
) -> RequirementVerdict:
    """A PASS on iterations, under ``strict``.

    Args:
        judged: the verdict on all iterations as they were first played.
        unaffected: the verdict on the unaffected ones, with unaffected reruns in their places.
        disturbed: the affected iterations.
        disturbance_text: those of this requirement, without a full stop; empty for none.
    """
    if judged.outcome != "pass" or not disturbance_text:
        return judged
    left = [
        one
        for one in disturbed.values()
        if not one.rerun_of
        and judged.at_hz is not None
        and math.isclose(one.rate_hz, judged.at_hz)
        and (not one.rerun or one.rerun in disturbed)
    ]
    if not left and unaffected.outcome == "pass":
        note = f"{disturbance_text}. With those in their places it passes, too."
        return msgspec.structs.replace(judged, notes=(*judged.notes, note))
    return strict_refusal(judged, disturbance_text)


def strict_refusal(judged: RequirementVerdict, disturbance_text: str) -> RequirementVerdict:
    """A PASS that ``strict`` does not accept; the text is without a full stop."""
    return _open(judged, f"{disturbance_text}. 'interference: strict' accepts no such PASS.")


def judge_probes(
    requirements: Iterable[RequirementVerdict], record: RunRecord, policy: InterferencePolicy
) -> tuple[RequirementVerdict, ...]:
    """The verdicts that rest on probes, with regard to the interference during them.

    The search has left failures that interference can explain out of its bracket already.
    """
    return tuple(_judge_probe(one, record, policy) for one in requirements)


def judge_starts(
    requirements: Iterable[RequirementVerdict], samples: RunSamples, policy: InterferencePolicy
) -> tuple[RequirementVerdict, ...]:
    """The verdicts with regard to the interference while starts came up."""
    return tuple(
        strict_refusal(one, text)
        if policy == "strict"
        and one.outcome == "pass"
        and (text := _disturbed_starts_text(one, samples))
        else one
        for one in requirements
    )


def _disturbed_starts_text(one: RequirementVerdict, samples: RunSamples) -> str:
    """Which starts that a requirement rests on were disturbed, without a full stop."""
    played = {
        each.segment.start
        for rate_hz, found in samples.iterations.items()
        if one.at_hz is not None and math.isclose(rate_hz, one.at_hz)
        for each in found
    }
    rests_on = played if METHODS[one.method].rests_on == "iterations" else {1}
    found = [each for each in samples.record.starts if each.disturbed and each.number in rests_on]
    if not found:
        return ""
    names = ", ".join(str(each.number) for each in found)
    starts = "start" if len(found) == 1 else "starts"
    return f"Host interference while {starts} {names} came up: {', '.join(found[0].disturbed)}"


def _judge_probe(
    one: RequirementVerdict, record: RunRecord, policy: InterferencePolicy
) -> RequirementVerdict:
    probes = [each for each in _probes_of(one, record) if each.disturbed]
    if not probes:
        return one
    at = f"{probes[-1].rate_hz:.4g} Hz"
    text = f"Host interference during the probe at {at}: {', '.join(probes[-1].disturbed)}"
    note = f"{text}."
    if policy == "strict" and one.outcome == "pass":
        return strict_refusal(one, text)
    if one.outcome == "fail" and METHODS[one.method].rests_on == "probes":
        if policy != "tolerate" and probes[-1].explained:
            return _open(one, f"{note} Without it the rate might be sustained.", REMEDY)
        if policy != "tolerate":
            note = f"{note} That does not explain the failure."
    return msgspec.structs.replace(one, notes=(*one.notes, note))


def _probes_of(one: RequirementVerdict, record: RunRecord) -> list[Probe]:
    """The probes that decided a requirement, the last one of each rate."""
    rests_on = METHODS[one.method].rests_on
    if rests_on == "probes":
        found = [
            each
            for each in record.sustained
            if one.at_hz is not None and math.isclose(each.rate_hz, one.at_hz)
        ]
    elif rests_on == "search" and record.search is not None:
        ends = (record.search.holds_hz, record.search.fails_hz)
        found = [each for each in record.search.probes if each.rate_hz in ends]
    else:
        found = []
    return list({each.rate_hz: each for each in found}.values())


def _open(one: RequirementVerdict, note: str, remedy: str = STRICT_REMEDY) -> RequirementVerdict:
    return msgspec.structs.replace(
        one, outcome="inconclusive", remedy=remedy, notes=(*one.notes, note), weakened=True
    )
