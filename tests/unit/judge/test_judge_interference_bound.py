"""What waiting for a processor can explain: never less than it did, and not much more."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nightly import size
from r2bspec.judge.interference_bound import (
    best_case_iteration,
    shortest_latencies,
    taken_share,
    worst_case_iteration,
)
from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.measure.samples import SegmentSamples
from run_simulation import Played, Simulation
from simulated_waits import Disturbed, Stalls, disturbed


def bound(found: Disturbed) -> np.ndarray:
    taken = taken_share(found.interference)
    assert taken is not None
    return shortest_latencies(found.seen, taken, found.interference.seconds, 30.0) / 1e9


@st.composite
def some_stalls(draw: st.DrawFn) -> Stalls:
    """Few long ones or many short ones: up to a third of ten seconds."""
    length = draw(st.sampled_from([0.002, 0.02, 0.3, 1.5]))
    number = draw(st.integers(0, max(1, int(3 / length))))
    return stalls_of(length, number, draw(st.integers(0, 99)))


def stalls_of(length: float, number: int, seed: int) -> Stalls:
    """Stalls at random, one after the other where they would overlap."""
    starts = np.sort(np.random.default_rng(seed).uniform(0, 8, number))
    gaps = np.maximum.accumulate(starts - np.arange(number) * length)
    return [(float(gap), length) for gap in gaps + np.arange(number) * length]


@settings(deadline=None, max_examples=size(60, 300), suppress_health_check=[HealthCheck.too_slow])
@given(
    load=st.sampled_from([0.1, 0.5, 0.9, 0.97, 1.05, 1.5, 2.0]),
    depth=st.sampled_from([1, 2, 5, 100]),
    stalls=some_stalls(),
    spread=st.sampled_from([0.0, 0.3]),
)
def test_no_more_is_blamed_on_the_graph_than_it_does_alone(
    load: float, depth: int, stalls: Stalls, spread: float
) -> None:
    found = disturbed(load, depth=depth, stalls=stalls, spread=spread)
    # A message at the end of a stall falls on either side of it.
    assert np.isinf(bound(found)).sum() <= np.isinf(found.latency).sum() + 2
    ranks = slice(0, found.latency.size - 2)
    shortest = bound(found)[ranks]
    finite = np.isfinite(shortest)
    assert np.all(shortest[finite] <= found.latency[ranks][finite] * 1.01 + 1e-6)


@pytest.mark.parametrize(
    ("depth", "length", "number", "seed"),
    [(2, 0.02, 81, 1261), (2, 0.02, 66, 8885), (1, 0.02, 64, 6304), (2, 0.002, 133, 3170)],
)
def test_losses_of_services_that_differ_are_explained(
    depth: int, length: float, number: int, seed: int
) -> None:
    # So near to its capacity that a few services shorter than the mean decide what is lost: with
    # w n + 1 messages explained, four to five more than alone were blamed on the graph.
    stalls = stalls_of(length, number, seed)
    found = disturbed(1.05, depth=depth, stalls=stalls, spread=0.3)
    assert np.isinf(bound(found)).sum() <= np.isinf(found.latency).sum() + 2


@pytest.mark.parametrize("depth", [2, 5, 100])
def test_an_overloaded_graph_stays_overloaded(depth: int) -> None:
    # Twice too slow, and 10 % of the time taken from it.
    stalls = [(number * 0.2, 0.02) for number in range(50)]
    found = disturbed(2.0, depth=depth, stalls=stalls)
    shortest = bound(found)
    measured = np.sort(found.seen.in_order("latency", np.inf))
    # 10 % of 300 messages, and one.
    assert np.isinf(shortest).sum() >= np.isinf(measured).sum() - 32
    assert shortest[120] > 0.2 * measured[120]


def test_short_waits_do_not_explain_long_latencies() -> None:
    # 20 ms alone, and 2 ms of waiting in every tenth of a second.
    stalls = [(number * 0.1, 0.002) for number in range(100)]
    found = disturbed(0.6, depth=10, stalls=stalls)
    assert bound(found)[150] > 0.018


def test_a_backlog_does_not_hide_the_work_of_each_message() -> None:
    # One busy period of 300 messages, each of which takes 30 ms, and 2 % of waiting.
    found = disturbed(0.9, depth=100, stalls=[(0.0, 0.2)])
    assert bound(found)[250] > 0.025


def test_another_hardware_thread_halves_the_speed_at_most() -> None:
    found = disturbed(0.5, depth=5, stalls=[])
    alone = shortest_latencies(found.seen, 0.5, 10.0, 30.0, shared=0.5) / 1e9
    assert alone == pytest.approx(found.latency / 2)


SHARED = HostInterference(
    seconds=10.0, own_waited=0.1, own_cores=0.4, foreign_cores=1.5, threads_per_core=2
)


@pytest.mark.parametrize(
    ("known", "share"),
    [
        (None, None),
        (HostInterference(seconds=10.0, pressure=0.9, foreign_cores=1.9), None),
        (HostInterference(seconds=10.0, pressure=0.9, own_waited=0.05), 0.05),
        # The sum over threads that wait at once is more than the time.
        (HostInterference(seconds=10.0, pressure=0.3, own_waited=1.2), 0.3),
        (HostInterference(seconds=10.0, own_waited=0.1, own_cores=0.4, foreign_cores=1.5), 0.1),
        (HostInterference(seconds=10.0, own_waited=0.1, own_cores=1.5, foreign_cores=0.2), 0.1),
        (SHARED, 0.3),
        (msgspec.structs.replace(SHARED, own_cores=1.5, foreign_cores=0.2), 0.2),
        (HostInterference(seconds=10.0, own_waited=0.1, cores=2, steal=0.1, throttled_s=1.0), 0.4),
        (HostInterference(seconds=10.0, own_waited=0.1, calibration=2.0), 0.5),
        (HostInterference(seconds=10.0, own_waited=3.0), 0.75),
    ],
)
def test_the_share_of_the_time_that_was_taken(
    known: HostInterference | None, share: float | None
) -> None:
    assert taken_share(known) == (None if share is None else pytest.approx(share))


def test_what_the_kernel_counts_is_believed_at_a_pace_of_its_own_too() -> None:
    (one,) = Simulation(segments=[Played(50, [0.01] * 50)]).samples().iterations[50]
    monitors = {name: replace(seen, own_pace=True) for name, seen in one.monitors.items()}
    # Others waited for a processor, and the run did not.
    known = HostInterference(seconds=1.0, pressure=0.5, own_waited=0.0)
    one = replace(one, monitors=monitors, interference=known)
    best = best_case_iteration(one).monitors
    for name, seen in monitors.items():
        assert best[name].throughput_hz == seen.throughput_hz
        assert best[name].times["interval"] == pytest.approx(seen.times["interval"])


def observed(seed: int, taken: float) -> tuple[SegmentSamples, SegmentSamples]:
    """A second of callbacks on one thread, without and with stops of others for a share of it."""
    random = np.random.default_rng(seed)
    (alone,) = Simulation(segments=[Played(50, [0.01] * 50)]).samples().iterations[50]
    callbacks = random.uniform(0.004, 0.012, 50)
    stops = random.dirichlet(np.ones(50)) * taken
    shares = {"node.load": np.array([callbacks.sum()]), "path.node.share": np.array([0.5])}
    alone = replace(alone, anatomy={"node.callback": callbacks, **shares})
    later = np.array([(callbacks + stops).sum()])
    anatomy = {"node.callback": callbacks + stops, "node.load": later, "path.node.share": later}
    return alone, replace(alone, anatomy=anatomy)


@pytest.mark.parametrize("seed", range(20))
def test_what_is_observed_from_inside_was_not_better_than_its_best_case(seed: int) -> None:
    alone, disturbed_one = observed(seed, 0.05)
    best = best_case_iteration(disturbed_one, 0.05).anatomy
    assert np.all(np.sort(best["node.callback"]) <= np.sort(alone.anatomy["node.callback"]) + 1e-9)
    assert best["node.load"][0] <= alone.anatomy["node.load"][0] + 1e-9
    assert best["path.node.share"][0] == 0
    # Nor is everything blamed on others: half of the callbacks keep most of their time.
    assert np.median(best["node.callback"]) > 0.2 * np.median(alone.anatomy["node.callback"])
    worst = worst_case_iteration(disturbed_one, 0.05).anatomy
    assert np.all(worst["node.callback"] >= np.sort(disturbed_one.anatomy["node.callback"]))
    assert worst["node.load"][0] >= disturbed_one.anatomy["node.load"][0]
