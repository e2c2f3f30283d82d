"""Several runs, smoke runs, ended rates and recorded outputs on real ROS 2."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")


from r2bspec.execute.host_queue import DISABLED_BY
from ros_runs import Bench, relay_spec

NO_CONFIRMATION = {"gate": {"confirm": False, "interference": "tolerate"}}


def short(**changes: object) -> dict[str, object]:
    """The benchmark of the relay's spec, changed."""
    benchmark = relay_spec()["benchmark"]
    return {**benchmark, **NO_CONFIRMATION, **changes}


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path / "bench")


def test_a_folder_of_specs_is_run_with_one_summary(bench: Bench) -> None:
    slos = {"received": {"at": "20 Hz", "require": ["received > 0"]}}
    impossible = {"never": {"at": "20 Hz", "require": ["latency.max < 1 us"]}}
    quick = short(duration="500 ms")
    bench.write(relay_spec(name="good", slos=slos, benchmark=quick), "good")
    bench.write(relay_spec(name="late", slos=impossible, benchmark=quick), "late")
    done = bench.run(bench.folder, "--format", "json")
    summary = json.loads(done.stdout)
    assert summary == json.loads((done.folder / "suite.json").read_text())
    runs = {run["name"]: run for run in summary["runs"]}
    assert list(runs) == ["good", "late"]
    outcomes = {name: run["outcome"] for name, run in runs.items()}
    if "invalid" not in outcomes.values():  # a playback that was late is no fault of this test
        assert (done.status, outcomes) == (1, {"good": "pass", "late": "fail"})
    for run in runs.values():
        assert (Path(run["folder"]) / "record.json").is_file()
        result = json.loads((Path(run["folder"]) / "result.json").read_text())
        assert [rate["offered_hz"] for rate in result["metrics"]["rates"]] == [20]
    assert f"run folder: {done.folder}" in done.stderr


def test_a_smoke_run_plays_one_short_iteration(bench: Bench) -> None:
    slos = {"never": {"at": "20 Hz", "require": ["latency.p99 < 1 us", "peak.rate > 999 Hz"]}}
    benchmark = short(
        duration="10 s", iterations=50, search={"min": "5 Hz", "max": "1000 Hz"}, warm_up="5 s"
    )
    done = bench.run(relay_spec(slos=slos, benchmark=benchmark), "--smoke")
    done.assert_complete()
    record = done.run().record
    assert [segment.kind for segment in record.segments if segment.kind != "warm_up"] == [
        "iteration"
    ]
    (iteration,) = done.segments()
    assert iteration.steps <= 41
    assert record.search is None
    verdict = done.result()["verdict"]
    assert verdict["requirements"] == []
    assert verdict["reason"].endswith("a smoke run does not judge the SLOs.")


@only_nightly()
def test_a_second_run_waits_for_the_first_or_refuses(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "tmp"
    own.mkdir()
    monkeypatch.setenv("TMPDIR", str(own))
    monkeypatch.delenv(DISABLED_BY)
    spec = relay_spec(name="first", benchmark=short(iterations=4))
    with bench.start(spec) as first:
        first.wait_for("starting player and monitor")
        refused = bench.run(relay_spec(name="refused"), "--wait=0 s")
        assert refused.status == 4
        assert "R2B697" in refused.error
        assert f"first (process {first.process.pid})" in refused.error
        with bench.start(relay_spec(name="second", benchmark=short(duration="500 ms"))) as second:
            second.wait_for(rf"in place 2 of the queue .* first \(process {first.process.pid}\)")
            assert first.finish().run().record.status == "complete"
            waited = second.finish()
    waited.assert_complete()
    ended = first.finish().run().record.ended_at
    assert waited.run().record.started_at >= ended
