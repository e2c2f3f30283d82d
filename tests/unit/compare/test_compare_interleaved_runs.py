"""Which pairs are played, in which order, and which again, without ROS: the runs are simulated."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from pair_simulation import latencies
from r2bspec.compare import interleaved_runs
from r2bspec.compare.interleaved_comparison import (
    NOTHING_BY_TURNS,
    BaseFailsError,
    ComparisonSide,
    ComparisonSpec,
    why_not_by_turns,
)
from r2bspec.compare.interleaved_runs import compare
from r2bspec.compare.report_input import judge_comparison_folder
from r2bspec.errors import ExitStatus
from r2bspec.execute.errors import ProcessDiedError, RunError, UnwritableRunError
from r2bspec.execute.states import Progress
from r2bspec.language.spec import Arrivals, QoS
from r2bspec.plan.plan import InputPlan, Plan, PlayPlan
from r2bspec.record import run_folder, sample_arrays
from r2bspec.record.comparison_folder import PairedComparison, open_comparison
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.sample_arrays import Rows
from run_simulation import Played, Simulation, objective

CALM = {"busy_s": 0.7}
BUSY = {"busy_s": 1.9, "stolen_s": 0.3}
PAIRS = 4


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

    def compare(
        self,
        environment: Mapping[str, str] | None = None,
        budget_s: float = 0.0,
        *,
        confirm: bool = False,
        progress: Progress | None = None,
        alternates: str = NOTHING_BY_TURNS,
    ) -> PairedComparison:
        """Compare two sides that differ in nothing but their names, and in an environment."""
        plan = msgspec.structs.replace(template().plan(), phases=("start",))
        budget_ns = int(budget_s * 1e9)
        gate = msgspec.structs.replace(plan.gate, confirm=confirm, time_budget_ns=budget_ns)
        side = ComparisonSide(msgspec.structs.replace(plan, gate=gate), self.tmp_path, "")
        base = replace(side, environment=environment or {})
        folder = self.tmp_path / "pairs"
        comparison = ComparisonSpec(base, side, PAIRS, alternates=alternates)
        compare(comparison, folder, *([progress] if progress else []))
        return open_comparison(self.tmp_path / "pairs")


def template() -> Simulation:
    return Simulation(objectives={"no_regression": objective("latency.p50 <= 105 % of baseline")})


@pytest.fixture
def host(tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Host:
    made = Host(tmp_path, request.param)
    monkeypatch.setattr(interleaved_runs, "run_plan", made.run_plan)
    return made


SECRETS = {"API_TOKEN": "very-secret", "OMP_NUM_THREADS": "4", "GONE_KEY": ""}


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Host, PairedComparison]:
    """A comparison that nothing disturbs, whose base has secrets in its environment.

    Both sides at once do not come up, as they are simulated.
    """
    made = Host(tmp_path_factory.mktemp("calm"), [CALM])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(interleaved_runs, "run_plan", made.run_plan)
        return made, made.compare(SECRETS, alternates="")


def test_sides_that_do_not_come_up_at_once_are_played_one_after_the_other(
    calm: tuple[Host, PairedComparison],
) -> None:
    pairs = calm[1].record
    assert not pairs.by_turns
    assert any("one after the other: beside the other one, " in note for note in pairs.notes)


def test_the_recorded_order_is_the_order_that_was_played(
    calm: tuple[Host, PairedComparison],
) -> None:
    host, pairs = calm[0], calm[1].record
    assert pairs.seed
    assert {pair.order for pair in pairs.pairs} == {"AB", "BA"}
    played = [
        getattr(pair, side)
        for pair in pairs.pairs
        for side in (("base", "head") if pair.order == "AB" else ("head", "base"))
    ]
    assert host.folders == played


@pytest.mark.parametrize("host", [[BUSY]], indirect=True)
def test_a_busy_host_plays_no_pair_again_and_reads_the_samples_of_each_run_once(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: Counter[Path] = Counter()

    def read_rows(path: Path, *others: Any) -> Rows:
        read[path] += 1
        return sample_arrays.read_rows(path, *others)

    monkeypatch.setattr(run_folder, "arrays", SimpleNamespace(**vars(sample_arrays) | locals()))
    host.compare()
    assert not any(name.endswith("again") for name in host.folders)
    assert {path.parts[len(host.tmp_path.parts) + 1] for path in read} == {"base", "head"}
    assert set(read.values()) == {1}


@pytest.mark.parametrize("host", [[CALM]], indirect=True)
def test_pairs_that_confirm_a_failure_continue_the_list(host: Host) -> None:
    pairs = host.compare(confirm=True)
    assert [pair.number for pair in pairs.record.pairs] == [*range(1, PAIRS + 4)]
    assert (pairs.record.confirmed_from, pairs.record.fresh) == (PAIRS, 3)
    verdict = judge_comparison_folder(pairs).result.verdict
    assert verdict.outcome == "fail"
    assert verdict.reason.endswith("Confirmed by 3 more pairs.")


def test_values_of_secrets_are_not_recorded(calm: tuple[Host, PairedComparison]) -> None:
    pairs = calm[1]
    assert pairs.record.environment == SECRETS | {"API_TOKEN": "***"}
    assert "very-secret" not in (pairs.folder / "pairs.json").read_text()


@pytest.mark.parametrize("host", [[CALM]], indirect=True)
def test_the_time_budget_ends_the_pairs(host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each run takes ten seconds, so that four pairs take 80."""
    seconds = SimpleNamespace(monotonic=lambda: 10.0 * len(host.folders))
    monkeypatch.setattr(interleaved_runs, "time", seconds)
    pairs = host.compare(budget_s=75.0).record
    assert len(pairs.pairs) == 3
    assert any("the time budget ended the comparison" in note for note in pairs.notes)


class Notes(Progress):
    """What is said while a comparison is made."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def note(self, text: str) -> None:
        self.texts.append(text)


@pytest.mark.parametrize("host", [[CALM]], indirect=True)
@pytest.mark.parametrize(
    ("cause", "status"),
    [
        (ProcessDiedError("blur ended; its last output:\nKeyError: 'gain'"), ExitStatus.USAGE),
        (UnwritableRunError("no space left on the device"), ExitStatus.RUN_FAILED),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_base_whose_code_fails_twice_is_not_to_be_tried_again(
    host: Host, monkeypatch: pytest.MonkeyPatch, cause: RunError, status: ExitStatus
) -> None:
    """Pipelines retry a run that failed; another attempt mends a disk, but no code."""

    def run_plan(plan: Plan, *, folder: RunFolder, **others: object) -> None:
        if folder.path.parent.name == "base":
            raise cause
        host.run_plan(plan, folder=folder, **others)

    monkeypatch.setattr(interleaved_runs, "run_plan", run_plan)
    notes = Notes()
    with pytest.raises(BaseFailsError, match=str(cause)) as raised:
        host.compare(progress=notes)
    assert raised.value.exit_code == status
    first_line, *last_lines = str(cause).splitlines()
    assert f"pair 1 is played again: the base failed: {first_line.partition(';')[0]}" in notes.texts
    assert not any(line in text for line in last_lines for text in notes.texts)
    (pair, *_) = open_comparison(host.tmp_path / "pairs").record.pairs
    assert pair.unusable.endswith(str(cause))


OWN_TIMES = "the load has its own times"


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, ""),
        ({"arrivals": Arrivals(kind="poisson")}, OWN_TIMES),
        ({"arrivals": Arrivals(kind="bursts", size=5)}, OWN_TIMES),
        ({"playback_mode": "timeline"}, OWN_TIMES),
    ],
)
def test_only_steps_at_equal_intervals_are_played_by_turns(
    changes: dict[str, Any], why: str
) -> None:
    played = InputPlan(topic="/in", type="", source="/in", bag_topic="/in", qos=QoS())
    rate = PlayPlan(rate_hz=30.0, duration_ns=10**9, iterations=3)
    plan = msgspec.structs.replace(template().plan(), inputs=(played,), play=(rate,), **changes)
    assert why_not_by_turns(plan, plan) == why


@pytest.mark.parametrize("host", [[CALM]], indirect=True)
def test_a_head_that_fails_twice_is_its_own_failure(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run_plan(plan: Plan, *, folder: RunFolder, **others: object) -> None:
        if folder.path.parent.name == "head":
            raise ProcessDiedError("blur ended")
        host.run_plan(plan, folder=folder, **others)

    monkeypatch.setattr(interleaved_runs, "run_plan", run_plan)
    with pytest.raises(ProcessDiedError, match="blur ended"):
        host.compare()
    pairs = open_comparison(host.tmp_path / "pairs")
    assert (pairs.record.status, pairs.usable_pairs()) == ("incomplete", ())
