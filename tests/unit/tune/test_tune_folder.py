"""What a search leaves in its folder, and what a later call makes of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import pytest

pytest.importorskip("optuna")

from given_machine import GivenMachine, changed, played
from r2bspec import api
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.plan.tuning_space import Deployment
from r2bspec.tune import tuning
from r2bspec.tune.machine import Measurement, Pairs, Start
from r2bspec.tune.search import SearchSettings
from r2bspec.tune.trials import ThisMachine
from r2bspec.tune.tuning_result import TuningResult
from ros_runs import Bench, relay_node, relay_spec

SETTINGS: Final = SearchSettings(trials=6, budget_s=10_000.0, pairs=5)


class FolderMachine(ThisMachine):
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
        nodes = {"relay": relay_node(), "other": relay_node(remappings={"output": "unseen"})}
        slos = {"all": {"at": "20 Hz", "require": ["received > 0"]}}
        self.spec = Bench(folder).write(relay_spec(slos=slos, graph={"nodes": nodes}))
        self.lines: list[str] = []
        self._monkeypatch = monkeypatch

    def run(
        self,
        answer: Callable[[Deployment], Measurement],
        settings: SearchSettings = SETTINGS,
        *,
        minimize: str = "cpu.graph.mean",
        resume: bool = False,
    ) -> TuningResult:
        """Search."""
        self.given = given = GivenMachine(answer)
        self._monkeypatch.setattr(FolderMachine, "given", given, raising=False)
        self._monkeypatch.setattr(tuning, "ThisMachine", FolderMachine)
        selection = SpecSelection(self.spec)
        return tuning.tune(
            selection,
            api.prepare(selection),
            self.folder,
            settings,
            minimize=minimize,
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
