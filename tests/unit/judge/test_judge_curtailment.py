"""A rate ends early only where no rest of the run could change its failure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec.judge.curtailment import lost_requirements, with_rest
from r2bspec.judge.decision_policy import decision_policy
from r2bspec.judge.judge_samples import judge
from r2bspec.measure.run_samples import read_samples
from r2bspec.measure.samples import RunSamples
from run_simulation import Played, Simulation, objective

RATE = 30.0
MESSAGES = 100


def played(tmp_path: Path, late: list[int], *, lost: bool = False) -> RunSamples:
    """Iterations of 100 messages, of which so many are late, or lost, spread evenly."""
    segments = []
    for count in late:
        values = np.full(MESSAGES, 0.01) + np.arange(MESSAGES) * 1e-6
        if count:
            values[:: MESSAGES // count][:count] = np.nan if lost else 0.2
        segments.append(Played(RATE, values))
    written = Simulation(segments=segments, objectives={}).write(tmp_path / "run")
    return read_samples(written)


def lost(samples: RunSamples, *texts: str, declared: int) -> list[str]:
    objectives = {"fast": objective(*texts)}
    policy = decision_policy(Simulation(segments=[]).plan())
    found = lost_requirements(objectives, samples, policy, {RATE: (1,) * declared})
    return [one.text for one in found]


@pytest.mark.parametrize(
    ("late", "declared", "ended"),
    [
        # 40 of 100 late: 10 % of all 1,000 are 100, which the rest could still keep to.
        ([40], 10, False),
        # 90 and more of 300: the share of the first ones exceeds 10 % of all 500. But a fast rest
        # would show that iterations differ, and leave the verdict open.
        ([90, 90], 5, False),
        ([30] * 9, 10, True),
        ([50, 50], 2, True),
        # None was ever fast enough.
        ([100], 5, True),
        ([0, 0], 5, False),
        # 25 % so far fails, and 5 % of all do not.
        ([25, 25], 10, False),
    ],
)
def test_a_percentile_is_lost_when_the_late_messages_exceed_all_that_is_allowed(
    tmp_path: Path, late: list[int], declared: int, ended: bool
) -> None:
    samples = played(tmp_path, late)
    assert bool(lost(samples, "latency.p90 < 100 ms", declared=declared)) is ended


def test_losses_and_observations_are_lost_for_good(tmp_path: Path) -> None:
    samples = played(tmp_path, [1], lost=True)
    texts = ("missed == 0", "latency.max < 300 ms", "drop_rate <= 50 %", "throughput.mean > 99 Hz")
    # The maximum is infinite with a loss; a mean is never curtailed.
    assert lost(samples, *texts, declared=10) == ["missed == 0", "latency.max < 300 ms"]


def test_whatever_the_rest_is_the_verdict_stays(tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    policy = decision_policy(Simulation(segments=[]).plan())
    objectives = {"fast": objective("latency.p90 < 100 ms")}
    ended = 0
    for number in range(25):
        share = generator.uniform(0.1, 0.6)
        declared = int(generator.integers(5, 11))
        counts = [int(each) for each in generator.binomial(MESSAGES, share, declared)]
        # Good, bad and mixed rests alike.
        rests = {
            "same": counts,
            "better": [int(each) for each in generator.binomial(MESSAGES, share / 10, declared)],
            "ideal": [0] * declared,
            "slow": [MESSAGES] * declared,
            "mixed": [int(each) for each in generator.integers(0, 2, declared) * MESSAGES],
        }
        for length in range(1, declared):
            place = tmp_path / f"{number}-{length}"
            samples = played(place, counts[:length])
            if not lost(samples, "latency.p90 < 100 ms", declared=declared):
                continue
            ended += 1
            for name, rest in rests.items():
                whole = played(place / name, counts[:length] + rest[length:])
                (one,) = judge(objectives, whole, policy).requirements
                assert one.outcome == "fail", (number, length, name)
            break
    assert ended >= 10


def test_a_rest_that_is_far_worse_can_leave_a_failure_open(tmp_path: Path) -> None:
    policy = decision_policy(Simulation(segments=[]).plan())
    objectives = {"fast": objective("latency.p99 < 100 ms")}
    few = [5] * 9
    outcomes = [
        judge(objectives, played(tmp_path / str(last), [*few, *last]), policy)
        .requirements[0]
        .outcome
        for last in ([], [0], [MESSAGES])
    ]
    assert outcomes == ["fail", "fail", "inconclusive"]
    samples = played(tmp_path / "few", few)
    assert lost(samples, "latency.p99 < 100 ms", declared=10) == []


def test_the_rest_is_played_in_the_starts_of_the_plan(tmp_path: Path) -> None:
    samples = played(tmp_path, [50, 40])
    whole = with_rest(samples, {RATE: (1, 1, 2, 2, 3)}, ("slow", "lost"))
    rest = whole.iterations[RATE][2:]
    assert [one.segment.start for one in rest] == [2, 2, 3]
    assert len({one.segment.id for one in whole.iterations[RATE]}) == 5
    seen = [one.monitors["detections"] for one in rest]
    assert [one.missed for one in seen] == [0, MESSAGES, 0]
    assert [one.steps.answered.sum() for one in seen] == [MESSAGES, 0, MESSAGES]
    assert [float(one.times["latency"].max()) for one in (seen[0], seen[2])] == pytest.approx(
        [0.2, 0.01], abs=1e-4
    )


def test_the_ideal_rest_has_every_output_and_adds_nothing_where_all_was_played(
    tmp_path: Path,
) -> None:
    samples = played(tmp_path, [30, 10], lost=True)
    ideal = with_rest(samples, {RATE: (1,) * 5}, ())
    assert [one.monitors["detections"].missed for one in ideal.iterations[RATE]] == [
        *(30, 10),
        *(0, 0, 0),
    ]
    assert with_rest(samples, {RATE: (1,) * 2}, ()) == replace(samples)
    assert msgspec.structs.asdict(ideal.record) == msgspec.structs.asdict(samples.record)


def test_the_first_of_several_starts_ends_only_what_was_observed(tmp_path: Path) -> None:
    samples = played(tmp_path, [MESSAGES] * 4)
    objectives = {"fast": objective("latency.p90 < 100 ms", "latency.max < 100 ms")}
    policy = decision_policy(Simulation(segments=[]).plan())

    def ended(starts: tuple[int, ...]) -> list[str]:
        first = samples.iterations[RATE][: len(starts)]
        made = tuple(
            replace(one, segment=msgspec.structs.replace(one.segment, start=start))
            for one, start in zip(first, starts, strict=True)
        )
        declared = {RATE: (1, 1, 2, 2, 3, 3)}
        so_far = replace(samples, iterations={RATE: made})
        return [one.text for one in lost_requirements(objectives, so_far, policy, declared)]

    assert ended((1, 1)) == ["latency.max < 100 ms"]
    assert ended((1, 1, 2)) == ["latency.p90 < 100 ms", "latency.max < 100 ms"]


def test_where_no_output_was_ever_in_time_mixtures_do_not_count(tmp_path: Path) -> None:
    values = np.random.default_rng(2).lognormal(np.log(0.005), 0.5, 100)
    written = Simulation(segments=[Played(RATE, values)], objectives={}).write(tmp_path / "run")
    assert lost(read_samples(written), "latency.p90 < 1 us", declared=5) == ["latency.p90 < 1 us"]
