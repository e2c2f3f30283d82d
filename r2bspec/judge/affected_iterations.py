"""Host interference: which iterations it affected, and what it does to a verdict.

``gate.interference`` says what it may do:

    tolerate    nothing: the run is judged as it was measured, and reports show the interference
    note        a FAIL that interference can explain becomes INCONCLUSIVE
    strict      also, a PASS becomes INCONCLUSIVE if it rests on anything that was affected: on an
                iteration without an unaffected rerun, unless the worst case passes, too; on a
                probe; or on a start that others disturbed while its processes came up

In all of them, what no interference can explain stays a FAIL.

What others do while a start comes up is over before its first iteration, whose own interference
counts. It can only have changed where processes and their memory lie, which differs from start to
start anyway: starts are the highest level of the sample, and a FAIL is confirmed in fresh ones. So
it is stated, and changes no FAIL.

On a shared machine other programs take the processor, and what is measured then is the machine.
`r2bspec.judge.measure.host_usage.interference_reasons` says when an iteration is affected.
Unknown values affect nothing. The verdict is the one on all iterations as they were first played:
selection must not help a graph. Only a FAIL is judged again, without the affected iterations and
in their best case:

    unaffected     the unaffected iterations alone, and where an affected one was played again and
                   the rerun was unaffected, the rerun in its place
    best case      all of these, and of each affected iteration without such a rerun as much as
                   the interference cannot explain (`r2bspec.judge.interference_bound`)

The verdict stays FAIL if either of them fails, too; otherwise it becomes INCONCLUSIVE. A PASS stays
a PASS, and nothing becomes one: whatever is found here, the share of wrong passes is that of the
iterations as they were played, and so is the share of wrong fails, or smaller.

A rerun is worth its time only where it can decide something. So an affected iteration is played
again once, at the end of its interim look, if a FAIL at its rate would otherwise become
INCONCLUSIVE, and nothing else has failed. A run that passes takes no longer on a machine with other
load, and neither does a run whose failure the interference cannot explain. After two reruns that
were affected, too, the machine counts as always busy, and no more are played.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from r2bspec.judge.interference_bound import REMEDY, largest_taken_share
from r2bspec.judge.measure.host_usage import interference_reasons, median_pressure
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import METHODS
from r2bspec.judge.validity import schedule_problem
from r2bspec.judge.verdict import DisturbedIteration, InterferencePolicy, RequirementVerdict
from r2bspec.record.run_record import Probe, RunRecord

STRICT_REMEDY: Final = f"{REMEDY[:-1]}, or allow interference: 'interference: note'."


def strict_refusal(judged: RequirementVerdict, disturbance_text: str) -> RequirementVerdict:
    """A PASS that ``strict`` does not accept; the text is without a full stop."""
    note = f"{disturbance_text}. 'interference: strict' accepts no such PASS."
    return judged.opened(note, STRICT_REMEDY)


def disturbed_starts_text(one: RequirementVerdict, samples: RunSamples) -> str:
    """Which starts that a requirement rests on were disturbed, without a full stop."""
    played = {
        start.segment.start
        for rate_hz, iterations in samples.iterations.items()
        if one.is_at(rate_hz)
        for start in iterations
    }
    rests_on = played if METHODS[one.method].rests_on == "iterations" else {1}
    found = [
        start for start in samples.record.starts if start.disturbed and start.number in rests_on
    ]
    if not found:
        return ""
    names = ", ".join(str(start.number) for start in found)
    starts = "start" if len(found) == 1 else "starts"
    return f"Host interference while {starts} {names} came up: {', '.join(found[0].disturbed)}"


def judge_probe(
    one: RequirementVerdict, record: RunRecord, policy: InterferencePolicy
) -> RequirementVerdict:
    """A verdict that rests on probes, with regard to the interference during them."""
    probes = [probe for probe in _probes_of(one, record) if probe.disturbed]
    if not probes:
        return one
    at = f"{probes[-1].rate_hz:.4g} Hz"
    text = f"Host interference during the probe at {at}: {', '.join(probes[-1].disturbed)}"
    note = f"{text}."
    if policy == "strict" and one.outcome == "pass":
        return strict_refusal(one, text)
    if one.outcome == "fail" and METHODS[one.method].rests_on == "probes":
        if policy != "tolerate" and probes[-1].explained:
            return one.opened(f"{note} Without it the rate might be sustained.", REMEDY)
        if policy != "tolerate":
            note = f"{note} That does not explain the failure."
    return one.noted(note)


def _probes_of(one: RequirementVerdict, record: RunRecord) -> list[Probe]:
    """The probes that decided a requirement, the last one of each rate."""
    rests_on = METHODS[one.method].rests_on
    if rests_on == "probes":
        probes = [probe for probe in record.sustained if one.is_at(probe.rate_hz)]
    elif rests_on == "search" and record.search is not None:
        ends = (record.search.holds_hz, record.search.fails_hz)
        probes = [probe for probe in record.search.probes if probe.rate_hz in ends]
    else:
        probes = []
    return list({probe.rate_hz: probe for probe in probes}.values())


def find_affected_iterations(samples: RunSamples) -> dict[str, DisturbedIteration]:
    """The affected iterations of a run, by the id of their segment, in the order of playing.

    Affected reruns are included.
    """
    disturbed: dict[str, DisturbedIteration] = {}
    for rate, iterations in samples.iterations.items():
        usual = median_pressure([one.interference for one in iterations])
        for iteration in iterations:
            again = samples.reruns.get(iteration.segment.id)
            for candidate in (iteration, *([again] if again is not None else [])):
                reasons = interference_reasons(candidate.interference, usual)
                if candidate is again and (late := schedule_problem(rate, [candidate])):
                    reasons = (*reasons, late)
                if reasons:
                    disturbed[candidate.segment.id] = DisturbedIteration(
                        segment=candidate.segment.id,
                        rate_hz=rate,
                        reasons=reasons,
                        rerun=again.segment.id
                        if again is not None and candidate is iteration
                        else "",
                        rerun_of=candidate.segment.rerun_of,
                        start=candidate.segment.start,
                        taken=largest_taken_share(candidate.interference),
                    )
    return disturbed


def unaffected_or_rerun(
    one: SegmentSamples, samples: RunSamples, disturbed: Mapping[str, DisturbedIteration]
) -> SegmentSamples | None:
    """An iteration if it is unaffected, else its rerun if that is, else None."""
    if one.segment.id not in disturbed:
        return one
    again = samples.reruns.get(one.segment.id)
    return again if again is not None and again.segment.id not in disturbed else None


def affected_iterations_text(
    played: RequirementVerdict, disturbed: Mapping[str, DisturbedIteration]
) -> str:
    """How many iterations at the rate of a requirement were affected; empty for none."""
    first = [
        affected
        for affected in disturbed.values()
        if not affected.rerun_of and played.is_at(affected.rate_hz)
    ]
    if not first:
        return ""
    number = f"{len(first)} iterations" if len(first) > 1 else "1 iteration"
    again = sum(bool(affected.rerun) for affected in first)
    unaffected = sum(bool(affected.rerun) and affected.rerun not in disturbed for affected in first)
    text = f"Host interference in {number}"
    if again:
        text += f"; {again} of them played again, {unaffected} without interference"
    taken = max(affected.taken for affected in first)
    return f"{text}; others took at most {show(taken, 'share')} of the time from the run"
