"""Host interference: which iterations it affected, and how it changes a verdict.

On a shared machine other programs take the processor, and the measurement then shows the machine,
not the graph. An iteration of which they took more than a stated share
(`r2bspec.judge.measure.host_usage.interference_reasons`) is played again once if the outcome
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

from r2bspec.judge.measure.host_usage import interference_reasons, taken_share
from r2bspec.judge.measure.matching import NO_MATCH
from r2bspec.judge.measure.metric_catalogue import measured_metric
from r2bspec.judge.measure.sample_table import MonitorSamples
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples
from r2bspec.judge.measure.times import faster_half
from r2bspec.judge.measure.units import show
from r2bspec.judge.methods import METHODS
from r2bspec.judge.validity import schedule_problem
from r2bspec.judge.verdict import DisturbedIteration, InterferencePolicy, RequirementVerdict
from r2bspec.record.run_record import Probe, RunRecord

REMEDY: Final = (
    "The machine was busy: run again on an idle machine. If the graph must bear such "
    "load, set 'gate.interference: tolerate'."
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
    """Return an iteration if it is unaffected, else an unaffected rerun of it, else None."""
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
    """Return the verdict of a requirement on probes after an examination of interference.

    The search has already removed failures that interference can explain from its bracket.
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
    """Return an affected iteration as it would have been, at best, without the interference."""
    taken = taken_share(one.interference)
    anatomy = {
        name: np.maximum(0.0, values - taken)
        if (metric := measured_metric(name)) is not None and metric.dimension == "share"
        else faster_half(values) * (1 - taken)
        for name, values in one.anatomy.items()
    }
    monitors = {name: _best_case_samples(one, seen, taken) for name, seen in one.monitors.items()}
    return replace(one, monitors=monitors, anatomy=anatomy)


def _best_case_samples(one: SegmentSamples, seen: MonitorSamples, taken: float) -> MonitorSamples:
    if seen.kind != "answers":
        return seen.shortened(taken)
    published_ns, most_hz = seen.outputs["published_ns"], one.playback.rate_hz * seen.per_step
    latency_ns = np.where(
        seen.came, (seen.outputs["received_ns"] - published_ns).astype(np.float64), math.inf
    )
    latency_ns = faster_half(latency_ns) * (1 - taken)
    arrives = np.isfinite(latency_ns)
    received_ns = np.full(latency_ns.size, NO_MATCH, dtype=np.int64)
    received_ns[arrives] = published_ns[arrives] + np.round(latency_ns[arrives]).astype(np.int64)
    gained_hz = min(most_hz, seen.throughput_hz + taken * most_hz)
    return seen.with_outputs(received_ns, max(seen.throughput_hz, gained_hz))
