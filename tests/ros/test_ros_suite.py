"""Every benchmark of specs/suite runs on real ROS 2, and a wrong graph fails by its accuracy.

The runs are short: two frames of each camera, half a second, and no harness overhead. Nothing is
asserted of times.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from nightly import only_nightly

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

from r2bspec.record.run_record import AccuracyRecord
from ros_runs import Bench, Finished

SUITE = Path(__file__).parents[2] / "specs" / "suite"
INVALID = 4
"""The playback missed its schedule on a busy machine; what was compared stays as it is."""


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """One cache for the file, so that images are rendered once and nothing of the user is used."""
    folder = tmp_path_factory.getbasetemp() / "datasets-of-the-suite"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))


def short(folder: Path, name: str, **nodes: dict[str, Any]) -> Path:
    """A benchmark of the suite that plays for half a second; `nodes` change those of the graph."""
    spec = yaml.safe_load((SUITE / f"{name}.r2b.yaml").read_text())
    spec["data_loader"]["window"]["end"] = "0.05 s"
    spec["playback"]["buffer"] = 2
    spec["benchmark"] = {
        "duration": "500 ms",
        "iterations": 1,
        "rates": ["10 Hz"],
        "warm_up": "100 ms",
        "gate": {"confirm": False, "interference": "tolerate"},
    }
    for each in spec["playback"]["inputs"].values():
        # No harness overhead is measured for inputs that are kept for late joiners.
        each["qos"] = {"durability": "transient_local"}
    del spec["slos"]["keeps_up"]
    for node, changes in nodes.items():
        spec["graph"]["nodes"][node] |= changes
    path = folder / f"{name}.r2b.yaml"
    path.write_text(yaml.safe_dump(spec))
    return path


def accuracy(done: Finished) -> AccuracyRecord:
    (found,) = done.run().record.accuracy
    assert found.outputs == found.steps == 2
    return found


@only_nightly()
def test_the_live_graph_finds_its_tag(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    done = bench.run(SUITE / "live_graph.r2b.yaml", "--smoke")
    done.assert_complete()
    assert done.monitor("detections")["received"] > 0
    assert not done.run().record.accuracy


@only_nightly()
def test_the_rectify_node_answers_every_image(tmp_path: Path) -> None:
    done = Bench(tmp_path).run(short(tmp_path, "rectify_node"))
    done.assert_complete()
    seen = done.monitor("rectified")
    assert (seen["answered"], seen["missed"]) == (5, 0)


@pytest.mark.parametrize(
    "name", [pytest.param("disparity_node", marks=only_nightly()), "disparity_graph"]
)
def test_disparities_are_right(tmp_path: Path, name: str) -> None:
    done = Bench(tmp_path).run(short(tmp_path, name))
    assert done.status in {0, INVALID}, done.stderr
    values = accuracy(done).values
    assert values["accuracy.disparity_bad_pixels"] < 0.03
    assert values["accuracy.disparity_density"] > 0.8


@only_nightly()
@pytest.mark.parametrize("name", ["apriltag_node", "apriltag_graph"])
def test_tags_are_where_they_are_said_to_be(tmp_path: Path, name: str) -> None:
    done = Bench(tmp_path).run(short(tmp_path, name))
    assert done.status in {0, INVALID}, done.stderr
    values = accuracy(done).values
    assert values["accuracy.tag_missed"] == values["accuracy.tag_false"] == 0
    assert values["accuracy.tag_position_error"] < 0.02


WRONG_SIZE = {"parameters": {"family": "36h11", "size": 0.2}}
# The matcher is given the images as the lenses distort them.
NOT_RECTIFIED = {
    "remappings": {"left/image_rect": "left/image_raw", "right/image_rect": "right/image_raw"}
}


@pytest.mark.parametrize(
    ("name", "changes", "metric"),
    [
        ("apriltag_node", {"apriltag": WRONG_SIZE}, "accuracy.tag_missed"),
        pytest.param(
            *("disparity_graph", {"disparity": NOT_RECTIFIED}, "accuracy.disparity_bad_pixels"),
            marks=only_nightly(),
        ),
    ],
)
def test_a_wrong_graph_fails_by_its_accuracy(
    tmp_path: Path, name: str, changes: dict[str, dict[str, Any]], metric: str
) -> None:
    done = Bench(tmp_path).run(short(tmp_path, name, **changes))
    assert accuracy(done).values[metric] > 0.1
    (found,) = (
        each for each in done.result()["verdict"]["requirements"] if each["metric"] == metric
    )
    assert (found["outcome"], found["method"]) == ("fail", "comparison with truth")
    assert done.status in {1, INVALID}, done.stderr
