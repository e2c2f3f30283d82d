"""The verb `tune`, and how its machine turns runs into starts; what is played is given."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import pytest

from r2bspec import api
from r2bspec.cli.main import main
from r2bspec.execute.errors import InterruptedRunError, NotReadyError
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.tune.machine import RealMachine, TuningError, excess, goal_of
from r2bspec.tune.space import Combination, Space
from r2bspec.tune.tuning_result import Proof, Start
from ros_runs import Bench, relay_node, relay_spec

NICE = "graph.nodes.relay.nice"
VALUES = {NICE: [5, 10], "transport": ["udp"]}
GAIN = Proof(
    run="proof",
    meets=True,
    gains=True,
    before=0.4,
    after=0.3,
    ratio=0.75,
    lower=0.7,
    upper=0.8,
    pairs=8,
)


def write(folder: Path, **more: Any) -> Path:
    slos = {"all": {"at": "20 Hz", "require": ["received > 0"]}}
    tune = {"values": VALUES, "trials": 4}
    spec = {"slos": slos, "tune": tune, "graph": {"nodes": {"relay": relay_node()}}} | more
    return Bench(folder).write(relay_spec(**spec))


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> None:
    def start(_: RealMachine, combination: Combination, name: str) -> Start:
        return Start(outcome="pass", cost=0.4 - 0.1 * (combination[0] == 2), run=name)

    monkeypatch.setattr(RealMachine, "start", start)
    monkeypatch.setattr(RealMachine, "prove", lambda *_: GAIN)


@pytest.mark.usefixtures("played")
def test_values_that_are_proved_are_shown_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec, folder, overlay = write(tmp_path), tmp_path / "search", tmp_path / "best.r2b.yaml"
    words = ["tune", str(spec), "-q", "--output", str(folder), "--write", str(overlay)]
    assert main(words) == 0
    shown = capsys.readouterr()
    assert shown.out.startswith(
        "relay: IMPROVED. The objectives are met, at 25 % less cost than today's.\n"
        f"{NICE}: 10\n"
        "cpu.graph.mean at 20 Hz: 40 % -> 30 %, -25 % (-30 to -20 %) in 8 pairs\n\n"
        "trials  cost: cpu.graph.mean at 20 Hz\n"
        "trial  outcome  cost  starts  values"
    )
    assert f"{overlay} was written" in shown.err
    assert api.prepare(overlay).plan == api.prepare(spec, sets=[f"{NICE}=10"]).plan
    found = json.loads((folder / "tuning.json").read_text())
    assert (found["outcome"], found["winner"]) == ("improved", {NICE: 10})
    assert "| trial | outcome | cost |" in (folder / "tuning.md").read_text()
    assert main(words) == 2, "the overlay exists"
    assert main(words[:-2]) == 2, "and so does the folder"


@pytest.mark.usefixtures("played")
def test_nothing_is_written_that_is_not_proved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    open_ = msgspec.structs.replace(GAIN, meets=False, reason="It is not shown.")
    monkeypatch.setattr(RealMachine, "prove", lambda *_: open_)
    overlay = tmp_path / "best.r2b.yaml"
    words = ["-q", "--output", str(tmp_path / "s"), "--write", str(overlay), "--format", "json"]
    assert main(["tune", str(write(tmp_path)), *words]) == 3
    shown = capsys.readouterr()
    assert json.loads(shown.out)["reason"] == "It is not shown."
    assert "was not written" in shown.err
    assert not overlay.exists()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"slos": {}}, "no objective"),
        ({"tune": {}}, "lists no values"),
        ({"tune": {"values": VALUES, "minimize": "throughput.mean"}}, "better when it is larger"),
        ({"tune": {"values": {"graph.nodes.relay.niec": [5]}}}, "did you mean 'nice'"),
    ],
)
def test_a_search_that_cannot_be_made_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: dict[str, Any], words: str
) -> None:
    folder = tmp_path / "search"
    assert main(["tune", str(write(tmp_path, **more)), "--output", str(folder)]) == 2
    assert words in capsys.readouterr().err
    assert not folder.exists()


def test_the_goal_is_measured_at_the_very_rate_that_is_played(tmp_path: Path) -> None:
    """No objective names it, so it is not as a user wrote it."""
    sets = ["benchmark.rates=[33.3333333 Hz]", "slos={}"]
    plan = api.prepare(write(tmp_path), sets=sets).plan
    goal = goal_of(plan, "cpu.graph.mean")
    assert goal.at is not None
    assert goal.at.hz in {play.rate_hz for play in plan.play} == {33.3333333}
    with pytest.raises(TuningError, match="no rate is played"):
        goal_of(msgspec.structs.replace(plan, play=()), "cpu.graph.mean")


def machine(folder: Path) -> RealMachine:
    spec = write(folder)
    goal = goal_of(api.prepare(spec).plan, "cpu.graph.mean")
    space = Space({NICE: (5, 0, 50), "graph.nodes.relay.threads": (1,)})
    return RealMachine(SpecSelection(spec), space, folder, goal)


def test_values_that_change_nothing_or_are_not_valid_start_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(*_: Any, **__: Any) -> Any:
        raise NotReadyError("never ready")

    monkeypatch.setattr(api, "run", run)
    tried = machine(tmp_path)
    outcomes = [tried.start(one, "x") for one in ((0, 0), (1, 0), (2, 0), (3, 0))]
    assert [start.outcome for start in outcomes] == ["broken", "broken", "refused", "refused"]
    assert outcomes[0].reason == "R2B640: never ready"
    assert outcomes[2].reason == "the plan is that of today's"
    assert "nice" in outcomes[3].reason


def test_a_signal_ends_the_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def run(*_: Any, **__: Any) -> Any:
        raise InterruptedRunError("interrupted")

    monkeypatch.setattr(api, "run", run)
    with pytest.raises(InterruptedRunError):
        machine(tmp_path).start((0, 0), "x")


def test_a_start_that_the_machine_could_not_play_is_made_once_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = machine(tmp_path)
    names: list[str] = []

    def play(_: RealMachine, prepared: api.PreparedBenchmark, name: str) -> Start:
        assert prepared.plan.starts == 1
        names.append(name)
        return Start(outcome="invalid" if len(names) == 1 else "pass", cost=1.0)

    monkeypatch.setattr(RealMachine, "_play", play)
    assert tried.start((0, 0), "000").outcome == "pass"
    assert names == ["000", "000-again"]


@pytest.mark.parametrize(
    ("above", "below", "expected"),
    [(2.0, 1.0, math.log(2)), (1.0, 2.0, -math.log(2)), (0.25, 0.0, 0.25), (1e9, 1.0, 3.0)],
)
def test_the_excess_is_how_far_a_limit_is_missed(
    above: float, below: float, expected: float
) -> None:
    assert excess(above, below) == pytest.approx(expected)
