"""Laws of measuring that hold for every sample."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from r2bspec.judge.measure.host_usage import ProcessSamples
from r2bspec.judge.measure.matching import StepRatio, arrivals, match
from r2bspec.judge.measure.times import intervals, jitter, percentile
from r2bspec.judge.measure.units import show
from r2bspec.record.sample_arrays import MONITOR_DTYPE, PLAYBACK_DTYPE, RESOURCE_DTYPE, Rows
from run_simulation import EPOCH_NS, samples_of, segment_of

finite = st.floats(min_value=0, max_value=1e3, allow_nan=False)
samples = st.lists(finite, min_size=1, max_size=60).map(np.array)


@st.composite
def traffic(draw: st.DrawFn) -> tuple[Rows, Rows]:
    """Any steps, and any messages: answers, repetitions and strangers in any order."""
    n = draw(st.integers(0, 30))
    playback = np.zeros(n, PLAYBACK_DTYPE)
    playback["stamp_ns"] = draw(st.permutations(range(100, 100 + n)))
    playback["published_ns"] = EPOCH_NS + np.arange(n) * 10**7
    stamps = draw(st.lists(st.integers(95, 100 + n + 5), max_size=60))
    monitor = np.zeros(len(stamps), MONITOR_DTYPE)
    monitor["stamp_ns"] = stamps
    monitor["received_ns"] = EPOCH_NS + np.array(
        sorted(draw(st.lists(st.integers(0, 10**9), min_size=len(stamps), max_size=len(stamps)))),
        dtype=np.int64,
    )
    return playback, monitor


@given(samples, st.floats(min_value=0.001, max_value=1))
def test_a_percentile_is_an_observed_value(values: np.ndarray, q: float) -> None:
    found = percentile(values, q)
    assert found in values
    assert np.count_nonzero(values <= found) >= q * values.size - 1e-6


@given(samples, st.floats(0.001, 1), st.floats(0.001, 1), st.integers(0, 5))
def test_percentiles_rise_with_the_fraction_and_with_losses(
    values: np.ndarray,
    a: float,
    b: float,
    lost: int,
) -> None:
    low, high = percentile(values, min(a, b)), percentile(values, max(a, b))
    with_losses = percentile(values, a, lost)
    without = percentile(values, a)
    assert low is not None
    assert high is not None
    assert with_losses is not None
    assert without is not None
    assert low <= high
    assert without <= with_losses


@given(traffic(), st.sampled_from(["stamp", "order"]))
def test_matching_conserves_counts(rows: tuple[Rows, Rows], by: str) -> None:
    playback, monitor = rows
    found = match(playback, monitor, by)  # type: ignore[arg-type]
    answered = int(np.count_nonzero(found.answered))
    assert playback.size == answered + found.missed
    assert monitor.size == answered + found.duplicates + found.unmatched
    seen = samples_of(playback, monitor, found)
    assert 0 <= seen.reordered <= max(0, answered - 1)
    assert (seen.answered, seen.missed) == (answered, found.missed)
    assert (seen.received, seen.duplicates) == (monitor.size, found.duplicates)
    assert seen.latency.size == (0 if seen.unknown_latency else answered)


@given(traffic())
def test_matching_pairs_equal_stamps_with_the_first_message(rows: tuple[Rows, Rows]) -> None:
    playback, monitor = rows
    found = match(playback, monitor, "stamp")
    for step, row in enumerate(found.first_row):
        equal = np.flatnonzero(monitor["stamp_ns"] == playback["stamp_ns"][step])
        assert row == (equal[0] if equal.size else -1)


@given(traffic())
def test_intervals_add_up(rows: tuple[Rows, Rows]) -> None:
    playback, monitor = rows
    arrived = arrivals(monitor, match(playback, monitor, "stamp"))
    gaps = intervals(arrived)
    assert jitter(arrived).size == max(0, arrived.size - 2)
    if arrived.size < 2 or arrived[-1] == arrived[0]:
        return
    span = (arrived[-1] - arrived[0]) / 1e9
    assert abs(gaps.sum() - span) < 1e-9 * arrived.size


@given(
    traffic(),
    st.sampled_from(["stamp", "order"]),
    st.builds(StepRatio, st.integers(1, 5), st.integers(1, 4), st.integers(0, 20)),
    st.integers(1, 10**11),
)
def test_throughput_is_never_more_than_what_was_offered_and_answered(
    rows: tuple[Rows, Rows], by: str, ratio: StepRatio, length_ns: int
) -> None:
    playback, monitor = rows
    if by == "stamp":
        ratio = StepRatio()
    matching = match(playback, monitor, by, ratio)  # type: ignore[arg-type]
    segment = segment_of(10.0, int(playback.size), length_ns=length_ns)
    seen = samples_of(playback, monitor, matching, segment)
    if not seen.expected:
        assert seen.throughput_hz == 0
        return
    offered_hz = playback.size * ratio.per_step / (length_ns / 1e9)
    assert 0 <= seen.throughput_hz <= offered_hz * seen.answered / seen.expected * (1 + 1e-9)


@given(
    st.floats(min_value=-1e9, max_value=1e15), st.sampled_from(["s", "Hz", "share", "B", "count"])
)
def test_every_value_can_be_shown(value: float, unit: str) -> None:
    text = show(value, unit)
    assert text
    assert "e+" not in text


@given(
    traffic(),
    st.builds(StepRatio, st.integers(1, 5), st.integers(1, 4), st.integers(0, 20)),
)
def test_matching_by_a_ratio_conserves_counts(rows: tuple[Rows, Rows], ratio: StepRatio) -> None:
    playback, monitor = rows
    found = match(playback, monitor, "order", ratio)
    answered = int(np.count_nonzero(found.answered))
    assert found.trigger_steps.size == answered + found.missed
    assert monitor.size == answered + found.duplicates + found.unmatched
    # A group ends with each step whose number in the whole run is a multiple of its inputs.
    numbers = ratio.before + found.trigger_steps + 1
    assert not (numbers % ratio.inputs).any()
    assert abs(found.trigger_steps.size / ratio.outputs - playback.size / ratio.inputs) < 1


@st.composite
def usage(draw: st.DrawFn) -> Rows:
    """Samples of some processes, at any distances."""
    rows = []
    for process in range(draw(st.integers(1, 3))):
        gaps = draw(st.lists(st.integers(1, 10**9), min_size=1, max_size=20))
        of_process = np.zeros(len(gaps), RESOURCE_DTYPE)
        of_process["time_ns"] = EPOCH_NS + np.cumsum(gaps)
        grown = draw(st.lists(st.floats(0, 1), min_size=len(gaps), max_size=len(gaps)))
        for field in ("cpu_s", "waited_s"):
            of_process[field] = np.cumsum(grown)
        of_process["memory_bytes"] = draw(st.permutations(range(len(gaps))))
        of_process["process"] = process
        rows.append(of_process)
    together = np.concatenate(rows)
    return together[np.argsort(together["time_ns"], kind="stable")]


@given(usage(), st.integers(0, 2 * 10**9), st.integers(1, 10**10))
def test_what_a_process_used_in_a_window_lies_in_it(
    rows: Rows, since_ns: int, took_ns: int
) -> None:
    began, ended = EPOCH_NS + since_ns, EPOCH_NS + since_ns + took_ns
    for index, use in ProcessSamples(rows).used(began, ended).items():
        of_process = rows[rows["process"] == index]
        inside = of_process[(of_process["time_ns"] >= began) & (of_process["time_ns"] <= ended)]
        assert use.memory_max_bytes == (inside["memory_bytes"].max() if inside.size else None)
        if use.cpu_mean is None or use.cpu_max is None:
            continue
        since, until = (
            max(began, of_process["time_ns"][0]),
            min(ended, of_process["time_ns"][-1]),
        )
        first, last = np.interp([since, until], of_process["time_ns"], of_process["cpu_s"])
        assert use.cpu_mean == pytest.approx((last - first) / ((until - since) / 1e9), abs=1e-4)
        assert use.cpu_max >= use.cpu_mean
