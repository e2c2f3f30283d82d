"""One run of a relay, end to end, and everything that must be true of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rclpy")

from r2bspec.judge.measure.host_usage import CONTROLLER_INDEX, MACHINE_INDEX
from r2bspec.record.run_record import SearchRecord, Segment
from ros_runs import HEIGHT, MEASURED, WIDTH, Bench, Finished, relay_node, relay_spec
from ros_runs import bench as bench

SERVICE_S = 0.010
# So low that a loaded machine, too, publishes within half a period of the due time.
RATES_HZ = (2.0, 4.0)
DURATION_S = 2
ITERATIONS = 2
PRECISION, CONFIRM_S = 0.2, 1

SPEC = relay_spec(
    playback=MEASURED,
    graph={"nodes": {"relay": relay_node(1e3 * SERVICE_S)}},
    benchmark={
        "duration": f"{DURATION_S} s",
        "iterations": ITERATIONS,
        "rates": [f"{rate:g} Hz" for rate in RATES_HZ],
        "warm_up": "100 ms",
        "start_timeout": "60 s",
        "search": {
            "min": "10 Hz",
            "max": "300 Hz",
            "precision": f"{100 * PRECISION:g} %",
            "probe": "1 s",
            "confirm": f"{CONFIRM_S} s",
        },
        # Fresh batches have tests of their own.
        "gate": {"confirm": False, "interference": "tolerate"},
    },
    # The busy wait alone takes longer, on any machine.
    slos={
        "impossible": {"at": "2 Hz", "require": ["latency.max < 2 ms"]},
        "at_its_limit": {"at": "peak", "level": "info", "require": ["received >= 0"]},
    },
)


@pytest.fixture(scope="module")
def done(bench: Bench) -> Finished:
    return bench.run_until_valid(SPEC)


def at_rates(done: Finished) -> list[Segment]:
    """The iterations at the rates of the spec, which come before those at the peak."""
    return [segment for segment in done.segments() if segment.rate_hz in RATES_HZ]


def peak(done: Finished) -> SearchRecord:
    found = done.run().record.search
    assert found is not None
    return found


# The run


def test_the_run_is_complete(done: Finished) -> None:
    record = done.run().record
    assert record.status == "complete"
    assert record.reason == ""
    assert record.run_id
    assert record.dataset["path"] == str(done.folder.parent / "bag")
    assert record.versions["rclpy"]


def test_the_folder_has_everything_and_nothing_else(done: Finished) -> None:
    assert sorted(each.name for each in done.folder.iterdir()) == [
        "interference.npy",
        "loaded_files.json",
        "logs",
        "plan.json",
        "record.json",
        "resources.npy",
        "result.json",
        "samples",
        "spec.yaml",
    ]
    logs = sorted(each.name for each in (done.folder / "logs").iterdir())
    assert logs == ["harness.observer.log", "monitor.log", "player.log", "relay.log"]


def test_the_phases_come_in_the_order_of_the_plan(done: Finished) -> None:
    phases = [event.removeprefix("phase ") for event in done.events() if event.startswith("phase ")]
    assert phases == list(done.run().plan.phases)
    times = [time_ns for time_ns, _ in done.run().record.events]
    assert times == sorted(times)


def test_every_process_of_the_plan_ran_and_ended_politely(done: Finished) -> None:
    run = done.run()
    planned = {process.name for process in run.plan.processes}
    assert {process.name for process in run.record.processes} == planned | {"harness.observer"}
    assert [process.exit_code for process in run.record.processes] == [0, 0, 0, 0]


def test_progress_goes_to_standard_error_and_the_report_to_standard_output(done: Finished) -> None:
    assert "warming up" in done.stderr
    assert "iteration 2 of 2" in done.stderr
    assert "relay" in done.stdout
    assert "warming up" not in done.stdout


# The samples


def test_there_is_a_segment_for_every_rate_and_iteration(done: Finished) -> None:
    played = [(at_rate.rate_hz, at_rate.index) for at_rate in at_rates(done)]
    # All rates in turn, so that a slow drift of the machine hits all.
    assert played == [(rate, index) for index in (1, 2) for rate in RATES_HZ]
    assert all(segment.complete for segment in done.run().record.segments)


def test_every_step_was_sent_received_and_matched(done: Finished) -> None:
    run = done.run()
    for segment in at_rates(done):
        playback, monitor = run.playback(segment), run.monitor(segment, "out")
        assert playback.size == segment.steps == round(DURATION_S * segment.rate_hz)
        assert sorted(monitor["stamp_ns"]) == sorted(playback["stamp_ns"])


def test_no_stamp_is_ever_played_twice(done: Finished) -> None:
    run = done.run()
    stamps = np.concatenate([run.playback(segment)["stamp_ns"] for segment in run.record.segments])
    assert np.all(np.diff(stamps) > 0)


def test_times_of_a_step_come_in_order(done: Finished) -> None:
    run = done.run()
    for segment in run.record.segments:
        playback = run.playback(segment)
        assert np.all(playback["published_ns"] >= playback["due_ns"])
        assert np.all(playback["done_ns"] >= playback["published_ns"])
        assert np.allclose(np.diff(playback["due_ns"]), 1e9 / segment.rate_hz, atol=2)


def test_no_answer_comes_sooner_than_the_node_can_give_it(done: Finished) -> None:
    run = done.run()
    for segment in at_rates(done):
        playback, monitor = run.playback(segment), run.monitor(segment, "out")
        monitor = monitor[np.argsort(monitor["stamp_ns"])]
        latency_ns = monitor["received_ns"] - playback["published_ns"]
        assert latency_ns.min() >= 1e9 * SERVICE_S
        # Two clocks meet here; they are compared to better than a tenth of a millisecond.
        assert np.all(monitor["taken_ns"] >= monitor["received_ns"] - 100_000)


def test_messages_arrive_as_large_as_they_were_sent(done: Finished) -> None:
    run = done.run()
    sizes = np.concatenate([run.monitor(at_rate, "out")["bytes"] for at_rate in at_rates(done)])
    assert np.unique(sizes).size == 1
    assert sizes[0] > WIDTH * HEIGHT * 3


def test_every_process_was_sampled_while_it_ran(done: Finished) -> None:
    rows = done.run().resources()
    assert set(rows["process"]) == {CONTROLLER_INDEX, MACHINE_INDEX, 0, 1, 2, 3}
    for number in range(4):
        used = rows[rows["process"] == number]["cpu_s"]
        assert np.all(np.diff(used) >= 0)
    names = [process.name for process in done.run().record.processes]
    relay = rows[rows["process"] == names.index("relay")]
    assert relay["cpu_s"].max() > 0.1
    assert relay["memory_bytes"].max() > 10_000_000


# The peak


def test_the_peak_lies_in_a_bracket_of_the_precision_that_was_asked(done: Finished) -> None:
    search = peak(done)
    assert search.limited_by == "graph"
    assert search.fails_hz is not None
    # What a loaded machine does not let a probe decide is left open, and widens the bracket.
    lower_hz = search.holds_hz or 10.0
    assert lower_hz < search.fails_hz
    capacity = search.capacity
    known = (
        capacity is not None and (capacity.upper_hz or 300.0) / capacity.lower_hz <= 1 + PRECISION
    )
    if search.proof == "confirmed" and known and not search.unsteady:
        refuted = [probe for probe in search.probes if probe.purpose == "confirmation"][:-1]
        assert refuted or search.fails_hz / lower_hz <= 1 + PRECISION + 1e-9


def test_the_peak_is_what_the_service_time_allows(done: Finished) -> None:
    search = peak(done)
    # One that holds is answered at 98 % of its rate at least, and no machine is faster than this.
    assert 0.98 * (search.holds_hz or 0.0) * SERVICE_S <= 1
    # A slow machine makes the service longer, in an overloaded probe as well.
    overloaded = max(search.probes, key=lambda each: each.rate_hz)
    assert overloaded.rate_hz == 300.0
    assert overloaded.holds is False
    assert overloaded.delivered_hz * SERVICE_S <= 1.02


def test_every_probe_has_its_samples_and_a_reason(done: Finished) -> None:
    run, search = done.run(), peak(done)
    assert [each.id for each in done.segments("probe")] == [each.segment for each in search.probes]
    for probe in search.probes:
        segment = next(each for each in run.record.segments if each.id == probe.segment)
        assert run.playback(segment).size >= 20
        assert probe.reason


def test_what_is_shown_of_the_peak_is_what_was_proved(done: Finished) -> None:
    search = peak(done)
    # A machine that stops for a while makes any graph unsteady.
    assert ("95 % confidence" in done.words) == search.shown
    assert ("not steady: " in done.words) == bool(search.unsteady)
    if search.proof == "open":
        assert "no rate was confirmed" in done.words
    if search.proof == "confirmed":
        # At the end of the search it is played once more.
        *_, last = [
            probe for probe in search.probes if probe.holds and probe.purpose == "confirmation"
        ]
        assert last.rate_hz == search.holds_hz
        # As long as was asked for, or until enough messages were played to bound the losses. The
        # count of messages divided by their rate may round below it.
        assert search.proof_s >= CONFIRM_S or math.isclose(search.proof_s, CONFIRM_S)
        assert search.lost_at_most is not None
        assert search.max_lost is not None
        assert search.lost_at_most <= search.max_lost


def test_iterations_are_played_at_the_peak_and_judged(done: Finished) -> None:
    holds_hz = peak(done).holds_hz
    played = [segment for segment in done.segments() if segment not in at_rates(done)]
    assert len(played) == (0 if holds_hz is None else ITERATIONS)
    requirement = done.requirement("received")
    assert requirement["at_hz"] == holds_hz
    if holds_hz is not None:
        assert all(math.isclose(segment.rate_hz, holds_hz) for segment in played)
        assert requirement["n"] > 0


# The verdict


def test_an_impossible_objective_exits_1_and_names_requirement_value_and_bound(
    done: Finished,
) -> None:
    assert done.status == 1
    requirement = done.requirement("latency.max")
    assert requirement["outcome"] == "fail"
    measured = done.result()["metrics"]["rates"][0]["pooled"]["monitors"]["out"]
    assert requirement["estimate"] == measured["values"]["latency"]["max"]
    assert "latency.max < 2 ms" in done.stdout
    assert f"{1e3 * requirement['estimate']:.3g} ms" in done.stdout


def test_judging_again_gives_the_same_result(bench: Bench, done: Finished) -> None:
    before = (done.folder / "result.json").read_bytes()
    again = bench.judge(done.folder, "--format", "json")
    assert again.status == 1
    assert again.stdout.encode() == before


# Its place in the world


def test_a_folder_that_holds_a_run_is_not_overwritten(bench: Bench, done: Finished) -> None:
    before = (done.folder / "record.json").read_bytes()
    again = bench.run(SPEC, output=done.folder)
    assert again.status == 2
    assert "is not empty" in again.error
    assert (done.folder / "record.json").read_bytes() == before
