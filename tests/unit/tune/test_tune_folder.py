"""What a search leaves in its folder, and what a later call makes of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import pytest
from msgspec.structs import replace

pytest.importorskip("optuna")

from given_machine import GivenMachine, NoGain, changed, played
from r2bspec import api
from r2bspec.errors import UsageError
from r2bspec.execute.processes.machine import describe_machine
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.plan.tuning_space import Deployment
from r2bspec.tune import run_search, trials
from r2bspec.tune.launch_file import LAUNCH_FILE, NODES_FILE
from r2bspec.tune.machine import Measurement, Pairs, Start, TuningError, goal_of
from r2bspec.tune.search import SearchSettings
from r2bspec.tune.trials import RealMachine, ThisHost
from r2bspec.tune.tuning_result import TUNING_FILE, TuningResult, read_tuning
from ros_runs import Bench, relay_node, relay_spec

OWN_NODE: Final = """
class Other(Node):
    def __init__(self, **kwargs):
        super().__init__("other", **kwargs)
        publisher = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", publisher.publish, 10)
"""
SETTINGS: Final = SearchSettings(trials=6, budget_s=10_000.0, pairs=5)


class FolderMachine(RealMachine):
    """Prepares real plans, and measures what is given."""

    given: GivenMachine

    def now(self) -> float:
        return self.given.now()

    def measure(self, starts: Sequence[Start]) -> list[Measurement]:
        return self.given.measure(starts)

    def slowest_part(self, deployment: Deployment, name: str) -> str:
        return self.given.slowest_part(deployment, name)

    def compare(self, *args: Any, **options: Any) -> Pairs:
        return self.given.compare(*args, **options)


class Searches:
    """Searches of a spec of two nodes, in one folder, on a machine whose answers are given."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder = folder / "search"
        own_node = {"python": "./nodes.py:Other", "remappings": {"output": "unseen"}}
        nodes = {"relay": relay_node(), "other": own_node}
        slos = {"all": {"at": "20 Hz", "require": ["received > 0"]}}
        bench = Bench(folder)
        bench.write_node("nodes.py", OWN_NODE)
        self.spec = bench.write(relay_spec(slos=slos, graph={"nodes": nodes}))
        self.code = folder / "nodes.py"
        self.lines: list[str] = []
        self.machine = GivenMachine
        self._monkeypatch = monkeypatch

    def run(
        self,
        answer: Callable[[Deployment], Measurement],
        settings: SearchSettings = SETTINGS,
        *,
        minimize: str = "cpu.graph.mean",
        resume: bool = False,
        sets: Sequence[str] = (),
    ) -> TuningResult:
        """Search."""
        self.given = given = self.machine(answer)
        self._monkeypatch.setattr(FolderMachine, "given", given, raising=False)
        self._monkeypatch.setattr(run_search, "RealMachine", FolderMachine)
        selection = SpecSelection(self.spec, sets=sets)
        return run_search.tune(
            selection,
            api.prepare(selection),
            self.folder,
            settings,
            minimize=minimize,
            player=ThisHost(),
            tell=self.lines.append,
            resume=resume,
        )


@pytest.fixture
def searches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Searches:
    return Searches(tmp_path, monkeypatch)


def cheaper(deployment: Deployment) -> Measurement:
    return played(0.8 if "graph.placement" in changed(deployment) else 1.0)


def test_what_is_minimized_stays_in_every_deployment(searches: Searches) -> None:
    """A process that only the call names is there in all of them."""
    found = searches.run(cheaper, minimize="cpu.relay.mean")
    for trial in found.trials:
        sets = (*trial.deployment.sets,)
        names = {process.name for process in api.prepare(searches.spec, sets=sets).plan.processes}
        assert "relay" in names
    searches.folder = searches.folder.with_name("graph")
    found = searches.run(cheaper)
    assert any("graph.placement" in changed(trial.deployment) for trial in found.trials)


DERIVED = (run_search.PATCH_FILE, LAUNCH_FILE, NODES_FILE)


def derived(searches: Searches) -> list[bool]:
    return [(searches.folder / name).exists() for name in DERIVED]


def test_a_search_that_has_ended_keeps_its_proof(searches: Searches) -> None:
    found = searches.run(cheaper)
    assert found.outcome == "improved"
    before = (searches.folder / TUNING_FILE).read_bytes()
    for settings in (SETTINGS, SearchSettings(trials=2, budget_s=60.0, pairs=3)):
        again = searches.run(cheaper, settings, resume=True)
        assert again == found
        assert not searches.given.starts
        assert (searches.folder / TUNING_FILE).read_bytes() == before
    assert "the search has ended" in searches.lines[-1]


def test_what_was_made_of_a_proof_goes_with_it(searches: Searches) -> None:
    searches.run(cheaper)
    (searches.folder / run_search.PATCH_FILE).write_text("")
    assert derived(searches) == [True, True, True]
    # Interrupted, it still stands.
    more = SearchSettings(trials=6, budget_s=20_000.0, pairs=6)

    def interrupted(_: Deployment) -> Measurement:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        searches.run(interrupted, more, resume=True)
    assert read_tuning(searches.folder).is_proved
    assert derived(searches) == [True, True, True]
    # The call that was interrupted goes on, and its pairs show no gain.
    searches.machine = NoGain
    found = searches.run(cheaper, more, resume=True)
    assert (found.outcome, found.proofs) == ("not shown", 2)
    assert derived(searches) == [False, False, False]


CHANGES: Final = {
    "a limit": ["slos.all.require=[received > 5]"],
    "a parameter": ["graph.nodes.relay.parameters.service_time_ms=7.0"],
    "a rate": ["benchmark.rates=[20 Hz, 10 Hz]"],
    "the load": ["playback.buffer=4"],
}


@pytest.mark.parametrize("change", CHANGES)
def test_trials_of_another_spec_are_not_gone_on_with(searches: Searches, change: str) -> None:
    searches.run(cheaper)
    with pytest.raises(UsageError, match="was for another load, graph or objectives") as refused:
        searches.run(cheaper, resume=True, sets=CHANGES[change])
    assert "--output" in refused.value.hint
    assert "git apply -R" not in refused.value.hint
    (searches.folder / run_search.PATCH_FILE).touch()
    with pytest.raises(UsageError) as refused:
        searches.run(cheaper, resume=True, sets=CHANGES[change])
    assert "'git apply -R " in refused.value.hint
    with pytest.raises(UsageError, match="was for another space or goal"):
        searches.run(cheaper, resume=True, minimize="memory.graph.max")
    # A comment is no change.
    searches.spec.write_text(f"# today's\n{searches.spec.read_text()}")
    assert searches.run(cheaper, resume=True).is_proved


def test_a_requirement_of_a_baseline_is_said_not_to_be_judged(searches: Searches) -> None:
    requirement = "latency.p50 <= 110 % of baseline"
    found = searches.run(cheaper, sets=[f"slos.all.require=[received > 0, {requirement}]"])
    assert f"all: {requirement} is not judged: a search has no baseline." in found.notes


def test_trials_of_other_code_are_not_gone_on_with(searches: Searches) -> None:
    searches.run(cheaper)
    text = searches.code.read_text()
    searches.code.write_text(f"{text}# slower\n")
    with pytest.raises(UsageError, match=r"was for other code: nodes\.py changed since then"):
        searches.run(cheaper, resume=True)
    searches.code.write_text(text)
    assert searches.run(cheaper, resume=True).is_proved


def test_trials_of_another_machine_are_not_gone_on_with(
    searches: Searches, monkeypatch: pytest.MonkeyPatch
) -> None:
    searches.run(cheaper)
    machine = describe_machine()
    monkeypatch.setattr(trials, "describe_machine", lambda: machine | {"cpu": "Z80", "cores": 64})
    with pytest.raises(UsageError, match="was for another machine: .*; this is .*Z80, 64 CPUs"):
        searches.run(cheaper, resume=True)


EDITS: Final = {
    "another value": "spec",
    "no spec any more": "spec",
    "a node": "code",
}


@pytest.mark.parametrize("change", EDITS)
def test_what_changes_during_the_search_ends_it(searches: Searches, change: str) -> None:
    file: Path = getattr(searches, EDITS[change])
    text = file.read_text()
    others = {
        "another value": text.replace("service_time_ms: 1.0", "service_time_ms: 9.0"),
        "no spec any more": "graph: [",
        "a node": f"{text}# slower\n",
    }
    assert others[change] != text

    def edited(deployment: Deployment) -> Measurement:
        if deployment.choices:
            file.write_text(others[change])
        return cheaper(deployment)

    with pytest.raises(TuningError, match="changed.* while the search was running") as ended:
        searches.run(edited)
    assert file.name in str(ended.value)
    assert "--resume" in ended.value.hint
    assert len(read_tuning(searches.folder).trials) == 1
    file.write_text(text)
    assert searches.run(cheaper, resume=True).is_proved


def test_a_search_goes_on_without_the_run_that_predicts(searches: Searches) -> None:
    """The folder of its first trial was removed, or is damaged."""

    def answer(deployment: Deployment) -> Measurement:
        return replace(cheaper(deployment), run="000")

    assert searches.run(answer).is_proved
    assert any(line.startswith("no predictions: ") for line in searches.lines)


def test_the_goal_is_measured_at_the_very_rate_that_is_played(searches: Searches) -> None:
    """No objective names it, so it is not as a user wrote it."""
    sets = ["benchmark.rates=[33.3333333 Hz]", "slos={}"]
    plan = api.prepare(SpecSelection(searches.spec, sets=sets)).plan
    goal = goal_of(plan, "cpu.graph.mean")
    assert goal.at is not None
    assert goal.at.hz in {play.rate_hz for play in plan.play} == {33.3333333}
