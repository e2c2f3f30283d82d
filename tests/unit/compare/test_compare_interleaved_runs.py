"""Which pairs are played, in which order, and which again, without ROS: the runs are simulated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from pair_simulation import latencies
from r2bspec.compare import interleaved_runs
from r2bspec.compare.interleaved_comparison import compare
from r2bspec.compare.interleaved_runs import ComparisonSide, ComparisonSpec
from r2bspec.plan.plan import Plan
from r2bspec.record.comparison_folder import PairedComparison, open_comparison
from r2bspec.record.run_folder import RunFolder
from run_simulation import Played, Simulation, objective

CALM = {"busy_s": 0.7}
BUSY = {"busy_s": 1.9, "stolen_s": 0.3}
PAIRS = 6


class Host:
    """Makes simulated runs of 20 ms, and of 22 ms for the head, with the load that is given.

    Attributes:
        loads: of the head's runs in the order in which they are played; the last one stays.
        folders: of all runs, in the order in which they were made.
    """

    def __init__(self, tmp_path: Path, loads: list[Mapping[str, float]]) -> None:
        self.tmp_path = tmp_path
        self.loads = loads
        self.folders: list[str] = []
        self._coming = iter(self._loads())

    def _loads(self) -> Iterator[Mapping[str, float]]:
        yield from self.loads
        while True:
            yield self.loads[-1]

    def run_plan(self, _plan: Plan, *, folder: RunFolder, **_others: object) -> None:
        """Take the place of a real run: write the folder of a simulated one."""
        side = folder.path.parent.name
        self.folders.append(f"{side}/{folder.path.name}")
        noise = 1 + 0.002 * (len(self.folders) % 3)
        simulation = replace(
            template(),
            segments=[Played(30.0, latencies((0.022 if side == "head" else 0.020) * noise))],
            interference=next(self._coming) if side == "head" else CALM,
        )
        folder.release()
        folder.path.rmdir()
        simulation.write(folder.path)

    def compare(self) -> PairedComparison:
        """Compare two sides that differ in nothing but their names."""
        plan = template().plan()
        confirms = msgspec.structs.replace(plan.gate, confirm=False)
        side = ComparisonSide(msgspec.structs.replace(plan, gate=confirms), self.tmp_path, "")
        compare(ComparisonSpec(side, side, PAIRS), self.tmp_path / "pairs")
        return open_comparison(self.tmp_path / "pairs")


def template() -> Simulation:
    return Simulation(objectives={"no_regression": objective("latency.p50 <= 105 % of baseline")})


@pytest.fixture
def host(tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Host:
    made = Host(tmp_path, request.param)
    monkeypatch.setattr(interleaved_runs, "run_plan", made.run_plan)
    return made


def again(folders: list[str]) -> list[str]:
    return [name for name in folders if name.endswith("again")]


@pytest.mark.parametrize("host", [[CALM]], indirect=True)
def test_the_recorded_order_is_the_order_that_was_played(host: Host) -> None:
    pairs = host.compare().record
    assert pairs.seed
    assert {each.order for each in pairs.pairs} == {"AB", "BA"}
    played = [
        getattr(each, side)
        for each in pairs.pairs
        for side in (("base", "head") if each.order == "AB" else ("head", "base"))
    ]
    assert host.folders == played


@pytest.mark.parametrize("host", [[BUSY]], indirect=True)
def test_on_a_host_that_is_always_busy_two_pairs_are_played_again_and_no_more(host: Host) -> None:
    pairs = host.compare().record
    assert len(again(host.folders)) == 2 * 2
    assert any("the machine is always busy" in note for note in pairs.notes)


@pytest.mark.parametrize("host", [[BUSY] * PAIRS + [CALM]], indirect=True)
def test_pairs_are_played_again_until_that_decides(host: Host) -> None:
    pairs = host.compare()
    # Two unaffected pairs that agree to 1 % show a difference of 10 %; more are not needed.
    rerun = {each.number for each in pairs.record.pairs if each.again}
    assert 2 <= len(rerun) < PAIRS
    assert not any("always busy" in note for note in pairs.record.notes)
