"""What a search makes of a fleet: hosts of one class, rounds on one host, and hosts that fail."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

pytest.importorskip("rosbags")

from direct_hosts import FACTS
from r2bspec import api
from r2bspec.errors import R2bspecError
from r2bspec.execute.errors import RunError
from r2bspec.fleet.errors import (
    BundleTooLargeError,
    HostLostError,
    HostsDifferError,
    NoHostError,
    NotAllowedError,
)
from r2bspec.fleet.fleet_runs import EndedRun, FleetRun
from r2bspec.fleet.hosts import ANY, HostFacts
from r2bspec.fleet.uniform_hosts import UniformHosts, hosts_of_one_class
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.plan.prepared_benchmark import PlannedRun
from r2bspec.plan.tuning_space import Choice, Deployment, Setting
from r2bspec.tune.machine import Start, Terms, TuningError, goal_of
from r2bspec.tune.trials import RealMachine
from ros_runs import Bench, relay_spec
from run_simulation import Simulation

OTHER = Deployment(
    (Choice(lever="graph.placement", place=1, setting=Setting(text="x", sets=("title=x",))),)
)


def host(name: str, **facts: Any) -> HostFacts:
    return msgspec.structs.replace(FACTS, name=name, cpu="A78", cores=4, **facts)


class Client:
    """A connection whose hosts are given."""

    def __init__(self, *names: str) -> None:
        self.hosts = dict.fromkeys(names)


class GivenHosts(UniformHosts):
    """A fleet on which every run ends with an error, or none is left."""

    error: R2bspecError
    made: list[FleetRun]
    calls: int = 0

    def _made(self, runs: Sequence[FleetRun]) -> list[EndedRun]:
        self.calls += 1
        self.made = [*runs]
        return [EndedRun(run, "a", self.error) for run in runs]


@pytest.fixture
def hosts() -> GivenHosts:
    client: Any = Client("a", "b", "c")
    return GivenHosts(client, ("a", "b", "c", "d"), host("a"))


@pytest.fixture
def fleet(tmp_path: Path, hosts: GivenHosts) -> RealMachine:
    spec = relay_spec()
    spec["slos"] = {"all": {"at": "20 Hz", "require": ["received > 0"]}}
    selection = SpecSelection(Bench(tmp_path).write(spec))
    plan = api.prepare(selection).plan
    return RealMachine(selection, tmp_path / "runs", goal_of(plan, "cpu.graph.mean"), hosts)


def test_starts_are_made_on_any_host_and_those_of_a_round_on_one(
    fleet: RealMachine, hosts: GivenHosts
) -> None:
    hosts.error = R2bspecError("the graph did not start", code="R2B640")
    assert fleet.width == 3
    rounds = {"1": 0, "2": 1, "3": 1, "4": 2}
    seen = fleet.measure([Start(OTHER, name, round=number) for name, number in rounds.items()])
    assert [one.state for one in seen] == ["broken"] * 4
    free, first, second, other = (run.hosts for run in hosts.made)
    assert free == {"a", "b", "c"}
    assert len(first) == 1
    assert first == second != other


def test_a_lost_host_says_nothing_of_a_deployment(fleet: RealMachine, hosts: GivenHosts) -> None:
    hosts.error = HostLostError("the host a left the fleet")
    (seen,) = fleet.measure([Start(OTHER, "1")])
    assert (seen.state, seen.reason) == ("invalid", "R2B688: the host a left the fleet")
    hosts.error = BundleTooLargeError("the files that the spec names have more than 512 MiB")
    with pytest.raises(BundleTooLargeError):
        fleet.measure([Start(OTHER, "1")])
    hosts.error = HostLostError("the host a left the fleet")
    hosts.client.hosts = {}
    with pytest.raises(HostLostError):
        fleet.measure([Start(OTHER, "1")])


def test_what_a_host_refuses_is_a_result_unless_it_is_the_spec_itself(
    fleet: RealMachine, hosts: GivenHosts
) -> None:
    hosts.error = NotAllowedError("the host a does not allow Python")
    (seen,) = fleet.measure([Start(OTHER, "1")])
    assert (seen.state, seen.reason) == ("refused", "R2B685: the host a does not allow Python")
    hosts.error = RunError("the policy fifo is not permitted", code="R2B637")
    (seen,) = fleet.measure([Start(OTHER, "2")])
    assert (seen.state, seen.reason) == ("refused", "R2B637: the policy fifo is not permitted")
    with pytest.raises(TuningError, match="refused as it is: R2B637: the policy"):
        fleet.measure([Start(Deployment(), "1")])
    # No other deployment would install it.
    hosts.error = RunError("service type a/srv/B is not installed", code="R2B681")
    with pytest.raises(TuningError, match="refused as it is: R2B681: service type"):
        fleet.measure([Start(Deployment(), "1")])


def test_a_deployment_without_what_is_minimized_is_refused(fleet: RealMachine) -> None:
    """Its run has no such process."""
    run = Simulation().write(fleet.folder / "1")
    fleet.goal = msgspec.structs.replace(fleet.goal, metric="cpu.gone.mean")
    judged: Any = SimpleNamespace(verdict=SimpleNamespace(is_judged=True))
    seen = fleet._measured(PlannedRun(fleet.prepare(OTHER), run.folder), judged)
    assert seen.state == "refused"
    assert seen.reason.startswith("cpu.gone.mean: ")


def test_todays_deployment_is_observed_from_inside_when_it_is_started_again(
    fleet: RealMachine,
    hosts: GivenHosts,
) -> None:
    hosts.error = HostLostError("the host a left the fleet")
    fleet.measure([Start(Deployment(), "1"), Start(OTHER, "2")])
    assert [run.folder.name for run in hosts.made] == ["1", "2"]
    assert [run.options for run in hosts.made] == [{"anatomy": True}, {"anatomy": False}]


def test_pairs_go_to_a_host_as_a_comparison(fleet: RealMachine, hosts: GivenHosts) -> None:
    hosts.error = HostLostError("the host a left the fleet")
    seen = fleet.compare(Deployment(), OTHER, 3, "proof", Terms(limit_s=60, error_share=0.5))
    assert seen.reason == "R2B688: the host a left the fleet"
    (run,) = hosts.made
    assert run.options == {"compares": True, "force": True, "against": "today's", "pairs": 3}
    assert [side.plan.title for side in run.sides] == ["x", ""]
    # No pair begins that would not end in time, and half of the error is left.
    assert {side.plan.gate.time_budget_ns for side in run.sides} == {60 * 10**9}
    assert run.head.plan.gate.confidence == pytest.approx(0.975)


def test_pairs_whose_host_is_lost_are_no_result(fleet: RealMachine, hosts: GivenHosts) -> None:
    hosts.error = HostLostError("the host a left the fleet")
    terms = Terms(limit_s=1e6)
    assert fleet.compare(Deployment(), OTHER, 3, "proof", terms).may_retry
    assert hosts.calls == 2
    assert fleet.judge(OTHER, "proof", terms).may_retry
    assert hosts.calls == 4
    hosts.error = R2bspecError("the base fails: it ended", code="R2B698")
    seen = fleet.compare(Deployment(), OTHER, 3, "proof", terms)
    assert (seen.base_fails, seen.may_retry, hosts.calls) == (True, False, 5)


def test_a_deployment_alone_is_not_judged_without_the_time_for_it(
    fleet: RealMachine, hosts: GivenHosts
) -> None:
    seen = fleet.judge(OTHER, "proof", Terms(limit_s=0.5))
    assert seen.may_retry
    assert "are left" in seen.reason
    assert hosts.calls == 0


def test_hosts_of_several_classes_are_refused_with_a_way_out(fleet: RealMachine) -> None:
    plan = fleet.prepare(Deployment()).plan
    facts = {name: host(name) for name in "abc"} | {"d": host("d", ros_distro="rolling")}
    with pytest.raises(HostsDifferError) as raised:
        hosts_of_one_class(plan, facts, (ANY,))
    assert "of 2 classes" in str(raised.value)
    assert "a, b, c (A78, 4 CPUs); d (A78, 4 CPUs, rolling)" in str(raised.value)
    assert raised.value.hint.endswith("--hosts a,b,c")
    assert hosts_of_one_class(plan, facts, ("b", "a")) == ("a", "b")
    with pytest.raises(NoHostError, match="no host 'e'"):
        hosts_of_one_class(plan, facts, ("e",))
