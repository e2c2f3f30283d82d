"""The stages of a search, on a machine whose every answer is given."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Literal

import pytest
from msgspec.structs import replace

from given_machine import GivenMachine, NoGain, changed, margin, played
from r2bspec.plan.tuning_space import Deployment, Lever, Setting, TuningSpace
from r2bspec.tune.machine import Measurement, Pairs, Start
from r2bspec.tune.race import finalists_of
from r2bspec.tune.search import Forecast, Predict, Search, SearchListener, SearchSettings
from r2bspec.tune.tuning_result import Trial, TuningResult

SPACE = TuningSpace(
    levers=tuple(
        Lever(
            name=name,
            settings=(Setting(text="today"), Setting(text="other", sets=(f"{name}=other",))),
        )
        for name in ("placement", "threads", "qos")
    )
)
SETTINGS = SearchSettings(trials=8, budget_s=10_000.0, pairs=5)
BLANK = TuningResult(
    name="relay",
    title="",
    goal="cpu.graph.mean",
    goal_unit="share",
    outcome="incomplete",
    reason="",
    space=SPACE,
    trials=(),
)


class Stored(SearchListener):
    """What a search has stored; it is interrupted when it has stored so many trials."""

    def __init__(self, trials: int | None = None) -> None:
        self._trials = trials
        self.results: list[TuningResult] = []

    def found(self, result: TuningResult) -> None:
        self.results.append(result)
        if len(result.trials) == self._trials:
            raise KeyboardInterrupt


def search(
    answer: Callable[[Deployment], Measurement],
    settings: SearchSettings = SETTINGS,
    listener: SearchListener | None = None,
    earlier: TuningResult | None = None,
) -> tuple[TuningResult, GivenMachine]:
    machine = GivenMachine(answer)
    return Search(BLANK, machine, settings, listener=listener, earlier=earlier).run(), machine


def test_the_cheapest_deployment_that_meets_the_limits_is_proved() -> None:
    def answer(deployment: Deployment) -> Measurement:
        levers = changed(deployment)
        # Threads save most, and break the limit.
        return played(
            1.0 - 0.2 * ("placement" in levers) - 0.5 * ("threads" in levers),
            0.5 if "threads" in levers else -0.5,
        )

    found, machine = search(answer)
    assert found.outcome == "improved"
    assert found.winner is not None
    assert changed(found.winner) == {"placement"}
    assert found.proof is not None
    assert found.proof.ratio == pytest.approx(0.8)
    assert [each.text for each in found.requirements] == ["latency.p99 < 50 ms"]
    assert machine.compared[-1] == (set(), {"placement"})


def test_a_lever_that_gives_nothing_is_dropped_from_the_winner() -> None:
    costs = {"placement": -0.2, "threads": -0.1, "qos": -1e-6}
    found, _ = search(
        lambda deployment: played(1.0 + sum(costs[lever] for lever in changed(deployment)))
    )
    assert found.winner is not None
    assert changed(found.winner) == {"placement", "threads"}
    assert [gain.lever for gain in found.dropped] == ["qos"]
    assert {gain.lever for gain in found.levers} == {"placement", "threads"}
    assert all(gain.is_shown for gain in found.levers)


@pytest.mark.parametrize("pairs_say", ["fail", "inconclusive"])
def test_a_lever_without_which_a_limit_breaks_is_kept(
    pairs_say: Literal["fail", "inconclusive"],
) -> None:
    """Also where pairs only measure that it does, and do not show it: it costs more with it."""

    def pairs_show(_base: Deployment, _head: Deployment, seen: Pairs) -> Pairs:
        broken = tuple(
            replace(each, outcome=pairs_say) if each.outcome == "fail" else each
            for each in seen.margins
        )
        return replace(seen, margins=broken)

    def answer(deployment: Deployment) -> Measurement:
        levers = changed(deployment)
        cost = 1.0 - 0.2 * ("placement" in levers) + 0.3 * ("qos" in levers)
        return played(cost, -0.5 if "qos" in levers else 0.5)

    found = Search(BLANK, GivenMachine(answer, pairs_show), SETTINGS).run()
    assert found.outcome == "meets"
    assert found.winner is not None
    assert changed(found.winner) == {"placement", "qos"}


def test_no_deployment_meets_the_objectives_and_the_nearest_is_named() -> None:
    found, machine = search(lambda deployment: played(1.0, 0.5 - 0.1 * len(changed(deployment))))
    assert found.outcome == "not met"
    assert found.reason == (
        "None of 8 deployments meets the objectives; the nearest, placement: other, threads: other,"
        " qos: other, misses latency.p99 < 50 ms by 22.1 %; first: callback takes 41 ms of 58 ms in"
        " the mean."
    )
    assert found.winner is None
    assert not machine.compared


def test_deployments_that_break_the_graph_are_results() -> None:
    def answer(deployment: Deployment) -> Measurement:
        if "threads" in changed(deployment):
            return Measurement(state="broken", reason="R2B640: not ready")
        if "qos" in changed(deployment):
            return Measurement(state="refused", reason="R2B301: no such profile")
        return played(0.5 if changed(deployment) else 1.0)

    found, _ = search(answer)
    assert found.outcome == "improved"
    assert {trial.state for trial in found.trials} == {"meets", "broken", "refused"}
    assert len(found.trials) == SPACE.size


def test_a_start_that_the_machine_cannot_play_says_nothing_of_a_deployment() -> None:
    starts: dict[Deployment, int] = {}

    def answer(deployment: Deployment) -> Measurement:
        starts[deployment] = starts.get(deployment, 0) + 1
        if "qos" in changed(deployment) or starts[deployment] == 2:
            return Measurement(state="invalid", reason="The playback was late.")
        return played(1.0 - 0.1 * len(changed(deployment)))

    found, _ = search(answer)
    assert found.outcome == "improved"
    assert found.winner is not None
    assert changed(found.winner) == {"placement", "threads"}
    assert sum(trial.state == "invalid" for trial in found.trials) == SPACE.size // 2


def test_where_nothing_works_that_is_said() -> None:
    found, _ = search(lambda _: Measurement(state="broken", reason="R2B640: not ready"))
    assert found.outcome == "not met"
    assert found.reason.endswith("none of them works; today's: R2B640: not ready")


def test_todays_deployment_may_be_the_best() -> None:
    found, machine = search(lambda deployment: played(1.0 + 0.2 * len(changed(deployment))))
    assert found.outcome == "met today"
    assert not machine.compared


def test_a_gain_that_pairs_do_not_show_is_not_claimed() -> None:
    machine = NoGain(lambda deployment: played(0.9 if "qos" in changed(deployment) else 1.0))
    found = Search(BLANK, machine, SETTINGS).run()
    assert found.outcome == "not shown"


def undecided(excess: float = 0.0) -> Measurement:
    """A start of today's that does not say whether it keeps the limit."""
    near = replace(margin(excess), outcome="inconclusive")
    return replace(played(1.0), margins=(near,))


def borderline_machine() -> GivenMachine:
    """A machine on which the threads keep the limit in single starts, and not in pairs.

    Today's misses the limit; two levers help alone, of which threads are the cheaper one.
    """

    def answer(deployment: Deployment) -> Measurement:
        levers = changed(deployment)
        cost = 2.0 if "placement" in levers else 1.5 if "threads" in levers else 1.0
        helps = levers & {"placement", "threads"}
        return played(cost + 0.1 * ("qos" in levers), -0.5 if helps else 1)

    def pairs_show(_base: Deployment, head: Deployment, seen: Pairs) -> Pairs:
        return (
            replace(seen, margins=undecided(0.01).margins) if "threads" in changed(head) else seen
        )

    return GivenMachine(answer, pairs_show)


def test_the_next_best_deployment_is_compared_where_pairs_refute_the_best() -> None:
    machine = borderline_machine()
    found = Search(BLANK, machine, SETTINGS).run()
    assert found.outcome == "meets"
    assert found.winner is not None
    assert changed(found.winner) == {"placement"}
    assert [each.outcome for each in found.requirements] == ["pass"]
    assert any("threads: other meets latency.p99 < 50 ms" in note for note in found.notes)


def test_no_other_deployment_is_compared_without_the_time_for_it() -> None:
    machine = borderline_machine()
    settings = SearchSettings(trials=8, budget_s=250.0, pairs=5)
    found = Search(BLANK, machine, settings).run()
    assert machine.seconds <= settings.budget_s
    assert found.outcome == "not shown"
    assert found.proof is not None
    assert "do not show that it meets" in found.reason


def test_a_start_that_does_not_decide_is_not_said_to_miss() -> None:
    def answer(deployment: Deployment) -> Measurement:
        return played(1.0) if changed(deployment) else undecided(-0.01)

    found, _ = search(lambda one: replace(answer(one), cost=0.5 if changed(one) else 1.0))
    assert found.outcome == "improved"
    # Nor is a gain claimed that is not shown.
    found, _ = search(lambda one: replace(answer(one), cost=0.99 if changed(one) else 1.0))
    assert (found.outcome, found.is_proved) == ("meets", True)
    assert "today's own runs do not show that it does: latency.p99 < 50 ms" in found.reason
    assert found.proof is not None
    assert not found.proof.is_shown


def todays_judged(
    answer: Callable[[Deployment], Measurement], outcome: Literal["pass", "inconclusive", "fail"]
) -> GivenMachine:
    """A machine on which the own runs of today's, and of no other, are judged so."""

    def own_runs_show(seen: Pairs) -> Pairs:
        assert seen.gain.change == Deployment().text
        return replace(seen, margins=(replace(margin(0.0), outcome=outcome),))

    return GivenMachine(answer, own_runs_show=own_runs_show)


@pytest.mark.parametrize(("own_runs", "outcome"), [("pass", "met today"), ("fail", "meets")])
def test_without_a_gain_the_own_runs_of_todays_decide_what_a_start_does_not(
    own_runs: Literal["pass", "fail"], outcome: str
) -> None:
    machine = todays_judged(lambda one: played(0.99) if one.choices else undecided(), own_runs)
    result = Search(BLANK, machine, SETTINGS).run()
    assert (result.outcome, result.winner is None) == (outcome, own_runs == "pass")
    if own_runs == "pass":
        assert "do not show a gain" in result.notes[-1]


@pytest.mark.parametrize(("excess", "outcome"), [(-0.5, "met today"), (0.5, "not shown")])
def test_without_levers_that_give_something_it_is_todays_that_meets(
    excess: float, outcome: str
) -> None:
    def answer(deployment: Deployment) -> Measurement:
        levers = len(changed(deployment))
        return played(1.0 - 0.1 * levers, -0.5 if levers else excess)

    result = Search(BLANK, NoGain(answer), SETTINGS).run()
    assert (result.outcome, result.winner) == (outcome, None)
    assert result.reason.startswith("No lever of the best deployment gives anything")
    assert len(result.dropped) == 3


def test_todays_own_runs_decide_where_pairs_refute_what_costs_less() -> None:
    def answer(deployment: Deployment) -> Measurement:
        if not deployment.choices:
            return undecided(-0.01)
        return played(0.8, -0.5 if changed(deployment) == {"placement"} else 0.5)

    machine = todays_judged(answer, "pass")
    machine.pairs_show = lambda _base, _head, seen: replace(seen, margins=undecided(-0.01).margins)
    result = Search(BLANK, machine, SETTINGS).run()
    assert (result.outcome, result.winner) == ("met today", None)


def test_time_is_kept_for_a_proof_only_once_there_is_something_to_prove() -> None:
    settings = SearchSettings(trials=8, budget_s=150.0, pairs=5)
    nothing, machine = search(lambda _: played(1.0, 0.5), settings)
    something, _ = search(
        lambda deployment: played(1.0, -0.5 if changed(deployment) else 0.5), settings
    )
    assert len(nothing.trials) == 8 > len(something.trials)
    assert nothing.outcome == "not met"
    assert machine.seconds <= settings.budget_s


def test_a_search_that_is_interrupted_in_its_first_trial_can_be_resumed() -> None:
    def interrupted(_: Deployment) -> Measurement:
        raise KeyboardInterrupt

    stored = Stored()
    with pytest.raises(KeyboardInterrupt):
        search(interrupted, listener=stored)
    assert stored.results[0].outcome == "incomplete"
    found, _ = search(lambda _: played(1.0), earlier=stored.results[0])
    assert len(found.trials) == SPACE.size


def test_the_budget_holds_and_leaves_time_for_the_proof() -> None:
    settings = SearchSettings(trials=8, budget_s=150.0, pairs=5)
    found, machine = search(
        lambda deployment: played(1.0 / (1 + len(changed(deployment)))), settings
    )
    assert machine.seconds <= 150.0
    assert len(found.trials) < 8
    assert any("of 8 trials" in note for note in found.notes)


def test_a_search_without_time_for_a_second_trial_claims_nothing() -> None:
    for settings in (
        SearchSettings(trials=8, budget_s=5.0, pairs=5),
        SearchSettings(trials=1, budget_s=10_000.0, pairs=5),
    ):
        found, _ = search(lambda _: played(1.0), settings)
        assert found.outcome == "incomplete"
        assert "--budget" in found.reason
        assert len(found.trials) == 1


def test_an_interrupted_search_goes_on_with_its_trials() -> None:
    def answer(deployment: Deployment) -> Measurement:
        return played(1.0 - 0.1 * len(changed(deployment)))

    stored = Stored(trials=3)
    with pytest.raises(KeyboardInterrupt):
        search(answer, listener=stored)
    last = stored.results[-1]
    found, machine = search(answer, earlier=last)
    assert len(found.trials) == SPACE.size
    assert found.trials[:3] == last.trials
    assert [int(name) for name in machine.starts if name.isdigit()] == [3, 4, 5, 6, 7]


def test_what_a_model_rules_out_is_not_tried() -> None:
    class Model(SearchListener):
        def predictor(self, today: Trial) -> Predict:
            assert not today.deployment.choices

            def predict(deployment: Deployment) -> Forecast:
                cannot = "threads" in changed(deployment)
                return Forecast(ruled_out="p99 is at least 60 ms" if cannot else "")

            return predict

    found, _ = search(lambda _: played(1.0), listener=Model())
    assert all("threads" not in changed(trial.deployment) for trial in found.trials)
    assert len(found.predicted) == SPACE.size // 2
    assert found.predicted[0].endswith("p99 is at least 60 ms")


def test_several_deployments_are_tried_at_once_where_there_are_several_hosts() -> None:
    machine = GivenMachine(lambda one: played(1.0 - 0.1 * len(changed(one))), width=4)
    found = Search(BLANK, machine, SETTINGS).run()
    assert found.outcome == "improved"
    assert len(found.trials) == SPACE.size
    assert machine.starts[1:5] == ["001", "002", "003", "004"]
    # A round is a comparison, and stays on one host; several rounds are made at once.
    rounds = [start.round for batch in machine.batches for start in batch if start.round]
    assert Counter(rounds[:16]) == {1: 4, 2: 4, 3: 4, 4: 4}
    assert [{start.round for start in batch} for batch in machine.batches[3:4]] == [{1, 2, 3, 4}]


def only_placement_helps(deployment: Deployment) -> Measurement:
    return played(0.8 if "placement" in changed(deployment) else 1.0)


def test_a_start_of_todays_that_is_not_played_is_not_said_to_miss() -> None:
    """A gain that pairs show is one; without a gain nothing is claimed of today's."""
    late = Measurement(state="invalid", reason="The playback was late.")
    found, _ = search(lambda one: only_placement_helps(one) if one.choices else late)
    assert found.trials[0].state == "invalid"
    # Its pairs are not played either.
    assert found.outcome == "not shown"

    class OnceLate(GivenMachine):
        def measure(self, starts: Sequence[Start]) -> list[Measurement]:
            seen = super().measure(starts)
            return [late] if starts[0].name == "000" else seen

    improved = Search(BLANK, OnceLate(only_placement_helps), SETTINGS).run()
    assert improved.outcome == "improved"
    none = Search(BLANK, OnceLate(lambda _: played(1.0)), SETTINGS).run()
    assert none.outcome == "met today"


@pytest.mark.parametrize("excess", [-0.5, 0.5])
def test_where_todays_does_not_work_the_winner_is_judged_alone(excess: float) -> None:
    def answer(deployment: Deployment) -> Measurement:
        if not deployment.choices:
            return Measurement(state="broken", reason="R2B631: a process died")
        return played(1.0)

    machine = GivenMachine(
        answer, own_runs_show=lambda seen: replace(seen, margins=(margin(excess),))
    )
    found = Search(BLANK, machine, SETTINGS).run()
    assert found.outcome == ("meets" if excess < 0 else "not shown")
    assert found.proof is None
    assert found.proofs >= 1
    assert [each.excess for each in found.requirements] == [excess]
    assert all(base for base, _ in machine.compared)


def test_where_todays_fails_in_the_pairs_the_winner_is_judged_alone() -> None:
    def pairs_show(base: Deployment, _head: Deployment, seen: Pairs) -> Pairs:
        if base.choices:
            return seen
        return replace(seen, base_fails=True, reason="R2B698: the base fails")

    found = Search(BLANK, GivenMachine(only_placement_helps, pairs_show), SETTINGS).run()
    assert found.outcome == "meets"
    assert "R2B698" in found.notes[-1]


@pytest.mark.parametrize(
    ("own_runs", "outcome", "says"),
    [
        ("pass", "met today", "Its own runs show that today's deployment meets the objectives"),
        ("inconclusive", "meets", "today's own runs do not show that it does: latency.p99"),
        ("fail", "meets", "The deployment meets the objectives"),
    ],
)
def test_where_a_start_does_not_decide_of_todays_its_own_runs_do(
    own_runs: Literal["pass", "inconclusive", "fail"], outcome: str, says: str
) -> None:
    """None costs less than today's, and others keep its limits by far."""
    machine = todays_judged(lambda one: played(2.0) if one.choices else undecided(), own_runs)
    found = Search(BLANK, machine, SETTINGS).run()
    assert (found.trials[0].state, found.outcome) == ("open", outcome)
    assert says in found.reason
    assert machine.starts.count("today") == 1
    if own_runs == "fail":
        assert found.winner is not None
        assert "today's own runs show that it misses latency.p99 < 50 ms" in found.reason
        machine = todays_judged(
            lambda one: played(1.0, 0.5) if one.choices else undecided(), own_runs
        )
        none = Search(BLANK, machine, SETTINGS).run()
        assert (none.outcome, none.winner) == ("not met", None)


def test_a_gain_without_a_value_does_not_hide_that_the_objectives_are_met() -> None:
    def answer(deployment: Deployment) -> Measurement:
        if not deployment.choices:
            return replace(played(1.0, 0.5), cost=None)
        return played(1.0)

    found, _ = search(answer)
    assert found.outcome == "meets"
    found, _ = search(lambda one: answer(one) if one.choices else replace(played(1.0), cost=None))
    assert found.outcome == "not shown"
    assert "the metric has no value" in found.reason


def test_without_a_start_that_is_judged_nothing_is_said_of_any_deployment() -> None:
    late = Measurement(state="invalid", reason="The playback was late.")
    found, _ = search(lambda _: late)
    assert (found.outcome, found.reason) == (
        "incomplete",
        "No start could be judged, so search in a new folder: The playback was late.",
    )
    found, _ = search(lambda one: late if "qos" in changed(one) else played(1.0, 0.5))
    assert found.reason.startswith("None of 4 deployments meets")


def test_a_goal_without_a_value_is_not_said_to_be_an_objective_that_is_missed() -> None:
    found, _ = search(lambda _: replace(played(1.0), cost=None))
    assert found.outcome == "not shown"
    assert "cpu.graph.mean, has no value" in found.reason
    found, _ = search(
        lambda one: played(1.0, 0.5) if one.choices else replace(played(1.0), cost=None)
    )
    assert "cpu.graph.mean, has no value" in found.reason


MANY = TuningSpace(
    levers=tuple(
        Lever(
            name=f"lever_{number}",
            settings=tuple(
                Setting(text=f"{place}", sets=(f"x{number}={place}",) if place else ())
                for place in range(4)
            ),
        )
        for number in range(6)
    )
)


def test_no_deployment_is_tried_twice_however_many_are_tried_at_once() -> None:
    def answer(deployment: Deployment) -> Measurement:
        return played(1.0 - sum(0.02 * choice.place for choice in deployment.choices))

    machine = GivenMachine(answer, width=8)
    settings = SearchSettings(trials=60, budget_s=1e6, pairs=5)
    found = Search(replace(BLANK, space=MANY), machine, settings).run()
    assert len({trial.deployment for trial in found.trials}) == len(found.trials) == 60
    twice = [found.trials[0], *found.trials]
    assert len({each.deployment for each in finalists_of(twice, 60)}) == 60


class Slow(SearchListener):
    """A model that rules out all, and takes five seconds for it."""

    asked: int = 0

    def __init__(self, machine: GivenMachine) -> None:
        self._machine = machine

    def predictor(self, today: Trial) -> Predict:
        del today

        def predict(deployment: Deployment) -> Forecast:
            del deployment
            self.asked += 1
            self._machine.seconds += 5
            return Forecast(ruled_out="no")

        return predict


@pytest.mark.parametrize(("budget_s", "trials"), [(1200.0, 30), (1e6, 3)])
def test_predictions_end_with_the_time_for_trials(budget_s: float, trials: int) -> None:
    machine = GivenMachine(lambda _: played(1.0))
    listener = Slow(machine)
    settings = SearchSettings(trials=trials, budget_s=budget_s, pairs=8)
    found = Search(replace(BLANK, space=MANY), machine, settings, listener).run()
    assert machine.seconds <= budget_s
    # Where there is time, the model is not believed for ever.
    assert 1 < len(found.trials) <= trials
    assert listener.asked < 300


def test_a_comparison_has_the_time_that_is_left() -> None:
    machine = GivenMachine(only_placement_helps)
    settings = SearchSettings(trials=8, budget_s=600.0, pairs=5)
    found = Search(BLANK, machine, settings).run()
    assert found.outcome == "improved"
    assert all(0 < terms.limit_s <= settings.budget_s for terms in machine.terms)
    # The proof may take what is left, and no more.
    (proof,) = [terms for terms in machine.terms if not terms.lever]
    spent_s = found.duration_s - found.proof.pairs * 20.0 if found.proof else 0.0
    assert proof.limit_s == pytest.approx(settings.budget_s - spent_s)


def test_what_has_passed_before_an_interruption_counts_after_it() -> None:
    """Rounds and comparisons are stored when they end, as trials are."""
    stored = Stored()
    machine = GivenMachine(only_placement_helps)
    Search(BLANK, machine, SETTINGS, stored).run()
    times = sorted({result.duration_s for result in stored.results})
    # No more than a round of four starts, or a comparison, lies between.
    assert max(b - a for a, b in pairwise(times)) <= 100.0
    assert times[-1] == machine.seconds


def test_each_further_proof_has_half_the_chance_of_an_error() -> None:
    machine = borderline_machine()
    found = Search(BLANK, machine, SETTINGS).run()
    assert found.proofs == 2
    assert [terms.error_share for terms in machine.terms if not terms.lever] == [1.0, 0.5]
    settings = SearchSettings(trials=8, budget_s=20_000.0, pairs=6)
    again = borderline_machine()
    other = Search(BLANK, again, settings, earlier=found).run()
    assert [terms.error_share for terms in again.terms if not terms.lever] == [0.25, 0.125]
    assert other.proofs == 4


def test_a_claim_stands_until_there_is_another_proof() -> None:
    found, _ = search(only_placement_helps)
    assert found.outcome == "improved"
    stored = Stored()
    # The time is over before a proof: the trials were all made.
    settings = SearchSettings(trials=8, budget_s=found.duration_s + 1, pairs=5)
    again, machine = search(only_placement_helps, settings, stored, found)
    assert not machine.compared
    assert {(one.outcome, one.winner, one.proof) for one in stored.results} == {
        ("improved", found.winner, found.proof)
    }
    assert "No other proof was made" in again.notes[-1]
    # It is given up where another one refutes it.
    more = SearchSettings(trials=8, budget_s=20_000.0, pairs=6)
    refuted = Search(BLANK, NoGain(only_placement_helps), more, earlier=found).run()
    assert (refuted.outcome, refuted.proofs) == ("not shown", 2)


def test_pairs_whose_host_was_lost_do_not_end_a_search() -> None:
    def pairs_show(_base: Deployment, _head: Deployment, seen: Pairs) -> Pairs:
        return replace(seen, margins=(), reason="R2B688: the host left", may_retry=True)

    found = Search(BLANK, GivenMachine(only_placement_helps, pairs_show), SETTINGS).run()
    assert found.outcome == "incomplete"
    assert found.proofs == 0
    assert "--resume" in found.reason
