"""Objectives proposed from a run: they pass on it, and leave alone what the spec states."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from r2bspec.api import prepare
from r2bspec.cli.main import main
from r2bspec.compare.proposals import Proposal, limit_of, propose_objectives
from r2bspec.judge.judge_run import result_of
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.canonical_json import canonical_json, plan_hash
from r2bspec.record.run_folder import Run
from run_simulation import Played, Simulation, edited_record

SPEC = """\
r2bspec: 1
name: simulated
data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: image_raw}}
playback: {inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}}
graph:
  nodes:
    relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
# What it answers.
monitors: {detections: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {rates: [30 Hz], iterations: 10, starts: 1, duration: 10 s}
"""


def played(iterations: int = 10, n: int = 300, lost: int = 0) -> list[Played]:
    random = np.random.default_rng(5)
    found = []
    for _ in range(iterations):
        latency = 0.02 * np.exp(random.normal(0, 0.1, n)) * math.exp(random.normal(0, 0.02))
        if lost:
            latency[:: n // lost] = np.nan
        found.append(Played(rate_hz=30, latency=latency))
    return found


def run_of(folder: Path, **how: int) -> Run:
    return Simulation(segments=played(**how)).write(folder / "run")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run_of(tmp_path_factory.mktemp("suggest"))


def proposed(run: Run, text: str) -> Proposal:
    loaded = load_spec(text, file="simulated.r2b.yaml")
    assert loaded.spec is not None
    return propose_objectives(loaded, text, result_of(run), lambda slos: result_of(run, slos, "x"))


def test_the_proposals_pass_on_the_run(run: Run) -> None:
    found = proposed(run, SPEC)
    assert found.text.startswith(SPEC)
    slos = load_spec(found.text, file="simulated.r2b.yaml").spec
    assert slos is not None
    verdict = result_of(run, slos.slos, "x").verdict
    assert [requirement.outcome for requirement in verdict.requirements] == ["pass", "pass"]
    assert [requirement.metric for requirement in verdict.requirements] == [
        "latency.p99",
        "drop_rate",
    ]
    limit, estimate = verdict.requirements[0].limit, verdict.requirements[0].estimate
    assert limit is not None
    assert estimate is not None
    assert estimate < limit < 1.5 * estimate


def test_a_short_run_gets_a_lower_percentile(tmp_path: Path) -> None:
    found = proposed(run_of(tmp_path, iterations=4, n=30), SPEC)
    (texts,) = found.added.values()
    # 120 messages can show a p95, for which 59 without a late one are enough, but no p99.
    assert texts[0].startswith(("latency.p95", "latency.p90"))


def test_one_iteration_shows_no_scatter(tmp_path: Path) -> None:
    found = proposed(run_of(tmp_path, iterations=1, n=3000), SPEC)
    assert any("it takes 3 iterations" in note for note in found.notes)
    assert all("latency" not in text for texts in found.added.values() for text in texts)


def test_of_a_pace_of_its_own_no_latency_is_proposed(run: Run) -> None:
    """However many iterations it is given, it has none."""
    text = SPEC.replace("detections: {", "detections: {match: own_pace, ")
    found = proposed(run, text)
    assert not any("iterations" in note for note in found.notes)
    assert not any("latency" in each for texts in found.added.values() for each in texts)


def test_losses(tmp_path: Path) -> None:
    (texts,) = proposed(run_of(tmp_path / "few", lost=3), SPEC).added.values()
    assert "drop_rate <= 2 %" in texts
    found = proposed(run_of(tmp_path / "many", lost=50), SPEC)
    assert any("were lost" in note for note in found.notes)


def test_what_the_spec_states_is_left_alone(run: Run) -> None:
    mine = "slos:\n  mine:\n    at: 30 Hz\n    require: [latency.p50 < 1 s, drop_rate <= 1 %]\n"
    assert proposed(run, SPEC + mine).text == SPEC + mine
    other = mine.replace("at: 30 Hz", "at: 10 Hz").replace("rates: [30", "rates: [10, 30")
    assert proposed(run, SPEC.replace("[30 Hz]", "[10 Hz, 30 Hz]") + other).added


def test_a_spec_in_flow_style_is_changed_by_hand(run: Run) -> None:
    text = SPEC + "slos: {mine: {require: [peak.rate >= 1 Hz], level: 'off'}}\n"
    text = text.replace("duration: 10 s}", "duration: 10 s, search: {min: 1 Hz, max: 9 Hz}}")
    found = proposed(run, text)
    assert found.text == text
    assert any(note.startswith("add by hand: measured_at_30_hz:") for note in found.notes)


def test_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    run_of(tmp_path)
    Path("simulated.r2b.yaml").write_text(SPEC)
    words = ["judge", "run", "--suggest", "simulated.r2b.yaml"]
    assert main(words) == 2
    assert "is not of this spec" in capsys.readouterr().err
    assert main([*words, "--format", "json"]) == 2
    assert "takes --write and no report" in capsys.readouterr().err
    plan = prepare("simulated.r2b.yaml").plan
    Path("run", "plan.json").write_bytes(canonical_json(plan))
    with edited_record(Path("run")) as record:
        record["plan_hash"] = plan_hash(plan)
    assert main(words) == 0
    shown = capsys.readouterr()
    assert "\n+  measured_at_30_hz:\n" in shown.out
    assert Path("simulated.r2b.yaml").read_text() == SPEC
    assert main([*words, "--write"]) == 0
    assert "measured_at_30_hz" in Path("simulated.r2b.yaml").read_text()
    assert main(words) == 0
    assert "has a requirement for all" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("scatter", "least", "most"), [(0.0, 1.3, 1.3), (0.02, 1.3, 1.3), (0.15, 1.4, 2.0)]
)
def test_the_margin_follows_the_scatter_and_is_said(
    scatter: float, least: float, most: float
) -> None:
    limit = limit_of([0.05 * math.exp(scatter * way) for way in (-1, 0, 1)], "starts")
    assert limit is not None
    assert least <= limit.margin <= most
    assert limit.value / 0.05 == pytest.approx(limit.margin, rel=0.02)
    assert "of 3 starts, which scatter by" in limit.why


def test_scatter_that_doubles_the_value_has_no_limit(tmp_path: Path) -> None:
    wild = [Played(rate_hz=30, latency=np.full(300, 0.002 * 1.6**number)) for number in range(6)]
    found = proposed(Simulation(segments=wild).write(tmp_path / "run"), SPEC)
    assert any("too much for a limit" in note for note in found.notes)
    assert not any("latency" in each for texts in found.added.values() for each in texts)


GATED = SPEC.replace("duration: 10 s}", "duration: 10 s, gate: {confidence: 95 %}}")


def test_a_spec_with_a_gate_gets_a_limit_of_the_work_of_the_baseline(run: Run) -> None:
    (texts,) = proposed(run, GATED).added.values()
    assert [text for text in texts if "baseline" in text] == ["work.graph.p50 <= 105 % of baseline"]
    (texts,) = proposed(run, SPEC).added.values()
    assert not any("baseline" in text for text in texts)


def test_a_spec_with_a_gate_gets_a_limit_of_the_latency_where_work_is_unknown(
    tmp_path: Path,
) -> None:
    unread = Simulation(segments=played(), cpu={}).write(tmp_path / "run")
    (texts,) = proposed(unread, GATED).added.values()
    assert [text for text in texts if "baseline" in text] == ["latency.p50 <= 110 % of baseline"]
