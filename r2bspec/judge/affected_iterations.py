"""Host interference: which iterations it affected, and what it does to a verdict.

On a shared machine other programs take the processor, and what is measured then is the machine. An
iteration of which they took more than a stated share
(`r2bspec.judge.measure.host_usage.interference_reasons`) is played again once where the outcome
depends on it; after two reruns that were affected, too, the machine counts as always busy.

With ``gate.interference: note`` a FAIL then counts only if it is clear. It is clear if

    - the unaffected iterations fail, too, with unaffected reruns in the places of the others, or
    - the run fails although in each affected iteration the faster half of the messages stands for
      all, and is shortened by the share of the time that others took (at most 3/4: a machine that
      slows everything by more than four times keeps no schedule, which makes the run INVALID).

Otherwise it is INCONCLUSIVE. The verdict is that on all iterations as they were first played:
selection must not help a graph. Nothing becomes a PASS or a FAIL here, and load can only take from
a graph: a PASS stays a PASS. With ``tolerate`` the run is judged as it was measured.

A start that comes up on a busy machine is over before its first iteration, whose own interference
counts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from r2bspec.judge.measure.host_usage import interference_reasons, taken_share
from r2bspec.judge.measure.matching import NO_MATCH
from r2bspec.judge.measure.metric_catalogue import observed_metric
from r2bspec.judge.measure.samples import (
    MonitorSamples,
    RunSamples,
    SegmentSamples,
    late_outputs,
    output_period_ns,
    samples_of_steps,
)
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import METHODS
from r2bspec.judge.validity import schedule_problem
from r2bspec.judge.verdict import DisturbedIteration, InterferencePolicy, RequirementVerdict
from r2bspec.record.run_record import Probe, RunRecord, Segment

REMEDY: Final = (
    "The machine was busy: run again when it has nothing else to do. If its load belongs to what "
    "the graph must bear, set 'gate.interference: tolerate'."
)


def find_affected_iterations(samples: RunSamples) -> dict[str, DisturbedIteration]:
    """Return the affected iterations of a run, by the id of their segment, in the order of playing.

    Affected reruns are included.
    """
    disturbed: dict[str, DisturbedIteration] = {}
    for rate, iterations in samples.iterations.items():
        for iteration in iterations:
            again = samples.reruns.get(iteration.segment.id)
            for candidate in (iteration, *([again] if again is not None else [])):
                reasons = interference_reasons(candidate.interference)
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
                        taken=taken_share(candidate.interference),
                    )
    return disturbed


def unaffected_or_rerun(
    one: SegmentSamples, samples: RunSamples, disturbed: Mapping[str, DisturbedIteration]
) -> SegmentSamples | None:
    """Return an iteration if it is unaffected, else its rerun if that is, else None."""
    if one.segment.id not in disturbed:
        return one
    again = samples.reruns.get(one.segment.id)
    return again if again is not None and again.segment.id not in disturbed else None


def affected_iterations_text(
    played: RequirementVerdict, disturbed: Mapping[str, DisturbedIteration]
) -> str:
    """Return how many iterations at the rate of a requirement were affected; empty for none."""
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


def judge_probe(
    one: RequirementVerdict, record: RunRecord, policy: InterferencePolicy
) -> RequirementVerdict:
    """Return a verdict that rests on probes, with regard to the interference during them.

    The search has left failures that interference can explain out of its bracket already.
    """
    probes = [probe for probe in _probes_of(one, record) if probe.disturbed]
    if not probes:
        return one
    at = f"{probes[-1].rate_hz:.4g} Hz"
    note = f"Host interference during the probe at {at}: {', '.join(probes[-1].disturbed)}."
    if policy != "tolerate" and one.outcome == "fail" and METHODS[one.method].rests_on == "probes":
        if probes[-1].explained:
            return one.opened(f"{note} Without it the rate might be sustained.", REMEDY)
        note = f"{note} That does not explain the failure."
    return one.noted(note)


def _probes_of(one: RequirementVerdict, record: RunRecord) -> list[Probe]:
    """Return the probes that decided a requirement, the last probe of each rate."""
    rests_on = METHODS[one.method].rests_on
    if rests_on == "probes":
        probes = [probe for probe in record.sustained if one.is_at(probe.rate_hz)]
    elif rests_on == "search" and record.search is not None:
        ends = (record.search.holds_hz, record.search.fails_hz)
        probes = [probe for probe in record.search.probes if probe.rate_hz in ends]
    else:
        probes = []
    return list({probe.rate_hz: probe for probe in probes}.values())


def best_case_iteration(one: SegmentSamples) -> SegmentSamples:
    """Return an affected iteration as it was at best without the interference."""
    taken = taken_share(one.interference)
    anatomy = {
        name: np.maximum(0.0, values - taken)
        if (metric := observed_metric(name)) is not None and metric.dimension == "share"
        else _faster_half(values) * (1 - taken)
        for name, values in one.anatomy.items()
    }
    monitors = {name: _best_case_samples(one, seen, taken) for name, seen in one.monitors.items()}
    return replace(one, monitors=monitors, anatomy=anatomy)


def _faster_half(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values with those of the faster half in the places of the others."""
    better = -(-values.size // 2)
    order = np.argsort(values, kind="stable")
    found = values.copy()
    found[order[better:]] = values[order[: values.size - better]]
    return found


def _best_case_samples(one: SegmentSamples, seen: MonitorSamples, taken: float) -> MonitorSamples:
    if seen.own_pace:
        times = {name: _faster_half(found) * (1 - taken) for name, found in seen.times.items()}
        return replace(seen, times=times, throughput_hz=seen.throughput_hz / (1 - taken))
    steps, most_hz = seen.steps, one.playback.rate_hz * seen.per_step
    lost_as_infinite = np.where(
        steps.answered, (steps.received_ns - steps.published_ns).astype(np.float64), math.inf
    )
    latency = _faster_half(lost_as_infinite) * (1 - taken)
    gained_hz = min(most_hz, seen.throughput_hz + taken * most_hz)
    return _with_latencies(one.segment, seen, latency, max(seen.throughput_hz, gained_hz))


def _with_latencies(
    segment: Segment, seen: MonitorSamples, latency: NDArray[np.float64], throughput_hz: float
) -> MonitorSamples:
    """Return what a monitor would have received with other latencies, in ns; infinite for lost."""
    arrives = np.isfinite(latency)
    received_ns = np.full(latency.size, NO_MATCH, dtype=np.int64)
    received_ns[arrives] = seen.steps.published_ns[arrives] + np.round(latency[arrives]).astype(
        np.int64
    )
    steps = replace(seen.steps, received_ns=received_ns)
    period_ns = output_period_ns(segment, seen.sent, seen.per_step)
    ended_ns = segment.began_ns + round(latency.size * period_ns)
    found = samples_of_steps(steps, ended_ns, 0.0, 0.0)
    return replace(
        seen,
        steps=steps,
        times=found.times,
        # Interference creates no messages.
        received=found.received + seen.duplicates + seen.unmatched,
        throughput_hz=throughput_hz,
        reordered=steps.reordered,
        late=late_outputs(segment, steps),
        # Which step each output answers is known here.
        by_order=False,
        surplus=0,
    )
