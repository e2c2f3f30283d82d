"""Iterations that the machine disturbed, and what they may do to a verdict.

A shared machine is at times not there: a neighbour takes the processor, the hypervisor takes it
away (steal), it is throttled for heat. What is measured then is the machine. An iteration is
disturbed if one of these is known of it:

    steal          over 1 % of the time of all cores was given to other virtual machines
    foreign load   processes outside the benchmark used more than a tenth of all cores, and
                   more than half a core
    pressure       tasks waited for a processor for over 10 % of the time, and more than twice as
                   long as in the median iteration: a graph with more threads than cores makes
                   pressure of its own, but the same in each iteration
    throttling     the kernel reports that a processor was throttled, or the control group ran
                   out of its quota
    calibration    the harness alone, with no graph between player and monitor, took over 1.5
                   times as long as it usually does on this machine

What is not known disturbs nothing. A disturbed iteration is played again, once. It then has two
verdicts: on all iterations as they were first played, and on the undisturbed ones with the new
ones in their places. Selection must not help a graph, so the first is the verdict, except that

    a FAIL which the undisturbed iterations do not confirm becomes INCONCLUSIVE.

A PASS stays a PASS, and nothing becomes one.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec

from r2bspec.measure.samples import RunSamples, SegmentSamples
from r2bspec.measure.units import show
from r2bspec.slo.model import RequirementVerdict
from r2bspec.slo.terms import Disturbed

_STEAL = 0.01
_FOREIGN_SHARE = 0.1
_FOREIGN_CORES = 0.5
_PRESSURE = 0.1
_PRESSURE_RATIO = 2.0
_CALIBRATION = 1.5

_SETTLE = "Run again on a machine that does nothing else."


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What else happened on the machine during one iteration; None is unknown.

    Attributes:
        cores: processors that the run may use.
        steal: of the time of all cores, the share that other virtual machines got.
        foreign_cores: processor time per time that processes outside the benchmark used.
        pressure: share of the time in which some task waited for a processor (PSI, ``some``).
        throttled_s: time for which a processor or the control group was throttled.
        calibration: how long the harness alone took, over what it usually takes here.
    """

    cores: int | None = None
    steal: float | None = None
    foreign_cores: float | None = None
    pressure: float | None = None
    throttled_s: float | None = None
    calibration: float | None = None


def find_disturbed(surroundings: Sequence[Surroundings]) -> list[tuple[str, ...]]:
    """What disturbed each iteration of one rate, in words; empty where nothing is known to.

    Args:
        surroundings: one for each iteration at that rate.
    """
    pressures = [one.pressure for one in surroundings if one.pressure is not None]
    usual = statistics.median(pressures) if pressures else 0.0
    return [tuple(_reasons(one, usual)) for one in surroundings]


def _reasons(one: Surroundings, usual_pressure: float) -> list[str]:
    found: list[str] = []
    if one.steal is not None and one.steal > _STEAL:
        found.append(f"{show(one.steal, 'share')} of the processor time was stolen")
    if one.foreign_cores is not None:
        least = max(_FOREIGN_CORES, _FOREIGN_SHARE * (one.cores or 0))
        if one.foreign_cores > least:
            found.append(f"other processes used {one.foreign_cores:.2g} cores")
    if one.pressure is not None and one.pressure > max(_PRESSURE, _PRESSURE_RATIO * usual_pressure):
        found.append(f"tasks waited for a processor {show(one.pressure, 'share')} of the time")
    if one.throttled_s is not None and one.throttled_s > 0:
        found.append(f"processors were throttled for {show(one.throttled_s, 's')}")
    if one.calibration is not None and one.calibration > _CALIBRATION:
        found.append(f"the harness alone took {one.calibration:.2g} times as long as usual")
    return found


def foreign_cores(samples: SegmentSamples) -> float | None:
    """Processor time per time that no process of the run used; None where it was not sampled."""
    if samples.machine is None or samples.machine.cpu_mean is None:
        return None
    own = [used.cpu_mean for used in samples.processes.values() if used.cpu_mean is not None]
    return max(0.0, samples.machine.cpu_mean - sum(own)) if own else None


def split_disturbed(
    samples: RunSamples, disturbed: Mapping[str, Disturbed]
) -> tuple[RunSamples, RunSamples | None]:
    """The run as it was first played, and the run without disturbed iterations.

    Returns:
        The second is None if no iteration is disturbed.
    """
    if not disturbed:
        return samples, None
    reruns = {one.rerun for one in disturbed.values() if one.rerun}
    played: dict[float, tuple[SegmentSamples, ...]] = {}
    calm: dict[float, tuple[SegmentSamples, ...]] = {}
    for rate, iterations in samples.iterations.items():
        by_id = {one.segment.id: one for one in iterations}
        first = [one for one in iterations if one.segment.id not in reruns]
        places = [_in_place_of(one, by_id, disturbed) for one in first]
        played[rate] = tuple(first)
        calm[rate] = tuple(one for one in places if one is not None)
    return replace(samples, iterations=played), replace(samples, iterations=calm)


def _in_place_of(
    one: SegmentSamples,
    by_id: Mapping[str, SegmentSamples],
    disturbed: Mapping[str, Disturbed],
) -> SegmentSamples | None:
    """An iteration if it is undisturbed, or its rerun if that is, or None."""
    found = disturbed.get(one.segment.id)
    if found is None:
        return one
    return by_id.get(found.rerun) if found.rerun not in disturbed else None


def told_of(disturbed: Mapping[str, Disturbed]) -> str:
    """Which iterations were disturbed, and by what, as the beginning of a sentence."""
    parts = [
        f"{name} ({'; '.join(one.reasons)}{', played again' if one.rerun else ''})"
        for name, one in disturbed.items()
    ]
    return f"Disturbed by the machine: {', '.join(parts)}"


def weaken(played: RequirementVerdict, calm: RequirementVerdict, told: str) -> RequirementVerdict:
    """A requirement on all iterations, in the light of the undisturbed ones.

    Args:
        played: the verdict on all iterations as they were first played.
        calm: the verdict without the disturbed ones.
        told: which they are (`told_of`).
    """
    did = {"pass": "passes", "fail": "fails", "inconclusive": "stays open"}[calm.outcome]
    note = f"{told}. Without them the requirement {did}."
    notes = (*played.notes, note)
    if played.outcome == "fail" and calm.outcome != "fail":
        return msgspec.structs.replace(played, outcome="inconclusive", settle=_SETTLE, notes=notes)
    return msgspec.structs.replace(played, notes=notes)
