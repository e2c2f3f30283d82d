"""How many starts a run has, and which iterations each of them plays."""

from __future__ import annotations

import pytest

from example_spec import example
from r2bspec.check.rules.benchmark import iterations_per_start, starts_of_external_nodes
from r2bspec.language.load_spec import load_spec
from r2bspec.language.spec import Spec
from r2bspec.plan.comparability import load_differences, single_run_plan
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.interim_looks import iterations_of_starts


def spec(**sections: str) -> Spec:
    loaded = load_spec(example(**sections), file="example.r2b.yaml")
    assert loaded.spec is not None, loaded.diagnostics
    return loaded.spec


@pytest.mark.parametrize(
    ("benchmark", "starts"),
    [
        ("{rates: [30 Hz]}", 5),
        ("{rates: [30 Hz], iterations: 1}", 1),
        ("{rates: [30 Hz], iterations: 3}", 1),
        ("{rates: [30 Hz], iterations: 4}", 2),
        ("{rates: [30 Hz], iterations: 7}", 3),
        ("{rates: [30 Hz], iterations: 10}", 5),
        ("{rates: [30 Hz], iterations: 100}", 5),
        ("{rates: [30 Hz], iterations: 100, starts: 20}", 20),
        ("{rates: [30 Hz], iterations: 3, starts: 1}", 1),
        ("{rates: [30 Hz], iterations: 2, max_iterations: 20}", 1),
        ("{search: {min: 5 Hz, max: 50 Hz}}", 1),
    ],
)
def test_each_start_has_at_least_two_iterations(benchmark: str, starts: int) -> None:
    assert compile_plan(spec(benchmark=benchmark), None).starts == starts


def test_the_default_plays_for_as_long_as_before_there_were_starts() -> None:
    (play,) = compile_plan(spec(), None).play
    assert play.iterations * play.duration_ns == 25 * 10**9


def test_external_nodes_have_one_start() -> None:
    page = starts_of_external_nodes.page
    for written in (page.failing, page.passing):
        loaded = load_spec(written, file="example.r2b.yaml")
        assert loaded.spec is not None
        assert compile_plan(loaded.spec, None).starts == 1


def test_too_many_starts_are_an_error_with_both_ways_out() -> None:
    from r2bspec.check import check

    for iterations, ways in ((4, "set 'starts' to 2, or 'iterations' to 10"), (1, "set 'itera")):
        benchmark = f"{{iterations: {iterations}, starts: 5, rates: [30 Hz]}}"
        loaded = load_spec(example(benchmark=benchmark), file="example.r2b.yaml")
        (found,) = [
            each for each in check(loaded, offline=True) if each.code == iterations_per_start.code
        ]
        assert ways in found.help
        assert "'starts: 1'" in found.help


def test_a_run_of_a_pair_has_one_start() -> None:
    plan = compile_plan(spec(), None)
    assert plan.starts == 5
    assert single_run_plan(plan).starts == 1


def test_the_number_of_starts_is_part_of_how_is_measured() -> None:
    one = compile_plan(spec(benchmark="{rates: [30 Hz], starts: 1}"), None)
    (found,) = load_differences(one, compile_plan(spec(), None))
    assert str(found) == "starts: 1 -> 5"


def lengths(groups: tuple[range, ...]) -> list[int]:
    return [len(group) for group in groups]


@pytest.mark.parametrize("starts", [1, 2, 3, 5, 7])
def test_starts_share_the_iterations_evenly(starts: int) -> None:
    for iterations in range(1, 30):
        groups = iterations_of_starts(iterations, starts)
        assert [index for group in groups for index in group] == list(range(1, iterations + 1))
        assert max(lengths(groups)) - min(lengths(groups)) <= 1
        assert len(groups) == min(starts, iterations)


@pytest.mark.parametrize(
    ("iterations", "starts", "most", "expected"),
    [
        (10, 5, 0, [2, 2, 2, 2, 2]),
        (10, 5, 25, [2, 2, 2, 2, 2, 3, 2, 2, 2, 2, 2, 2]),
        (7, 3, 14, [3, 2, 2, 3, 2, 2]),
        (10, 5, 11, [2, 2, 2, 2, 2, 1]),
        (5, 1, 20, [20]),
    ],
)
def test_what_comes_on_top_is_played_in_further_starts(
    iterations: int, starts: int, most: int, expected: list[int]
) -> None:
    groups = iterations_of_starts(iterations, starts, most)
    assert lengths(groups) == expected
    played = [index for group in groups for index in group]
    assert played == list(range(1, max(iterations, most) + 1))
