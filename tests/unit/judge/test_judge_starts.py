"""Starts as the highest level of a run, and what a verdict says it cannot know."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.measure.host_usage import HostInterference
from r2bspec.judge.measure.samples import RunSamples, SegmentSamples
from r2bspec.judge.pipeline import judge
from r2bspec.judge.statistics.effective_sample_size import BadFlags, SampleDesign, effective_sample
from r2bspec.judge.statistics.percentile_interval import level_margin
from r2bspec.judge.statistics.t_interval import hierarchical_interval
from r2bspec.judge.verdict import RequirementVerdict, Verdict
from run_simulation import Played, Simulation, objective, with_interference, with_starts

STARTS = (1, 1, 2, 2, 3, 3, 4, 4, 5, 5)
NAN = float("nan")


def run(*segments: Played, starts: tuple[int, ...] = ()) -> RunSamples:
    samples = Simulation(segments=segments).samples()
    return with_starts(samples, starts or (1,) * len(segments))


def verdict(samples: RunSamples, *requirements: str) -> Verdict:
    return judge({"slo": objective(*requirements)}, samples)


def one(samples: RunSamples, requirement: str) -> RequirementVerdict:
    return verdict(samples, requirement).requirements[0]


def flags(*bad: int, n: int = 100) -> list[BadFlags]:
    """Iterations with so many bad messages each, far apart."""
    found = []
    for number in bad:
        piece = np.zeros(n, dtype=bool)
        piece[np.linspace(0, n - 1, number).astype(int) if number else []] = True
        found.append(piece)
    return found


class TestShares:
    BAD = (2, 2, 9, 9, 2, 2, 9, 9, 2, 2)

    def test_what_starts_share_counts_once(self) -> None:
        alone, shared, agreeing = (
            effective_sample(flags(*bad), SampleDesign(starts, serial=False))
            for bad, starts in (
                (self.BAD, ()),
                (self.BAD, STARTS),
                ((1, 9, 9, 1, 1, 9, 9, 1, 1, 9), STARTS),
            )
        )
        assert (shared.cause, agreeing.cause) == ("starts", "iterations")
        assert shared.inflation > 1.5 * alone.inflation

    def test_two_pieces_pay_by_their_t_quantile(self) -> None:
        found = effective_sample(flags(2, 10), SampleDesign(serial=False))
        p = 12 / 200
        scatter = (100 * (0.02 - p) ** 2 + 100 * (0.1 - p) ** 2) / (p * (1 - p))
        factor = (stats.t.ppf(0.95, 1) / stats.norm.ppf(0.95)) ** 2
        assert found.inflation == pytest.approx(scatter * factor, rel=1e-5)

    def test_a_run_of_the_better_ones_does_not_look_uniform(self) -> None:
        seen = effective_sample(flags(0, 0, 6, 0, 0), SampleDesign(serial=False))
        asked = effective_sample(flags(0, 0, 6, 0, 0), SampleDesign(allowed=0.1, serial=False))
        worse = effective_sample(flags(0, 0, 6, 0, 0), SampleDesign(allowed=0.001, serial=False))
        assert asked.inflation > 2 * seen.inflation
        assert worse.inflation == seen.inflation


class TestMeans:
    def test_it_is_t_over_the_starts(self) -> None:
        values = [1.0, 1.1, 5.0, 5.1, 2.0, 2.1, 4.0, 4.1, 3.0, 3.1]
        found = hierarchical_interval(values, STARTS, 0.95)
        means = np.reshape(values, (5, 2)).mean(axis=1)
        assert (found.pieces, found.number) == ("starts", 5)
        plain = stats.t.ppf(0.95, 4) * means.std(ddof=1) / math.sqrt(5)
        assert found.interval.upper - found.interval.mean >= plain - 1e-9

    def test_starts_that_agree_by_chance_do_not_help(self) -> None:
        values = [1.0, 3.0] * 5
        found = hierarchical_interval(values, STARTS, 0.95)
        assert (found.pieces, found.number) == ("iterations", 10)
        assert found.interval.upper > 2.5

    def test_the_reason_counts_starts(self) -> None:
        segments = [
            Played(30, np.full(60, 0.02 + 0.001 * start + 0.0001 * (at % 2)))
            for at, start in enumerate(STARTS)
        ]
        samples = run(*segments, starts=STARTS)
        assert "10 iterations in 5 starts" in one(samples, "latency.mean < 50 ms").reason

    def test_no_latency_is_below_nothing(self) -> None:
        levels = (0.001, 0.001, 0.002, 0.002, 0.03, 0.03, 0.001, 0.001, 0.002, 0.002)
        segments = [Played(30, np.full(60, level)) for level in levels]
        found = one(run(*segments, starts=STARTS), "latency.mean < 10 ms")
        assert (found.outcome, found.lower) == ("inconclusive", 0)
        assert "the true mean is 0 s to" in found.reason
        # What is known of the mean is as little as before.
        assert found.budget is not None
        assert found.upper is not None
        assert found.estimate is not None
        assert found.budget.half_width == pytest.approx(found.upper - found.estimate)


class TestLevels:
    def test_what_moves_the_whole_iteration_leaves_its_percentile_open(self) -> None:
        random = np.random.default_rng(1)
        same = [random.normal(1, 0.1, 300) for _ in range(10)]
        moved = [piece + 0.1 * (number % 3) for number, piece in enumerate(same)]
        narrow, wide = (level_margin(one, (), 0.99, 0.95) for one in (same, moved))
        assert narrow is not None
        assert wide is not None
        assert narrow.half < 0.02
        assert wide.half > 0.04
        assert wide.deviation == pytest.approx(np.std([0, 0.1, 0.2] * 3 + [0], ddof=1), rel=0.1)

    def test_without_levels_there_is_no_margin(self) -> None:
        assert level_margin([np.ones(10)], (), 0.5, 0.95) is None
        assert level_margin([], (), 0.5, 0.95) is None
        lost = [np.full(10, np.inf), np.ones(10)]
        assert level_margin(lost, (), 0.5, 0.95) is None

    def test_the_verdict_says_what_leaves_it_open(self) -> None:
        # Each start is uniform, and no message of any is over the limit; but they differ.
        level_s = {start: 0.01 + 0.008 * place for start, place in enumerate((3, 1, 5, 2, 4), 1)}
        segments = [Played(30, np.full(300, level_s[start])) for start in STARTS]
        found = one(run(*segments, starts=STARTS), "latency.p99 < 52 ms")
        assert (found.outcome, found.over) == ("inconclusive", 0)
        assert "the 5 starts differ by 12.6 ms" in found.reason
        assert "starts with" in found.remedy or "too close" in found.remedy
        assert one(run(*segments, starts=STARTS), "latency.p99 < 1 s").outcome == ("pass")


STARTS_DIFFER = (
    "The 5 starts differ by 1.6 ms in latency (standard deviation, up to 3.8 ms at 95 % "
    "confidence; their messages by 0 s), and that none was lost does not show whether slower ones "
    "lose more. More starts would show it."
)


class TestWhatItSays:
    def test_of_how_many_starts(self) -> None:
        segments = [Played(30, np.full(60, 0.02)) for _ in STARTS]
        several = verdict(run(*segments, starts=STARTS), "latency.p50 < 50 ms")
        single = verdict(run(*segments), "latency.p50 < 50 ms")
        assert (several.starts, single.starts) == (5, 1)
        assert several.unseen_starts == pytest.approx(1 - 0.05 ** (1 / 5))
        assert single.unseen_starts == pytest.approx(0.95)

    def test_the_rate_with_the_fewest_starts_counts(self) -> None:
        samples = run(*(Played(30, np.full(60, 0.02)) for _ in STARTS), starts=STARTS)
        more = {**samples.iterations, 60.0: samples.iterations[30.0][:4]}
        assert replace(samples, iterations=more).starts == 2
        assert replace(samples, iterations={}).starts == 1

    def test_bursts_it_may_have_missed(self) -> None:
        clean = [Played(30, np.full(1500, 0.02)) for _ in range(2)]
        samples = run(*clean)
        found = verdict(samples, "latency.p99 < 60 ms")
        assert found.outcome == "pass"
        assert not found.requirements[0].notes
        (clean_text,) = found.limits[1:]
        assert clean_text == (
            "latency.p99 < 60 ms passed without a burst beyond the limit; it allows bursts of up "
            "to 5.5 messages on average."
        )
        both = verdict(samples, "latency.p99 < 60 ms", "latency.p98 < 60 ms", "drop_rate <= 2 %")
        assert both.limits[1].startswith("3 requirements passed without a burst")
        assert "latency.p99 < 60 ms allows the shortest" in both.limits[1]
        longer = [Played(30, np.full(6000, 0.02)) for _ in range(2)]
        assert not verdict(run(*longer), "latency.p99 < 60 ms").limits[1:]

    def test_some_bursts_are_told_where_they_matter(self) -> None:
        late = np.full(1500, 0.02)
        late[100:103] = late[700:704] = 0.1
        found = one(run(Played(30, late), Played(30, late)), "latency.p98 < 60 ms")
        assert found.outcome == "pass"
        assert "The run met 4 bursts of messages beyond the limit" in found.notes[0]

    def test_a_pass_that_strict_refuses_does_not_say_what_it_allows(self) -> None:
        late = np.full(1500, 0.02)
        late[100:103] = 0.1
        samples = run(Played(30, late), Played(30, late))
        busy = HostInterference(seconds=50.0, cores=2, foreign_cores=1.9)
        refused = judge(
            {"slo": objective("latency.p98 < 60 ms")},
            with_interference(samples, busy),
            DecisionPolicy(interference="strict"),
        )
        (found,) = refused.requirements
        assert found.outcome == "inconclusive"
        assert not any("The PASS" in note for note in found.notes)
        assert len(refused.limits) == 1

    def test_bursts_that_are_short_for_certain_are_not_told(self) -> None:
        late = np.full(1500, 0.02)
        late[[100, 700]] = 0.1
        found = one(run(Played(30, late), Played(30, late)), "latency.p99 < 60 ms")
        assert (found.outcome, found.bursts, found.notes) == ("pass", 4, ())

    def test_when_and_where_it_was_played(self) -> None:
        segments = [Played(30, np.full(600, 0.02)) for _ in STARTS]
        (limit,) = verdict(run(*segments, starts=STARTS), "latency.p50 < 60 ms").limits
        # What is true of every run is in the documentation.
        assert limit == (
            "Played on a simulated processor between 2026-01-01 00:00 and 00:01 UTC, in 5 starts."
        )

    @pytest.mark.parametrize(
        ("near", "far", "half", "whole", "advice"),
        [
            # 100 s, and 2 ms to spare: 3 S^2 / (2 T) = 2 ms.
            ("latency.mean < 22.5 ms", "latency.mean < 60 ms", 183, 365, "270 s, or require a p"),
            ("throughput.mean >= 29.7 Hz", "throughput.mean >= 28.5 Hz", 167, 333, "180 s, or re"),
        ],
    )
    def test_what_depends_on_stalls_that_it_may_have_missed_says_so(
        self, near: str, far: str, half: int, whole: int, advice: str
    ) -> None:
        steady = 0.02 + np.linspace(0, 0.001, 300)
        samples = run(*(Played(30, steady) for _ in STARTS), starts=STARTS)
        close, clear = verdict(samples, near, far).requirements
        assert close.outcome == clear.outcome == "pass"
        (note,) = close.notes
        assert note.startswith(
            f"The run met no stall of {half} ms or longer in 100 s. Stalls of {whole} ms every "
            "33.3 s would break the limit, and 5 % of such runs meet none of them: play "
            f"{advice}"
        )
        assert not clear.notes

    def test_stalls_that_it_has_met_are_counted(self) -> None:
        steady = 0.02 + np.linspace(0, 0.001, 300)
        stalled = steady.copy()
        stalled[100:109] += 0.3 - np.arange(9) / 30
        asked = "latency.mean < 26 ms"
        notes = one(run(*[Played(30, stalled)] * 2, *[Played(30, steady)] * 8), asked).notes
        assert notes[-2].startswith("The run met 2 stalls of 79.7 ms or longer")
        many = one(run(*[Played(30, stalled)] * 10), asked).notes
        assert not any("stall" in note for note in many)

    def test_no_drop_rate_is_proposed_where_there_is_none(self) -> None:
        def paced(each: SegmentSamples) -> SegmentSamples:
            monitors = {name: replace(seen, own_pace=True) for name, seen in each.monitors.items()}
            return replace(each, monitors=monitors)

        samples = run(*(Played(30, np.full(300, 0.02)) for _ in STARTS), starts=STARTS)
        (note,) = one(samples.with_each(paced), "throughput.mean >= 29.7 Hz").notes
        assert note.endswith("5 % of such runs meet none of them: play 180 s.")
        unknown = one(samples.with_each(paced), "drop_rate <= 1 %")
        assert unknown.outcome == "inconclusive"
        assert "its outputs answer no input" in unknown.reason

    @pytest.mark.parametrize(
        ("scatter", "said"),
        [
            (0.0, STARTS_DIFFER),
            (0.001, "More starts would show it."),
            (0.0045, "About 6 starts would show it."),
            (0.006, ""),
        ],
    )
    def test_starts_that_differ_may_lose_more_than_few_losses_show(
        self, scatter: float, said: str
    ) -> None:
        around = scatter * np.random.default_rng(1).standard_normal(300)
        differ = [Played(30, 0.02 + 0.001 * start + around) for start in STARTS]
        notes = one(run(*differ, starts=STARTS), "drop_rate <= 1 %").notes
        assert bool(notes) == bool(said)
        assert all(note.endswith(said) for note in notes)
        alike = [Played(30, np.full(300, 0.02)) for _ in STARTS]
        assert not one(run(*alike, starts=STARTS), "drop_rate <= 1 %").notes

    @pytest.mark.parametrize(
        ("asked", "note"),
        [
            ("latency.p90 < 21 ms", "met by at least 4.5 %. 16 starts would have room."),
            ("latency.mean < 20.8 ms", "met by at least 3.7 %. 8 starts would have room."),
            ("latency.p50 < 21 ms", "another hour on this machine may be slower by as much."),
            ("latency.p50 < 21.4 ms", "another hour on this machine may be slower by as much."),
            ("latency.p50 < 21.6 ms", ""),
            ("latency.mean < 20.005 ms", "another hour on this machine may be faster by as much."),
            ("latency.mean < 25 ms", ""),
            ("latency.p50 < 26 ms", ""),
            ("latency.p50 < 18 ms", ""),
            ("latency.mean > 20 ms", ""),
            ("throughput.mean >= 97 % of offered", ""),
            ("latency.mean < 20.8 ms in 90 % of 1 s windows", ""),
        ],
    )
    def test_a_latency_that_is_close_to_its_limit(self, asked: str, note: str) -> None:
        scattered = 0.02 + np.linspace(0, 0.0001, 300)
        samples = run(*[Played(30, scattered)] * len(STARTS), starts=STARTS)
        found = one(samples, asked)
        assert found.outcome == ("fail" if {"20.005", "18"} & {*asked.split()} else "pass")
        notes = [text for text in found.notes if "stall" not in text]
        assert len(notes) == bool(note)
        assert all(text.endswith(note) for text in notes)

    @pytest.mark.parametrize(
        ("lost_of_300", "allowed", "note"),
        [
            (1, "0.6 %", "met by a factor of 1.8, and at another hour eight times as many outputs"),
            (6, "1 %", "missed by a factor of 2, and at another hour an eighth as many outputs"),
            (1, "2 %", "met by a factor of 6, and at another hour eight times as many outputs"),
            (1, "3 %", ""),
            (30, "1 %", ""),
            (0, "1 %", ""),
        ],
    )
    def test_losses_that_are_close_to_their_limit(
        self, lost_of_300: int, allowed: str, note: str
    ) -> None:
        seconds = np.full(3000, 0.02)
        seconds[np.linspace(50, 2950, 10 * lost_of_300).astype(int)] = NAN
        found = one(
            run(*[Played(30, seconds)] * len(STARTS), starts=STARTS), f"drop_rate <= {allowed}"
        )
        assert found.outcome == ("fail" if lost_of_300 > 3 else "pass")
        notes = [text for text in found.notes if "factor" in text]
        assert len(notes) == bool(note)
        assert all(note in text for text in notes)

    def test_one_iteration_is_no_sample_of_iterations(self) -> None:
        found = one(run(Played(30, np.full(600, 0.02))), "latency.p50 < 60 ms")
        assert found.notes == ("One iteration does not show by how much iterations differ.",)

    def test_iterations_that_climb_are_too_few_to_be_sure(self) -> None:
        segments = [Played(30, np.full(300, 0.02 + 0.001 * at)) for at in range(10)]
        found = one(run(*segments), "latency.p50 < 60 ms")
        assert found.outcome == "pass"
        assert any("resemble each other" in note for note in found.notes)

    def test_zero_of_one_message_is_settled_by_299(self) -> None:
        found = one(run(Played(30, np.array([0.02]))), "latency.p99 < 60 ms")
        assert found.outcome == "inconclusive"
        assert "would decide it" in found.remedy
        assert "too close" not in found.remedy


@pytest.mark.parametrize(
    ("lost", "asked", "outcome", "words"),
    [
        (150, "latency.mean < 50 ms", "inconclusive", "900 of 1,800 outputs (50 %)"),
        (2, "latency.mean < 50 ms", "pass", "leaves out 12 of 1,800 outputs"),
        (150, "latency.mean < 5 ms", "fail", "900 of 1,800"),
        (0, "latency.mean < 50 ms", "pass", ""),
        (
            30,
            "latency.mean < 50 ms in 90 % of 1 s windows",
            "inconclusive",
            "60 of 60 windows of 1 s lost more than 1 % of their outputs",
        ),
        (1, "latency.mean < 50 ms in 80 % of 1 s windows", "pass", "6 of 60 windows"),
        (30, "latency.mean < 5 ms in 90 % of 1 s windows", "fail", ""),
    ],
)
def test_a_mean_of_what_was_not_lost(lost: int, asked: str, outcome: str, words: str) -> None:
    """A node that drops half of its outputs does not pass on the rest; a failure stays one."""
    values = 0.02 + np.linspace(0, 0.001, 300)
    values[np.linspace(5, 295, lost).astype(int)] = NAN
    found = one(run(*(Played(30, values) for _ in range(6))), asked)
    assert found.outcome == outcome
    assert words in " ".join((found.reason, *found.notes))
    assert ("drop_rate" in found.remedy) == (outcome == "inconclusive")
    assert words or not found.notes
