"""A search that meets the end of its range, and what is played at the peak that it finds."""

from __future__ import annotations

import math

import pytest

from machine_load import skip_for_load
from r2bspec.record.run_record import SearchRecord
from ros_runs import Bench, Finished, relay_spec

ITERATIONS = 2

SPEC = relay_spec(
    benchmark={
        "duration": "500 ms",
        "iterations": ITERATIONS,
        "warm_up": "100 ms",
        "start_timeout": "60 s",
        "search": {
            "min": "20 Hz",
            "max": "40 Hz",
            "precision": "10 %",
            "probe": "4 s",
            "confirm": "2 s",
        },
        "gate": {"confirm": False, "interference": "tolerate"},
    },
    slos={"at_its_limit": {"at": "peak", "level": "info", "require": ["received >= 0"]}},
)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    return Bench(tmp_path_factory.mktemp("peak")).run(SPEC)


@pytest.fixture(scope="module")
def search(done: Finished) -> SearchRecord:
    found = done.run().record.search
    assert found is not None
    if found.holds_hz is None:
        skip_for_load("relay 20 messages a second")
    return found


def test_what_holds_up_to_the_end_of_the_range_is_called_a_lower_bound(
    done: Finished, search: SearchRecord
) -> None:
    words = " ".join(done.stdout.split())
    if search.upper_hz is None:
        assert search.limited_by in {"range", "player"}
        assert f"at least {search.holds_hz:.4g} Hz" in words
    else:
        assert "between" in words
    # A machine that stops for a while makes any graph unsteady.
    assert ("95 % confidence" in words) == search.shown
    if search.proof == "open":
        assert "no rate was confirmed" in words
    assert ("not steady: " in words) == bool(search.unsteady)


def test_the_lower_end_was_played_whole(search: SearchRecord) -> None:
    if search.proof != "confirmed":
        skip_for_load("relay 20 messages a second")
    (last,) = [each for each in search.probes if each.holds and each.purpose == "confirmation"]
    assert last.rate_hz == search.holds_hz
    # As long as was asked for, or until enough messages were played to bound the losses.
    assert search.proof_s >= 2.0
    assert search.lost_at_most is not None
    assert search.max_lost is not None
    assert search.lost_at_most <= search.max_lost


def test_the_iterations_are_played_at_the_peak_and_judged(
    done: Finished, search: SearchRecord
) -> None:
    assert search.holds_hz is not None
    played = [each for each in done.run().record.segments if each.kind == "iteration"]
    assert len(played) == ITERATIONS
    assert all(math.isclose(each.rate_hz, search.holds_hz) for each in played)
    (requirement,) = done.result()["verdict"]["requirements"]
    assert requirement["at_hz"] == search.holds_hz
    assert requirement["n"] > 0
