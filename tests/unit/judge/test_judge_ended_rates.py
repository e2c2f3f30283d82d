"""A rate ends when no rest can make a requirement pass; its FAIL is one that no rest changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from r2bspec.judge.decision_policy import DecisionPolicy, decision_policy
from r2bspec.judge.ended_rates import unreachable_requirements, weaken_ended
from r2bspec.judge.judge_samples import judge
from r2bspec.measure.run_samples import read_samples
from r2bspec.measure.samples import RunSamples
from r2bspec.record.run_record import EndedRate
from run_simulation import Played, Simulation, objective

RATE = 30.0
MESSAGES = 100
P90, P99 = "latency.p90 < 100 ms", "latency.p99 < 100 ms"
STARTS = (1, 1, 2, 2, 3, 3, 4, 4, 5, 5)


def played(
    folder: Path, late: Sequence[int], starts: Sequence[int] | None = None, *, lost: bool = False
) -> RunSamples:
    """Iterations of 100 messages, of which so many are late, or lost, spread evenly."""
    segments = []
    for count in late:
        values = np.full(MESSAGES, 0.01) + np.arange(MESSAGES) * 1e-6
        if count:
            values[:: MESSAGES // count][:count] = np.nan if lost else 0.2
        segments.append(Played(RATE, values))
    samples = read_samples(Simulation(segments=segments, objectives={}).write(folder))
    if starts is None:
        return samples
    made = tuple(
        replace(one, segment=msgspec.structs.replace(one.segment, start=start))
        for one, start in zip(samples.iterations[RATE], starts, strict=False)
    )
    return replace(samples, iterations={RATE: made})


def policy(declared: Sequence[int] = (1,) * 10, **changes: object) -> DecisionPolicy:
    plain = decision_policy(Simulation(segments=[]).plan())
    return replace(plain, declared={RATE: tuple(declared)}, **changes)  # type: ignore[arg-type]


def unreachable(samples: RunSamples, *texts: str, declared: Sequence[int] = (1,) * 10) -> list[str]:
    found = unreachable_requirements({"fast": objective(*texts)}, samples, policy(declared))
    return [one.text for one in found]


@pytest.mark.parametrize(
    ("late", "text", "ended"),
    [
        # 10 % of all 1,000 are 100.
        ([20], P90, False),
        ([40, 40, 40], P90, True),
        # Not a FAIL yet, but too many for a PASS: 1 % of all are 10.
        ([4, 4, 4], P99, True),
        ([1], P99, False),
        # The others could have few enough late messages, but not show that no other is like this.
        ([40], P90, True),
        ([0] * 9, P99, False),
        ([MESSAGES], P90, True),
    ],
)
def test_a_rate_ends_when_more_messages_are_late_than_a_pass_allows(
    tmp_path: Path, late: list[int], text: str, ended: bool
) -> None:
    assert bool(unreachable(played(tmp_path / "run", late), text)) is ended


def test_losses_end_a_rate_and_means_do_not(tmp_path: Path) -> None:
    samples = played(tmp_path / "run", [1], lost=True)
    texts = ("missed == 0", "latency.max < 300 ms", "drop_rate <= 50 %", "throughput.mean > 99 Hz")
    assert unreachable(samples, *texts) == ["missed == 0", "latency.max < 300 ms"]


def test_the_first_of_several_starts_can_end_a_rate(tmp_path: Path) -> None:
    slow = played(tmp_path / "slow", [MESSAGES, MESSAGES], STARTS)
    assert unreachable(slow, P90, declared=STARTS) == [P90]
    # A rate of which one iteration in five may be slow goes on.
    assert unreachable(played(tmp_path / "some", [3], STARTS), P90, declared=STARTS) == []


def test_a_lower_limit_of_a_time_is_met_by_slow_messages(tmp_path: Path) -> None:
    samples = played(tmp_path / "run", [0])
    assert unreachable(samples, "latency.p50 > 50 ms") == []
    assert unreachable(played(tmp_path / "most", [0] * 9), "latency.p50 > 50 ms") == [
        "latency.p50 > 50 ms"
    ]


def test_where_open_counts_as_passed_only_a_certain_failure_ends_a_rate(tmp_path: Path) -> None:
    samples = played(tmp_path / "run", [90, 90])
    asked = {"fast": objective(P90)}
    lenient = policy((1,) * 5, inconclusive="pass")
    assert [*unreachable_requirements(asked, samples, lenient)] == []
    assert [one.text for one in unreachable_requirements(asked, samples, policy((1,) * 5))] == [P90]


@pytest.mark.parametrize("starts", [(1,) * 10, STARTS], ids=["one start", "five starts"])
def test_whatever_the_rest_is_it_does_not_pass(tmp_path: Path, starts: tuple[int, ...]) -> None:
    generator = np.random.default_rng(5)
    asked = {"fast": objective(P90)}
    ended = 0
    for number in range(8):
        share = generator.uniform(0.05, 0.5)
        counts = [int(each) for each in generator.binomial(MESSAGES, share, 10)]
        rests = {
            "same": counts,
            "better": [int(each) for each in generator.binomial(MESSAGES, share / 10, 10)],
            "ideal": [0] * 10,
            "slow": [MESSAGES] * 10,
            "mixed": [int(each) for each in generator.integers(0, 2, 10) * MESSAGES],
        }
        for length in range(1, 10):
            place = tmp_path / f"{number}-{length}"
            samples = played(place, counts[:length], starts)
            if not unreachable(samples, P90, declared=starts):
                continue
            ended += 1
            verdict = weaken_ended(
                judge(asked, cut_short(samples), policy(starts)),
                asked,
                cut_short(samples),
                policy(starts),
            )
            said = verdict.requirements[0].outcome
            assert said in {"fail", "inconclusive"}
            for name, rest in rests.items():
                whole = played(place / name, counts[:length] + rest[length:], starts)
                (one,) = judge(asked, whole, policy(starts)).requirements
                assert one.outcome != "pass", (number, length, name)
                # What is said of the part is what the whole says, or less.
                assert said == "inconclusive" or one.outcome == "fail", (number, length, name)
            break
    assert ended >= 4


def cut_short(samples: RunSamples) -> RunSamples:
    """The samples of a run whose record says that the rate was ended."""
    ended = (EndedRate(rate_hz=RATE, iterations=len(samples.iterations[RATE])),)
    return replace(samples, record=msgspec.structs.replace(samples.record, ended_rates=ended))


def test_a_failure_that_a_rest_could_leave_open_is_open(tmp_path: Path) -> None:
    asked = {"fast": objective(P90)}
    samples = cut_short(played(tmp_path / "run", [90, 90]))
    before = judge(asked, samples, policy())
    assert before.outcome == "fail"
    after = weaken_ended(before, asked, samples, policy())
    assert (after.outcome, after.exit_code) == ("inconclusive", 3)
    assert "no rest could have made it pass" in after.requirements[0].notes[-1]
    # Of a run that was played to its end, nothing is weakened.
    whole = played(tmp_path / "whole", [90, 90])
    assert weaken_ended(before, asked, whole, policy((1, 1))) == before


def test_a_failure_that_no_rest_changes_stays(tmp_path: Path) -> None:
    asked = {"fast": objective("missed == 0")}
    samples = cut_short(played(tmp_path / "run", [1], lost=True))
    verdict = judge(asked, samples, policy())
    assert weaken_ended(verdict, asked, samples, policy()) == verdict
    assert verdict.outcome == "fail"
