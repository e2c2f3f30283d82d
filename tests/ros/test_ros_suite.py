"""Every benchmark of specs/suite runs on real ROS 2.

The runs are short: two frames of each camera, half a second, and no harness overhead. Nothing is
asserted of times.
"""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from nightly import only_nightly

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

from ros_runs import Bench

SUITE = Path(__file__).parents[2] / "specs" / "suite"


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """One cache for the file, so that images are rendered once and nothing of the user is used."""
    folder = tmp_path_factory.getbasetemp() / "datasets-of-the-suite"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))


def short(folder: Path, name: str) -> Path:
    """A benchmark of the suite that plays for half a second."""
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
    path = folder / f"{name}.r2b.yaml"
    path.write_text(yaml.safe_dump(spec))
    return path


@only_nightly()
def test_the_live_graph_finds_its_tag(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    done = bench.run(SUITE / "live_graph.r2b.yaml", "--smoke")
    done.assert_complete()
    assert done.monitor("detections")["received"] > 0


def test_the_rectify_node_answers_every_image(tmp_path: Path) -> None:
    done = Bench(tmp_path).run(short(tmp_path, "rectify_node"))
    done.assert_complete()
    seen = done.monitor("rectified")
    assert (seen["answered"], seen["missed"]) == (5, 0)


@only_nightly()
@pytest.mark.parametrize(
    ("name", "monitor"),
    [
        ("disparity_graph", "disparity"),
        ("disparity_node", "disparity"),
        ("apriltag_node", "detections"),
        ("apriltag_graph", "detections"),
    ],
)
def test_the_graph_answers_the_images_of_its_cameras(
    tmp_path: Path, name: str, monitor: str
) -> None:
    done = Bench(tmp_path).run(short(tmp_path, name))
    done.assert_complete()
    assert done.monitor(monitor)["answered"] > 0
