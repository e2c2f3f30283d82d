"""Noise from a simulated control, the file beside the spec, its rule, and the proposed patch."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pair_simulation import Comparison
from r2bspec.check import check
from r2bspec.compare.errors import IncomparableError
from r2bspec.compare.proposals import compute_calibration, propose_limits, store_calibration
from r2bspec.diagnostics import Diagnostic
from r2bspec.judge.statistics.t_interval import smallest_detectable
from r2bspec.language.load_spec import load_spec
from r2bspec.record.calibration_file import (
    Calibration,
    MetricNoise,
    add_calibration,
    calibration_path,
    read_calibration_file,
)
from r2bspec.record.comparison_folder import PairedComparison
from r2bspec.record.files import RecordError

RANDOM = np.random.default_rng(11)
BASE, HEAD = 0.02 * np.exp(RANDOM.normal(0, 0.02, (2, 12)))

SPEC = """\
r2bspec: 1
name: simulated
data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: image_raw}}
playback: {inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}}
graph:
  nodes:
    relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}
monitors: {detections: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {rates: [30 Hz], iterations: 10, duration: 1 s}
"""
SLOS = """\
slos:
  no_regression:   # what we promise
    at: 30 Hz
    require:
      - latency.p50 <= 101 % of baseline  # strict
      - throughput.mean >= 80 % of baseline
"""


def control(path: Path, pairs: int = 12) -> PairedComparison:
    return Comparison(BASE[:pairs].tolist(), HEAD[:pairs].tolist(), control=True).write(path)


def found_in(spec: Path) -> list[Diagnostic]:
    return [one for one in check(load_spec(spec)) if one.code.startswith("R2B52")]


@pytest.fixture(name="pairs", scope="module")
def pairs_folder(tmp_path_factory: pytest.TempPathFactory) -> PairedComparison:
    return control(tmp_path_factory.mktemp("control") / "pairs")


@pytest.fixture(name="found", scope="module")
def calibration_of_pairs(pairs: PairedComparison) -> Calibration:
    return compute_calibration(pairs)


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "relay.r2b.yaml"
    path.write_text(SPEC + SLOS)
    return path


def noise_of(found: Calibration, metric: str) -> MetricNoise:
    return next(one for one in found.metrics if one.metric == metric)


def test_the_noise_is_that_of_the_pairs(found: Calibration) -> None:
    one = noise_of(found, "latency.p50")
    logs = np.log(HEAD / BASE)
    assert one.deviation == pytest.approx(logs.std(ddof=1), rel=0.01)
    assert one.bias == pytest.approx(logs.mean(), abs=1e-3)
    assert one.upper > one.deviation
    assert one.n == 12
    assert one.margins["10"] == pytest.approx(smallest_detectable(one.upper, 10, 0.95))
    assert one.margin(15) == one.margins["12"]
    assert one.margin(2) is None


def test_only_a_control_with_some_pairs_can_be_used(tmp_path: Path) -> None:
    with pytest.raises(IncomparableError, match="compares two graphs"):
        compute_calibration(Comparison(BASE.tolist(), HEAD.tolist()).write(tmp_path / "a"))
    with pytest.raises(IncomparableError, match="2 pairs are too few"):
        compute_calibration(control(tmp_path / "b", pairs=2))


def test_calibrations_of_other_machines_and_benchmarks_stay(
    spec: Path, pairs: PairedComparison, found: Calibration
) -> None:
    path = calibration_path(spec)
    assert path.name == "relay.noise.json"
    add_calibration(path, "simulated", "another machine", found)
    add_calibration(path, "simulated[threads=2]", "another machine", found)
    store_calibration(spec, pairs, found)
    kept = read_calibration_file(path)
    assert kept is not None
    assert {name: len(hosts) for name, hosts in kept.benchmarks.items()} == {
        "simulated": 2,
        "simulated[threads=2]": 1,
    }


def test_a_margin_below_the_noise_is_warned_of(
    spec: Path, pairs: PairedComparison, found: Calibration
) -> None:
    assert found_in(spec) == []
    store_calibration(spec, pairs, found)
    (warning,) = found_in(spec)
    assert (warning.code, warning.severity) == ("R2B523", "warning")
    assert (warning.span.line, warning.edit) == (14, None)
    assert "10 pairs detect no change below" in warning.message
    assert "a simulated processor" in warning.message


def test_the_patch_widens_that_margin_and_nothing_else(
    spec: Path, pairs: PairedComparison, found: Calibration
) -> None:
    store_calibration(spec, pairs, found)
    text = spec.read_text()
    after, left = propose_limits(load_spec(spec), found, text)
    changed = [
        (old, new)
        for old, new in zip(text.splitlines(), after.splitlines(), strict=True)
        if old != new
    ]
    assert left == []
    ((_, new),) = changed
    assert new.endswith("% of baseline  # strict")
    limit = float(new.split("<=")[1].split("%")[0]) / 100
    margin = noise_of(found, "latency.p50").margin(10)
    assert margin is not None
    assert math.log(limit) >= margin > math.log(limit - 0.005)
    spec.write_text(after)
    assert found_in(spec) == []
    assert propose_limits(load_spec(spec), found, after) == (after, [])


@pytest.mark.parametrize(
    "slos", ["", "slos:\n  other:\n    at: 30 Hz\n    require: [latency.p50 < 1 s]\n# end\n"]
)
def test_where_nothing_is_asked_an_objective_is_proposed(
    spec: Path, pairs: PairedComparison, found: Calibration, slos: str
) -> None:
    spec.write_text(SPEC + slos)
    after, left = propose_limits(load_spec(spec), found, SPEC + slos)
    assert left == []
    spec.write_text(after)
    slo = load_spec(spec).spec
    assert slo is not None
    asked = [one.text for one in slo.slos["no_regression"].require]
    assert [text.split()[0] for text in asked] == ["throughput.mean", "latency.p50"]
    store_calibration(spec, pairs, found)
    assert found_in(spec) == []


def test_what_cannot_be_edited_is_told(spec: Path, found: Calibration) -> None:
    flow = SPEC + "slos: {other: {at: 30 Hz, require: [latency.p50 < 1 s]}}\n"
    spec.write_text(flow)
    after, left = propose_limits(load_spec(spec), found, flow)
    assert after == flow
    assert "by hand" in left[0]


def test_a_damaged_file_is_a_warning_and_not_overwritten(
    spec: Path, pairs: PairedComparison, found: Calibration
) -> None:
    calibration_path(spec).write_text('{"r2bspec_noise": 7}')
    (warning,) = found_in(spec)
    assert warning.code == "R2B524"
    assert "relay.noise.json" in warning.message
    with pytest.raises(RecordError):
        store_calibration(spec, pairs, found)
    assert calibration_path(spec).read_text() == '{"r2bspec_noise": 7}'
