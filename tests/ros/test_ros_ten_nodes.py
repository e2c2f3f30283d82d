"""Ten nodes of different styles, from ``init`` beside a recording to a verdict."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from nightly import only_nightly

pytest.importorskip("rclpy")

from node_styles import write_workspace
from r2bspec.cli.main import main
from recorded_inputs import IMAGE, IMU, SCAN, record, series
from ros_runs import Bench

NODES: dict[str, str] = yaml.safe_load(
    Path(__file__).with_name("ten_nodes.yaml").read_text(encoding="utf-8")
)
PACKAGED = "drive_pkg:driver"
"""The console script of a package, in a workspace."""

ENOUGH = ("starts=1", "iterations=8", "duration=2 s")


@only_nightly()
@pytest.mark.parametrize("target", [*NODES, PACKAGED])
def test_a_node_gets_from_init_to_a_verdict(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    target: str,
) -> None:
    bench = Bench(write_workspace(tmp_path / "workspace"))
    monkeypatch.chdir(bench.folder)
    name, _, what = target.partition(":")
    node, rows = target, series("/goal", IMAGE, 40, 20.0)
    if target != PACKAGED:
        Path(f"{name}.py").write_text(NODES[target])
        node = f"./{name}.py:{what}"
        rows = [
            *series("/camera", IMAGE, 40, 20.0),
            *series("/imu", IMU, 200, 100.0),
            *series("/scan", SCAN, 20, 10.0),
        ]
    record(Path("recording"), rows)
    spec = bench.folder / f"{name}.r2b.yaml"
    init = ["init", name, "--node", node, "--from-bag", "./recording"]
    assert main(init) == 0
    if "r2bspec interfaces" in capsys.readouterr().out:
        # Its topics are known once it has been started, as the command says.
        assert main(["interfaces", str(spec)]) == 0
        spec.unlink()
        assert main(init) == 0
    assert main(["validate", str(spec)]) == 0
    written = yaml.safe_load(spec.read_text())
    settings = [word for each in ENOUGH for word in ("--set", f"benchmark.{each}")]
    done = bench.run_until_valid(written, *settings)
    assert done.outcome in {"pass", "fail", "inconclusive"}, done.stderr
    assert all(done.monitor(each)["received"] for each in written["monitors"])
