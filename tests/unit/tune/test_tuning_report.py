"""What a report of a search says, and that nothing in a result does harm where it is shown."""

from __future__ import annotations

import math

from msgspec.structs import replace

import tuning_results
from r2bspec.tune import tuning_texts as wording
from tuning_results import deployment, gain, improved, margin, not_met, to_text, trial


def test_the_outcome_comes_first() -> None:
    for result in (improved(), not_met()):
        said = f"robot: {result.reason}"
        assert to_text(result, 400).startswith(f"{said}\n")
        assert wording.headline(result) == said


def test_the_claim_is_of_the_pairs_and_not_of_the_search() -> None:
    result = improved(unproven=0.1)
    assert wording.seen_and_proven(result) == (
        "The search saw 10 % for it and 120 % for today's (-92 %), once each and chosen for being "
        "low; the pairs say -28 % (-31 to -25 %), 8 pairs."
    )
    assert wording.seen_and_proven(improved(proof=None)) == ""


def test_the_best_trials_are_first() -> None:
    assert [row.number for row in wording.trial_rows(improved())] == list("4102536")


def test_a_trial_says_which_requirement_leaves_it_open() -> None:
    passed = margin(-0.01)
    undecided = replace(margin(-0.5, text="out.latency.p50 < 50 ms"), outcome="inconclusive")
    waiting = trial(0, deployment(), 1.0, 0, state="open", starts=1, margins=(passed, undecided))
    assert wording.trial_line(waiting, improved()).endswith(
        "(out.latency.p50 < 50 ms: 30.3 ms, 39 % inside, not decided by 1 start)"
    )
    late = margin(0.01, text="slow.latency.p99 < 50 ms")
    missed = trial(0, deployment(), 1.0, 0, state="misses", margins=(passed, undecided, late))
    assert wording.trial_line(missed, improved()).endswith(
        "(slow.latency.p99 < 50 ms: 50.5 ms, 1.0 % beyond)"
    )


def test_gains_that_were_not_measured() -> None:
    missing = gain("", None)
    assert wording.claim_text(missing) == "not measured, 8 pairs"
    assert wording.gain_rows([missing])[0][2:5] == ("-", "-", "no interval")
    endless = gain("", 1.5, lower=1.1, upper=math.inf, pairs=1)
    assert wording.claim_text(endless) == "+50 % (+10 to ∞ %), 1 pair"


def test_an_interval_of_another_confidence_says_so() -> None:
    assert wording.interval_text(gain("", 0.72, confidence=0.975)) == "-31 to -25 % at 97.5 %"
    assert wording.interval_text(gain("", 0.72)) == "-31 to -25 %"


def test_a_winner_that_was_judged_alone_has_its_requirements() -> None:
    text = to_text(improved(outcome="meets", proof=None))
    assert "by its own runs" in text
    assert "✔ latency.p99 < 50 ms: 37 ms, 26 % inside" in text
    assert "by its own runs" not in to_text(improved())


def test_hostile_texts_are_shown_and_do_nothing() -> None:
    result = tuning_results.hostile()
    text = to_text(result)
    assert not any(line.startswith("::") for line in text.splitlines())
    assert "\x1b" not in text
    assert "\u202e" not in text
    assert "[bold]" in text


def test_intervals_are_called_by_the_confidence_that_they_have() -> None:
    one, other = gain("a", 0.9, confidence=0.965), gain("b", 0.8)
    unknown = gain("c", None, confidence=0.5)
    same = improved(proof=one, levers=(one,), dropped=(unknown,))
    assert wording.gain_header(same)[4] == "96.5 % interval"
    assert wording.gain_header(improved(proof=one, levers=(other,), dropped=()))[4] == "interval"
